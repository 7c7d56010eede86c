from dataclasses import astuple

import numpy as np
import pytest

from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road import surface

RNG = np.random.default_rng(5)


@pytest.fixture
def road():
    """Heights of cells of a road that is rough and bends across."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.geomspace(4.0, 20.0, 9), np.linspace(-2.0, 2.0, 5)))
    design = np.column_stack([np.ones_like(x), x, y])
    kernel, profile = surface.unit_covariances(np.column_stack([x, y]))
    metres = 0.005 * x
    noise = (0.1 * metres) ** 2
    heights = RNG.multivariate_normal(np.zeros(len(x)), 1e-5 * kernel + profile + np.diag(noise))
    return heights, design, noise, profile, kernel, metres


def test_likelihoods_of_road_and_profile_are_those_of_their_covariance(road):
    heights, design, noise, profile, kernel, metres = road
    basis = np.linalg.qr(design, mode="complete")[0][:, 3:]
    tried = [
        (mismatch, roughness, bend)
        for mismatch in surface._MISMATCH_PX
        for roughness in surface._ROUGHNESS
        for bend in surface._CAMBERS
    ]

    def log_likelihood(mismatch, roughness, bend):
        covariance = np.diag(noise + (mismatch * metres) ** 2) + roughness * kernel + bend**2 * profile
        contrast = basis.T @ heights
        of_contrast = basis.T @ covariance @ basis
        _, log_determinant = np.linalg.slogdet(of_contrast)
        return -0.5 * (contrast @ np.linalg.solve(of_contrast, contrast) + log_determinant)

    expected = np.array([log_likelihood(*each) for each in tried])
    posterior = np.exp(expected - expected.max())
    means = posterior / posterior.sum() @ np.array(tried) ** [2, 1, 2]
    plane = max(log_likelihood(mismatch, 0.0, 0.0) for mismatch in surface._MISMATCH_OF_PLANE_PX)
    unevenness = surface._estimate_unevenness(heights, design, noise, profile, kernel, metres)
    assert unevenness.roughness == pytest.approx(means[1], rel=1e-6)
    assert unevenness.mismatch_px == pytest.approx(np.sqrt(means[0]), rel=1e-6)
    assert unevenness.camber == pytest.approx(np.sqrt(means[2]), rel=1e-6)
    assert unevenness.log_likelihood_ratio == pytest.approx(expected.max() - plane, rel=1e-6)


def test_heights_of_a_plane_without_any_noise_have_a_likelihood(road):
    _, design, noise, profile, kernel, metres = road
    found = surface._estimate_unevenness(np.zeros(len(metres)), design, noise, profile, kernel, metres)
    assert np.all(np.isfinite(astuple(found)))


@pytest.mark.parametrize("column", [1, 2])
def test_cells_that_do_not_determine_a_plane_have_none(road, column):
    """All of them straight before the camera, or all as far away."""
    heights, design, noise, _, _, metres = road
    xy = design[:, 1:].copy()
    cells = surface.CellHeights(heights, noise, metres, xy)
    assert not isinstance(surface.fit_surface(cells, design), NotFitted)
    for value in (0.0, 1.0):
        flat = design.copy()
        flat[:, column] = value
        assert isinstance(surface.fit_surface(cells, flat), NotFitted)
