# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""One step of Gauss and Newton: against least squares of its own, and draws of the errors it claims."""

import numpy as np
import pytest
from row_block_making import make_blocks

from stereo_selfcal.core.estimators.gauss_newton import MIN_BLOCKS, RoadPrior, Step, solve_step
from stereo_selfcal.core.rejection import NotFitted

N_POSE = 5
VARIANCE = 4.0  # of the grey values
CURVATURE = 4
REWEIGHTINGS = 5
# Where a block ceases to count, as a deviance of three displacements.
CUT = 30.0


class Case:
    """A road of L stripes whose parameters move the edges of N blocks in known ways."""

    def __init__(self, n_stripes=2, n_blocks=30, seed=0, free_heights=(), truth_scale=1.0):
        rng = np.random.default_rng(seed)
        self.n = N_POSE + 3 * n_stripes
        self.shape = (2, n_stripes, n_blocks)
        self.height_stds_m = np.zeros(n_stripes)
        for stripe, std in free_heights:
            self.height_stds_m[stripe] = std
        self.varied = np.ones(self.n, bool)
        self.varied[CURVATURE] = False
        self.varied[-n_stripes:] = self.height_stds_m > 0
        # Column of an edge by a parameter. A stripe's own parameters move that stripe alone.
        self.by_road = rng.normal(size=(self.n, 2, n_stripes, 2, n_blocks)) * 10.0
        for kind, stripe, other in np.ndindex(3, n_stripes, n_stripes):
            if stripe != other:
                self.by_road[N_POSE + kind * n_stripes + stripe, :, other] = 0.0
        self.by_road[~self.varied] = 0.0
        root = rng.normal(size=(*self.shape, 3, 3)) + 3.0 * np.eye(3)
        self.information = root @ np.swapaxes(root, -1, -2)
        # Of the road's parameters, then the blur of both lenses.
        self.truth = rng.normal(size=self.n + 2) * np.append(self.varied, [1, 1]) * truth_scale
        self.rng = rng

    @property
    def free(self):
        return np.flatnonzero(np.append(self.varied, [True, True]))

    def design(self):
        """Return the derivatives (2, L, N, 3, P) of left edge, right edge and blur."""
        design = np.zeros((*self.shape, 3, self.n + 2))
        for i, stripe, block in np.ndindex(*self.shape):
            for edge in (0, 1):
                design[i, stripe, block, edge, : self.n] = self.by_road[:, i, stripe, edge, block]
            design[i, stripe, block, 2, self.n + i] = 1.0
        return design

    def noise(self, scale=1.0):
        """Return errors of the displacements (2, L, N, 3) as the information has them."""
        root = np.linalg.cholesky(np.linalg.inv(self.information) * VARIANCE)
        return scale * (root @ self.rng.normal(size=(*self.shape, 3, 1)))[..., 0]

    def blocks(self, errors=0.0, usable=None):
        displacement = self.design() @ self.truth + errors
        return make_blocks(displacement, self.information, VARIANCE, usable)

    def known(self, heights_m=None):
        heights = np.zeros(self.shape[1]) if heights_m is None else np.array(heights_m)
        return RoadPrior(self.varied, heights, self.height_stds_m)

    def solve(self, errors=0.0, reweightings=REWEIGHTINGS, usable=None):
        return solve_step(self.blocks(errors, usable), self.by_road, reweightings, self.known())

    def least_squares(self, displacement, weights):
        """Return the free parameters and their covariance by whitened rows, for grey values of VARIANCE."""
        root = np.swapaxes(np.linalg.cholesky(self.information / VARIANCE), -1, -2)
        root = root * np.sqrt(weights)[..., None, None]
        rows = (root @ self.design()).reshape(-1, self.n + 2)[:, self.free]
        values = (root @ displacement[..., None]).reshape(-1)
        found, *_ = np.linalg.lstsq(rows, values, rcond=None)
        return found, np.linalg.inv(rows.T @ rows)


def gave_up(outcome):
    return isinstance(outcome, NotFitted)


# --- the step ------------------------------------------------------------------------------------------


def test_without_errors_the_step_is_the_truth():
    case = Case(n_stripes=3)
    found = case.solve()
    np.testing.assert_allclose(found.step, case.truth, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.free, case.free)
    assert len(found.relative) == np.prod(case.shape)
    assert found.scale == 1.0


def test_one_weighting_is_least_squares():
    case = Case()
    errors = case.noise()
    found = case.solve(errors, reweightings=1)
    expected, _ = case.least_squares(case.design() @ case.truth + errors, np.ones(case.shape))
    np.testing.assert_allclose(found.step[case.free], expected, rtol=0, atol=1e-9)


def test_the_second_weighting_is_tukeys_biweight():
    case = Case()
    errors = case.noise()
    errors[0, 0, :3] *= 4.0
    displacement = case.design() @ case.truth + errors
    first, _ = case.least_squares(displacement, np.ones(case.shape))
    residual = displacement - case.design()[..., case.free] @ first
    deviance = np.einsum("...i,...ij,...j", residual, case.information, residual) / VARIANCE
    # Medians of either camera's deviances below that of the chi-squared distribution leave the scale at 1.
    scales = [max(1.0, np.sort(of_camera.ravel())[of_camera.size // 2] / 2.366) for of_camera in deviance]
    relative = deviance / np.array(scales)[:, None, None] / CUT
    weights = np.maximum(1.0 - relative, 0.0) ** 2 / np.array(scales)[:, None, None]
    assert np.any(weights < 0.5) and np.any(weights > 0.9)
    expected, _ = case.least_squares(displacement, weights)
    np.testing.assert_allclose(case.solve(errors, 2).step[case.free], expected, rtol=0, atol=1e-9)


def test_what_is_not_free_does_not_move():
    case = Case()
    found = case.solve(case.noise())
    fixed = np.setdiff1d(np.arange(case.n + 2), case.free)
    assert list(fixed) == [CURVATURE, case.n - 2, case.n - 1]
    np.testing.assert_array_equal(found.step[fixed], 0.0)
    assert not found.covariance(VARIANCE)[fixed].any()


def test_blocks_that_are_not_usable_have_no_say():
    case = Case()
    usable = np.ones(case.shape, bool)
    usable[:, :, ::3] = False
    errors = np.where(usable[..., None], 0.0, 1e3)
    found = case.solve(errors, usable=usable)
    np.testing.assert_allclose(found.step, case.truth, rtol=0, atol=1e-9)
    assert len(found.relative) == np.count_nonzero(usable)


def test_a_stripe_with_two_blocks_stays_where_it_is():
    """The others say all the rest. With a third block it moves."""
    case = Case(n_stripes=3)
    usable = np.ones(case.shape, bool)
    usable[:, 2] = False
    usable[0, 2, :2] = True
    own = [N_POSE + 2, N_POSE + 3 + 2]  # middle and width of the third stripe
    found = case.solve(usable=usable)
    np.testing.assert_array_equal(found.step[own], 0.0)
    assert not set(own) & set(found.free)
    others = np.setdiff1d(case.free, own)
    np.testing.assert_allclose(found.step[others], case.truth[others], rtol=0, atol=1e-9)
    usable[1, 2, 7] = True
    np.testing.assert_allclose(case.solve(usable=usable).step, case.truth, rtol=0, atol=1e-9)


# --- outliers ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_fifth_of_outliers_changes_nothing(seed):
    case = Case(seed=seed)
    errors = case.noise()
    outliers = case.rng.random(case.shape) < 0.2
    errors[outliers] += case.rng.choice([-1.0, 1.0], (outliers.sum(), 3)) * 40.0
    found = case.solve(errors, reweightings=20)
    without = case.solve(errors, reweightings=20, usable=~outliers)
    assert len(found.relative) <= np.count_nonzero(~outliers)
    off = found.step - case.truth
    std = np.sqrt(np.diag(found.covariance(VARIANCE)))[case.free]
    assert np.all(np.abs(off[case.free]) < 4.5 * std)
    # They are left out; what the scale makes of them is less than the noise.
    assert np.all(np.abs(found.step - without.step)[case.free] < std)


def test_a_camera_that_fits_worse_weighs_less_and_is_no_outlier():
    """Deviances of 9 times the noise: the other camera decides, and no block of this one is left out."""
    case = Case(n_blocks=200)
    errors = case.noise()
    errors[1] *= 3.0
    found = case.solve(errors)
    assert found.scale == pytest.approx((1.0 + 9.0) / 2.0, rel=0.15)
    assert len(found.relative) > 0.99 * np.prod(case.shape)
    weights = np.ones(case.shape)
    weights[1] /= 9.0
    expected, covariance = case.least_squares(case.design() @ case.truth + errors, weights)
    np.testing.assert_array_less(np.abs(found.step[case.free] - expected), 0.5 * np.sqrt(np.diag(covariance)))


# --- what it claims ------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_errors_are_as_great_as_the_covariance_says(scale):
    """Also where the blocks are worse than the noise explains: their scatter counts."""
    case = Case(n_blocks=40)
    off, claimed = [], []
    for _ in range(200):
        found = case.solve(case.noise(scale))
        off.append((found.step - case.truth)[case.free])
        claimed.append(found.covariance(VARIANCE)[np.ix_(case.free, case.free)])
    whitened = [d @ np.linalg.solve(c, d) for d, c in zip(off, claimed, strict=True)]
    # The mean of 200 chi-squared values of 10 degrees of freedom scatters by 3 %; the biweight, and its
    # covariance, of 160 blocks by a few more.
    assert np.mean(whitened) == pytest.approx(len(case.free), rel=0.15)


@pytest.mark.parametrize("relative", [[0.0, 0.05, 0.1, 0.2], [0.01], [0.1, 0.3, 0.02]])
def test_covariance_is_that_of_an_m_estimator(relative):
    """E[w^2 d] / 3 over the square of E[w + 2 w' d / 3], with the weight w of a deviance d as defined."""
    relative = np.array(relative)

    def weight(deviance):
        return (1.0 - deviance / CUT) ** 2

    deviance = relative * CUT
    slope = (weight(deviance + 1e-5) - weight(deviance - 1e-5)) / 2e-5
    scatter = np.mean(weight(deviance) ** 2 * deviance) / 3.0
    steepness = np.mean(weight(deviance) + 2.0 / 3.0 * slope * deviance)
    information = np.array([[4.0, 1.0], [1.0, 2.0]])
    step = Step(np.zeros(3), np.array([0, 2]), information, relative, 1.0)
    expected = np.zeros((3, 3))
    expected[np.ix_([0, 2], [0, 2])] = np.linalg.inv(information) * scatter / steepness**2 * VARIANCE
    np.testing.assert_allclose(step.covariance(VARIANCE), expected, rtol=1e-6)


def test_blocks_about_to_be_dropped_say_nothing():
    step = Step(np.zeros(2), np.arange(2), np.eye(2), np.full(20, 0.9), 1.0)
    assert gave_up(step.covariance(1.0))


# --- heights beside the lane ---------------------------------------------------------------------------


def test_a_height_that_nothing_shows_goes_back_to_the_road():
    case = Case(n_stripes=3, free_heights=[(2, 0.02)])
    height = case.n - 1
    case.by_road[height] = 0.0
    case.truth[height] = 0.0
    found = solve_step(case.blocks(), case.by_road, REWEIGHTINGS, case.known([0.0, 0.0, 0.05]))
    assert found.step[height] == pytest.approx(-0.05, abs=1e-9)
    # Deviances of zero: this is about the step. Its information is that of the road's flatness alone.
    place = list(found.free).index(height)
    assert found.information[place, place] == pytest.approx(VARIANCE / 0.02**2)


def test_a_height_is_weighed_against_the_flatness_of_the_road():
    """Of equal information both ways, it ends half way between what is seen and the road."""
    case = Case(n_stripes=3, free_heights=[(2, 1.0)])
    height = case.n - 1
    free = list(case.free)
    _, covariance = case.least_squares(np.zeros((*case.shape, 3)), np.ones(case.shape))
    case.height_stds_m[2] = np.sqrt(covariance[free.index(height), free.index(height)])
    case.truth[:] = 0.0
    case.truth[height] = 0.03
    found = solve_step(case.blocks(), case.by_road, 1, case.known([0.0, 0.0, 0.01]))
    # It is at 0.01 + 0.03 by what is seen, at 0 by the road.
    assert 0.01 + found.step[height] == pytest.approx(0.02, abs=1e-9)


# --- where it gives up ---------------------------------------------------------------------------------


def test_too_few_blocks_are_no_step():
    case = Case(n_blocks=10)
    usable = np.zeros(case.shape, bool)
    usable[:, :, : MIN_BLOCKS // 4] = True
    assert not gave_up(case.solve(usable=usable))
    usable[0, 0, 0] = False
    assert gave_up(case.solve(usable=usable))


def test_one_stripe_is_no_step():
    """However much is seen of it."""
    case = Case(n_stripes=3)
    usable = np.ones(case.shape, bool)
    usable[:, 1] = usable[:, 2] = False
    usable[:, 1, 0] = True  # two blocks
    assert gave_up(case.solve(usable=usable))
    usable[0, 1, 1] = True
    assert not gave_up(case.solve(usable=usable))


def test_parameters_that_nothing_tells_apart_are_no_step():
    case = Case()
    case.by_road[1] = case.by_road[0]
    assert gave_up(case.solve())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_derivative_that_is_no_number_is_no_step(value):
    case = Case()
    case.by_road[0, 0, 0, 0, 0] = value
    with np.errstate(invalid="ignore"):
        blocks = make_blocks(np.zeros((*case.shape, 3)), case.information, VARIANCE)
        assert gave_up(solve_step(blocks, case.by_road, REWEIGHTINGS, case.known()))


def test_blocks_that_all_contradict_the_road_are_still_weighed_by_their_own_scatter():
    """No block fits within the noise: the scale grows with them, and their covariance says how badly."""
    case = Case()
    found = case.solve(case.noise(100.0))
    assert found.scale == pytest.approx(1e4, rel=0.5)
    std = np.sqrt(np.diag(found.covariance(VARIANCE)))[case.free]
    calm = np.sqrt(np.diag(case.solve(case.noise()).covariance(VARIANCE)))[case.free]
    np.testing.assert_allclose(std / calm, 100.0, rtol=0.5)
