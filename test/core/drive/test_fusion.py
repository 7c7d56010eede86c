"""Fusion: the weighted mean in closed form, frames set aside, and scatter beyond what was promised."""

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.drive.fusion import fuse, fuse_frames
from stereo_selfcal.synth.scenes import PAPER_RIG

STD = np.array([2e-3, 1e-4, 1e-3])
TRUTH = np.array([1.4, 0.05, 0.01])


def covariances(n, factors=1.0):
    return np.diag(STD**2) * (np.ones(n) * factors)[:, None, None] ** 2


def draws(n, seed=0):
    return TRUTH + np.random.default_rng(seed).standard_normal((n, 3)) * STD


def test_one_frame_is_itself():
    covariance = covariances(1)
    mean, fused, used = fuse(TRUTH[None], covariance)
    np.testing.assert_allclose(mean, TRUTH)
    np.testing.assert_allclose(fused, covariance[0])
    assert used.tolist() == [True]


def test_equal_frames_give_their_mean_and_a_smaller_covariance():
    estimates = np.tile(TRUTH, (9, 1))
    mean, fused, used = fuse(estimates, covariances(9))
    np.testing.assert_allclose(mean, TRUTH)
    np.testing.assert_allclose(np.sqrt(np.diag(fused)), STD / 3)
    assert used.all()


def test_two_frames_are_weighted_by_their_information():
    estimates = np.array([TRUTH, TRUTH + STD])
    mean, _, _ = fuse(estimates, covariances(2, [1.0, 2.0]))
    # Weights 1 and 1/4.
    np.testing.assert_allclose(mean, TRUTH + STD / 5)


def test_correlated_frames_are_combined_as_matrices():
    rng = np.random.default_rng(3)
    roots = rng.standard_normal((3, 3, 3)) * STD[:, None]
    full = np.einsum("nij,nkj->nik", roots, roots)
    estimates = np.array([TRUTH + root @ (0.5, -0.3, 0.2) for root in roots])
    mean, _, _ = fuse(estimates, full)
    inverses = [np.linalg.inv(c) for c in full]
    expected = np.linalg.solve(sum(inverses), sum(i @ e for i, e in zip(inverses, estimates, strict=True)))
    np.testing.assert_allclose(mean, expected)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_outlier_in_any_value_is_set_aside(axis, sign):
    estimates = draws(9)
    estimates[4, axis] += sign * 20 * STD[axis]
    mean, _, used = fuse(estimates, covariances(9))
    assert used.tolist() == [i != 4 for i in range(9)]
    np.testing.assert_allclose(mean, np.delete(estimates, 4, axis=0).mean(axis=0))


def test_deviations_within_four_sigma_are_kept():
    """The scale is the larger of promise and scatter: frames that happen to agree set nothing aside."""
    estimates = np.tile(TRUTH, (9, 1))
    estimates[4] += 3.9 * STD
    assert fuse(estimates, covariances(9))[2].all()
    estimates[4] += 0.2 * STD
    assert not fuse(estimates, covariances(9))[2][4]


def test_three_frames_are_too_few_for_an_outlier():
    estimates = draws(3)
    estimates[0] += 50 * STD
    assert fuse(estimates, covariances(3))[2].all()


def test_scatter_as_promised_leaves_the_covariance():
    """Birge's ratio is at most 1 here, and it only ever enlarges."""
    formal = STD / np.sqrt(100)
    std = np.sqrt(np.diag(fuse(draws(100), covariances(100))[1]))
    # chi2 / freedom of 100 draws is 1 to 8 %; its root to 4 %: three of them.
    assert np.all((std >= formal * (1 - 1e-9)) & (std < 1.12 * formal))


def test_more_scatter_than_promised_enlarges_the_covariance():
    std = np.sqrt(np.diag(fuse(TRUTH + 3 * (draws(100) - TRUTH), covariances(100))[1]))
    np.testing.assert_allclose(std, 3 * STD / 10, rtol=0.12)


def test_covariance_is_symmetric():
    _, covariance, _ = fuse(draws(10), covariances(10))
    np.testing.assert_array_equal(covariance, covariance.T)


def test_frames_that_are_all_outliers_in_another_value_are_all_used():
    """Two of six frames are off in each value: each frame alone would be set aside, and nothing left."""
    estimates = np.tile(TRUTH, (6, 1))
    for axis in range(3):
        estimates[2 * axis : 2 * axis + 2, axis] += 100 * STD[axis]
    mean, covariance, used = fuse(estimates, covariances(6))
    assert used.all()
    np.testing.assert_allclose(mean, estimates.mean(axis=0))
    assert np.all(np.sqrt(np.diag(covariance)) > 10 * STD / np.sqrt(6))


def test_what_frames_of_a_drive_have_in_common_does_not_average_out():
    """A tenth of the variance of one: texture and ragged paint are the same in all."""
    covariance = np.diag(STD**2)
    pose = Extrinsics.from_array(TRUTH)
    frames = [
        CalibrationResult("", extrinsics=pose, covariance=covariance, stamp_s=float(i), n_frames=1)
        for i in range(400)
    ]
    fused = fuse_frames(frames, PAPER_RIG)
    np.testing.assert_allclose(fused.covariance, covariance * (0.1 + 1.0 / 400), rtol=1e-9, atol=1e-15)
    # What the motion of the car repeats is inflated; what is shared is so once.
    inflated = fuse_frames(frames, PAPER_RIG, np.zeros((3, 3)), inflation=8.0)
    np.testing.assert_allclose(inflated.covariance, covariance * (0.1 + 8.0 / 400), rtol=1e-9, atol=1e-15)
