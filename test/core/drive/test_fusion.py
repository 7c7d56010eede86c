"""Fusion: the weighted mean in closed form, frames set aside, and scatter beyond what was promised."""

import numpy as np
import pytest

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.drive.fusion import fuse, fuse_frames, own_covariance
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
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


def with_rig(pose, own, rig_part, stamp_s=0.0):
    """Return a frame whose terms are noise and what a turn of the right camera does."""
    terms = (UncertaintyTerm("noise", own), UncertaintyTerm("vergence", rig_part))
    return CalibrationResult(
        "",
        extrinsics=Extrinsics.from_array(pose),
        covariance=own + rig_part,
        uncertainty=terms,
        stamp_s=stamp_s,
        n_frames=1,
    )


TURN = np.outer([4e-3, -5e-4, 0.0], [4e-3, -5e-4, 0.0])  # twice and five times the noise


def test_unknowns_of_the_rig_are_in_the_mean_once():
    """They are the same in all frames: neither averaged out, nor added a second time."""
    own = np.diag(STD**2)
    fused = fuse_frames([with_rig(TRUTH, own, TURN, float(i)) for i in range(400)], PAPER_RIG)
    by_name = {term.name: term.covariance for term in fused.uncertainty}
    np.testing.assert_allclose(by_name["vergence"], TURN, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(fused.covariance, own * (0.1 + 1.0 / 400) + TURN, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(own_covariance(fused), fused.covariance - TURN, rtol=1e-9, atol=1e-15)


def test_scatter_is_judged_without_the_unknowns_of_the_rig():
    """Frames scatter by three times their noise, and by less than their whole covariance."""
    own, poses = np.diag(STD**2), TRUTH + 3 * (draws(100) - TRUTH)
    part = np.diag((20.0 * STD) ** 2)
    fused = fuse_frames([with_rig(pose, own, part, float(i)) for i, pose in enumerate(poses)], PAPER_RIG)
    by_name = {term.name: term.covariance for term in fused.uncertainty}
    scattered = np.sqrt(np.diag(by_name["noise"] + by_name["scatter"]))
    np.testing.assert_allclose(scattered, 3 * STD / 10, rtol=0.12)


def test_frames_are_weighted_without_the_unknowns_of_the_rig():
    """The mean is that of the noise; of two frames, the term of the rig is that of a mean frame."""
    own = covariances(2, [1.0, 2.0])
    frames = [with_rig(TRUTH, own[0], 4.0 * TURN), with_rig(TRUTH + STD, own[1], TURN)]
    fused = fuse_frames(frames, PAPER_RIG)
    np.testing.assert_allclose(fused.extrinsics.as_array(), TRUTH + STD / 5)  # weights 1 and 1/4
    by_name = {term.name: term.covariance for term in fused.uncertainty}
    np.testing.assert_allclose(by_name["vergence"], TURN * (0.8 * 4.0 + 0.2), rtol=1e-9)


@pytest.mark.parametrize("confirmed", [True, False])
def test_frames_from_a_file_without_terms_are_fused_too(confirmed):
    """Such files hold no unknowns of the rig: those of the surface are added where it was seen."""
    frame = CalibrationResult(
        "",
        extrinsics=Extrinsics.from_array(TRUTH),
        covariance=np.diag(STD**2),
        n_frames=1,
        confirmed_by_texture=confirmed,
    )
    fused = fuse_frames([frame, frame], PAPER_RIG)
    np.testing.assert_allclose(own_covariance(fused), np.diag(STD**2) * 0.6, rtol=1e-9, atol=1e-15)
    names = {term.name for term in fused.uncertainty}
    assert ({"vergence", "rectification"} <= names) == confirmed


def test_a_frame_that_was_refused_has_no_covariance():
    with pytest.raises(ValueError, match="accepted"):
        own_covariance(CalibrationResult("refused"))
