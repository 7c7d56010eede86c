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

"""The mean of a drive: its error against its standard deviation, what averages out, and what does not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.drive.fusion import frame_series, fuse_frames, own_covariance, scatter_variances
from stereo_selfcal.core.geometry.uncertainty import TERMS, UncertaintyTerm, total_covariance
from stereo_selfcal.synth.scenes import PAPER_RIG

TRUTH = np.array([1.4, 0.05, 0.01])
NOISE = np.array([1.6e-3, math.radians(0.02), math.radians(0.03)])
MOTION = np.array([0.005, math.radians(0.15), math.radians(0.2)])
TURN = np.outer([4e-3, -5e-4, 0.0], [4e-3, -5e-4, 0.0])


def frame(pose=TRUTH, stamp_s=0.0, terms=None, **fields):
    """Return an accepted frame; its terms are given by name as standard deviations (3,) or covariances."""
    terms = {"noise": NOISE} if terms is None else terms
    parts = tuple(
        UncertaintyTerm(name, np.diag(each**2) if each.ndim == 1 else each) for name, each in terms.items()
    )
    return CalibrationResult(
        "",
        extrinsics=Extrinsics.from_array(pose),
        covariance=total_covariance(parts),
        uncertainty=parts,
        stamp_s=stamp_s,
        n_frames=1,
        **fields,
    )


def fuse(frames):
    """Return the mount; its terms add up to its covariance, which is one."""
    fused = fuse_frames(frames, PAPER_RIG)
    np.testing.assert_allclose(total_covariance(fused.uncertainty), fused.covariance, rtol=1e-12, atol=1e-24)
    np.testing.assert_array_equal(fused.covariance, fused.covariance.T)
    assert np.all(np.linalg.eigvalsh(fused.covariance) > 0.0)
    names = [each.name for each in fused.uncertainty]
    assert len(set(names)) == len(names) and set(names) <= set(TERMS)
    return fused


def std_of(fused, name=None):
    if name is None:
        return fused.std.as_array()
    return np.sqrt(sum(term.covariance.diagonal() for term in fused.uncertainty if term.name == name))


def drive(seed, n=24, step_s=0.5, memory_s=1.5, motion=MOTION, start_s=100.0, **fields):
    rng = np.random.default_rng(seed)
    keep = math.exp(-step_s / memory_s)
    now, frames = rng.normal(size=3), []
    for i in range(n):
        pose = TRUTH + now * motion + rng.normal(size=3) * NOISE
        frames.append(frame(pose, start_s + step_s * i, **fields))
        now = keep * now + math.sqrt(1.0 - keep**2) * rng.normal(size=3)
    return frames


def stop(n, step_s=0.5, seed=0, start_s=0.0, terms=None):
    """Return frames of a car that stands; the first one does not know it yet."""
    rng = np.random.default_rng(seed)
    return [
        frame(TRUTH + rng.normal(size=3) * NOISE, start_s + step_s * i, terms, stood=i > 0) for i in range(n)
    ]


# --- one frame, two frames ------------------------------------------------------------------------------


def test_one_frame_of_a_moving_car_has_the_usual_motion():
    one = frame()
    fused = fuse([one])
    np.testing.assert_array_equal(fused.extrinsics.as_array(), TRUTH)
    # Brakes pitch a car by tenths of a degree; nobody knows at which moment the frame was taken.
    assert 0.15 < math.degrees(fused.std.pitch_rad) < 0.35
    assert 0.2 < math.degrees(fused.std.roll_rad) < 0.45
    assert 0.005 < fused.std.height_m < 0.012
    np.testing.assert_allclose(std_of(fused, "noise"), NOISE)
    known = NOISE**2 + std_of(fused, "motion") ** 2 + std_of(fused, "lean") ** 2
    np.testing.assert_allclose(std_of(fused) ** 2, known)
    assert (fused.n_frames, fused.mount.n_outliers, fused.mount.duration_s) == (1, 0, 0.0)
    assert not fused.mount.stood
    np.testing.assert_allclose(fused.mount.looks, 1.0)
    assert fused.message.startswith("calibrated from 1 frame: height 1.4000 m (std ")


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_second_frame_never_makes_it_worse_where_both_agree(seed):
    """Whatever terms they have; one of them may be much worse than the other one, in some or in all."""
    rng = np.random.default_rng(seed)
    names = ["noise", "misfit", "roughness", "kerb", "vergence", "slope_unseen", "synchronisation"]

    def terms(factor):
        return {name: factor * rng.uniform(0.05, 2.0, 3) * MOTION for name in names if rng.random() < 0.7}

    shared = {"noise": NOISE}
    first = frame(TRUTH, 100.0, shared | terms(1.0))
    worse = 10.0 ** rng.uniform(-1.0, 1.5)
    second = frame(TRUTH, 100.0 + 10.0 ** rng.uniform(-2.0, 2.0), shared | terms(worse))
    both = std_of(fuse([first, second]))
    assert np.all(both <= np.minimum(std_of(fuse([first])), std_of(fuse([second]))) * (1.0 + 1e-6))


def test_two_noisy_frames_that_differ_by_their_noise_are_no_worse_than_one():
    """Of 1.6 mm and 0.054 deg each, as with 10 % of noise: what two frames scatter by is chance."""
    noise = np.array([1.6e-3, math.radians(0.054), math.radians(0.3)])
    for seed in range(10):
        poses = TRUTH + np.random.default_rng(seed).normal(size=(2, 3)) * noise
        frames = [frame(pose, 0.2 * i, {"noise": noise}) for i, pose in enumerate(poses)]
        both = fuse(frames)
        assert np.all(std_of(both, "noise") <= noise / math.sqrt(2.0) * (1.0 + 1e-2))
        # Two frames tell hardly anything of the motion: what they show moves its size by a little.
        assert np.all(std_of(both) < 1.15 * std_of(fuse(frames[:1])))


def test_one_much_worse_frame_does_no_harm():
    good = drive(1, n=12)
    alone = fuse(good)
    bad = frame(TRUTH + MOTION, good[-1].stamp_s + 0.5, {"noise": 30.0 * NOISE, "kerb": 30.0 * MOTION})
    both = fuse([*good, bad])
    assert both.n_frames == 13
    assert np.all(std_of(both) < 1.03 * std_of(alone))
    assert np.all(std_of(both, "kerb") < 0.05 * std_of(alone))
    np.testing.assert_allclose(
        both.extrinsics.as_array(), alone.extrinsics.as_array(), atol=0.1 * std_of(alone).min()
    )


# --- a drive ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "step_s"), [(12, 0.2), (40, 0.5)])
def test_errors_of_short_drives_are_as_large_as_said(n, step_s):
    """60 drives of three numbers tell the ratio to 6 %; the prior holds wilder rides than these."""
    ratios = []
    for seed in range(60):
        fused = fuse(drive(seed, n, step_s))
        ratios.append((fused.extrinsics.as_array() - TRUTH) / std_of(fused))
    assert 0.6 < math.sqrt(np.mean(np.square(ratios))) < 1.25


def test_motion_averages_out_over_moments_and_not_over_frames():
    """Twenty seconds at 2 or at 10 frames a second are as many moments; 200 s are ten times as many."""

    def left(n, step_s):
        """Return the geometric mean over drives, which differ in what they show of their motion."""
        return np.exp(
            np.mean([np.log(std_of(fuse(drive(i, n, step_s)), "motion")) for i in range(8)], axis=0)
        )

    slow = left(40, 0.5)
    np.testing.assert_allclose(left(200, 0.1), slow, rtol=0.35)
    np.testing.assert_allclose(left(400, 0.5), slow / math.sqrt(10.0), rtol=0.35)


def test_the_order_of_the_frames_does_not_matter():
    frames = drive(3, 20)
    shuffled = [frames[i] for i in np.random.default_rng(0).permutation(20)]
    there, back = fuse(frames), fuse(shuffled)
    np.testing.assert_array_equal(there.extrinsics.as_array(), back.extrinsics.as_array())
    np.testing.assert_array_equal(there.covariance, back.covariance)
    assert there.message == back.message


def test_what_is_said_of_a_drive():
    frames = drive(4, 31, step_s=0.16)
    frames[7] = replace(frames[7], extrinsics=Extrinsics.from_array(TRUTH + 30.0 * MOTION))
    frames[9] = replace(frames[9], known_start=True)
    fused = fuse(frames)
    assert (fused.n_frames, fused.stamp_s) == (30, frames[-1].stamp_s)
    assert (fused.mount.n_outliers, fused.mount.n_known) == (1, 1)
    assert fused.mount.duration_s == pytest.approx(4.8)
    assert fused.message.startswith(
        "calibrated from 30 frames in 4.8 s (1 more set aside as outliers): height "
    )
    assert np.all(fused.mount.motion.as_array() > 0.3 * MOTION)
    assert np.all(fused.mount.looks >= 1.0)


def test_a_thousand_times_the_same_frame_is_one():
    """A recording that was appended to itself: stamps are there twice, and halve nothing."""
    frames = drive(5, 20)
    once, twice = fuse(frames), fuse(frames + frames)
    np.testing.assert_allclose(std_of(twice, "motion"), std_of(once, "motion"), rtol=0.1)
    np.testing.assert_allclose(twice.extrinsics.as_array(), once.extrinsics.as_array(), atol=1e-4)
    many = fuse([frames[0]] * 1000)
    assert np.all(std_of(many, "motion") > 0.3 * MOTION)
    assert np.all(np.isfinite(many.covariance))


def test_hours_of_frames_are_a_mean_too():
    fused = fuse(drive(6, 3000, step_s=1.0))
    assert fused.n_frames > 2970
    assert np.all(np.abs(fused.extrinsics.as_array() - TRUTH) < 4.0 * std_of(fused))
    np.testing.assert_allclose(fused.mount.motion.as_array(), MOTION, rtol=0.15)


# --- outliers --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_outlier_in_any_value_is_set_aside(axis, sign):
    frames = drive(7, 20)
    pose = TRUTH + sign * 15.0 * MOTION * np.eye(3)[axis]
    wild = [*frames[:9], replace(frames[9], extrinsics=Extrinsics.from_array(pose)), *frames[10:]]
    fused, expected = fuse(wild), fuse(frames[:9] + frames[10:])
    assert fused.n_frames == 19
    np.testing.assert_allclose(fused.extrinsics.as_array(), expected.extrinsics.as_array(), atol=1e-9)
    np.testing.assert_allclose(fused.covariance, expected.covariance, rtol=1e-6, atol=1e-18)


def test_unknowns_of_the_rig_hide_no_outlier():
    """They are the same in all frames, however large they are."""
    terms = {"noise": NOISE, "vergence": 30.0 * MOTION}
    frames = drive(8, 30, terms=terms)
    pose = TRUTH + 8.0 * MOTION
    frames[12] = frame(pose, frames[12].stamp_s, terms)
    plain = [replace(each, uncertainty=each.uncertainty[:1], covariance=np.diag(NOISE**2)) for each in frames]
    with_rig, without = fuse(frames), fuse(plain)
    assert with_rig.mount.n_outliers == without.mount.n_outliers >= 1
    np.testing.assert_allclose(
        with_rig.extrinsics.as_array(), without.extrinsics.as_array(), rtol=1e-9, atol=1e-12
    )


def test_where_each_frame_is_far_from_the_others_all_are_used():
    """Two of six frames are off in each value: each frame alone would be set aside, and nothing left."""
    poses = np.tile(TRUTH, (6, 1))
    for axis in range(3):
        poses[2 * axis : 2 * axis + 2, axis] += 30.0 * MOTION[axis]
    fused = fuse([frame(pose, 0.5 * i) for i, pose in enumerate(poses)])
    assert fused.n_frames >= 1
    assert np.all(std_of(fused) > 2.0 * MOTION)


# --- terms -----------------------------------------------------------------------------------------------


def test_unknowns_of_the_rig_are_in_the_mean_once():
    """They are the same in all frames: neither averaged out, nor added a second time."""
    plain = fuse(drive(9, 50))
    with_rig = fuse(drive(9, 50, terms={"noise": NOISE, "vergence": TURN}))
    (of_rig,) = (term.covariance for term in with_rig.uncertainty if term.name == "vergence")
    # Weights of height and pitch differ a little, and so does what they have in common.
    np.testing.assert_allclose(np.diag(of_rig), np.diag(TURN), rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(of_rig, TURN, rtol=0.02, atol=1e-18)
    np.testing.assert_allclose(with_rig.covariance, plain.covariance + of_rig, rtol=1e-7, atol=1e-15)
    np.testing.assert_allclose(own_covariance(with_rig), plain.covariance, rtol=1e-7, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("noise", 0.0, 0.15),  # the pixels of each frame are new
        ("mismatch", 0.0, 0.15),
        ("camber", 1.0, 1.0),  # the cross-section of a road stays the same for minutes
        ("kerb", 1.0, 1.0),
        ("roughness", 0.1, 0.5),  # its profile is another one after some seconds
        ("part_of_road", 0.7, 0.8),  # by both
        ("rectification", 1.0, 1.0),  # the lenses for ever
        ("synchronisation", 1.0, 1.0),
    ],
)
def test_what_is_left_of_a_term_after_a_minute_is_what_lasts(name, least, most):
    # As large as the noise, so that the frames scatter by no more than they may.
    frames = drive(10, 100, step_s=1.0, terms={"noise": NOISE} | {name: NOISE})
    left = std_of(fuse(frames), name) / NOISE
    assert np.all(left >= least - 1e-9) and np.all(left <= most + 1e-9)


def test_frames_from_a_known_start_look_at_the_same_pixels_in_part():
    """Cold frames are independent; a chain of known ones keeps half of the variance of its cold start."""
    cold = drive(11, 40)
    chain = [replace(each, known_start=i > 0) for i, each in enumerate(cold)]
    some = [replace(each, known_start=i % 8 > 0) for i, each in enumerate(cold)]
    of_cold, of_some, of_chain = (std_of(fuse(each), "noise") for each in (cold, some, chain))
    assert np.all(of_cold < 0.25 * NOISE)
    assert np.all(of_cold < of_some) and np.all(of_some < of_chain)
    np.testing.assert_allclose(of_chain, NOISE * math.sqrt(0.5 * (1.0 + 1.0 / 40)), rtol=0.02)


@pytest.mark.parametrize("confirmed", [True, False])
def test_frames_from_a_file_without_terms_are_fused_too(confirmed):
    """Such files hold no unknowns of the rig: those of the surface are added where it was seen."""
    one = replace(frame(), uncertainty=(), confirmed_by_texture=confirmed)
    fused = fuse([one, replace(one, stamp_s=10.0)])
    np.testing.assert_allclose(std_of(fused, "noise"), NOISE / math.sqrt(2.0), rtol=1e-6)
    names = {term.name for term in fused.uncertainty}
    assert ({"vergence", "rectification"} <= names) == confirmed


def test_a_frame_that_was_refused_has_no_covariance():
    with pytest.raises(ValueError, match="accepted"):
        own_covariance(CalibrationResult("refused"))


def test_frames_scatter_by_what_is_new_in_them():
    parts = {"noise": 1.0, "misfit": 1.0, "roughness": 1.0, "part_of_road": 0.5, "camber": 0.0}
    one = frame(terms=dict.fromkeys(parts, NOISE) | {"vergence": 10.0 * NOISE})
    np.testing.assert_allclose(scatter_variances(one), sum(parts.values()) * NOISE**2)
    np.testing.assert_allclose(own_covariance(one), np.diag(len(parts) * NOISE**2))
    series = frame_series([one, replace(one, stamp_s=1.0, stood=True)])
    assert (series.stood.tolist(), series.used.tolist()) == ([False, True], [True, True])


# --- standing --------------------------------------------------------------------------------------------


def test_a_standing_car_is_one_view_of_one_road():
    terms = {"noise": NOISE, "misfit": NOISE, "roughness": NOISE}
    few, many = fuse(stop(4, terms=terms)), fuse(stop(120, terms=terms))
    for each in (few, many):
        assert each.mount.stood and std_of(each, "motion").max() == 0.0
        np.testing.assert_allclose(each.mount.looks, 1.0)
        # Texture and unevenness are the same in all frames; where it stands is as uneven as roads are.
        np.testing.assert_allclose(std_of(each, "misfit"), NOISE, rtol=1e-6)
        np.testing.assert_allclose(std_of(each, "roughness"), NOISE, rtol=1e-6)
        assert 0.001 < std_of(each, "standing")[0] < 0.005
        assert np.all(np.degrees(std_of(each, "standing")[1:]) > 0.05)
        assert np.all(np.degrees(std_of(each, "standing")[1:]) < 0.15)
    np.testing.assert_allclose(std_of(few, "standing"), std_of(many, "standing"))
    np.testing.assert_allclose(std_of(many, "noise"), NOISE / math.sqrt(120), rtol=0.05)
    assert "calibrated from 120 frames in 59.5 s of a standing car: height" in many.message
    # Better than a moment of a moving car, whose springs are not at rest.
    assert np.all(std_of(many) < std_of(fuse([frame(terms=terms)])))


def test_an_outlier_within_a_stop_does_not_end_it():
    frames = stop(20)
    frames[8] = replace(frames[8], extrinsics=Extrinsics.from_array(TRUTH + 20.0 * MOTION))
    fused = fuse(frames)
    assert (fused.n_frames, fused.mount.n_outliers, fused.mount.stood) == (19, 1, True)
    assert std_of(fused, "motion").max() == 0.0


def test_a_stop_within_a_drive_is_one_moment_of_it():
    before, after = drive(12, 30), drive(13, 30, start_s=200.0)
    waited = stop(120, start_s=120.0)
    alone, with_stop = fuse(before + after), fuse(before + waited + after)
    assert not with_stop.mount.stood and std_of(with_stop, "standing").max() == 0.0
    assert with_stop.n_frames >= 174
    # Another place to look from makes it better, by no more than a place does.
    assert np.all(std_of(with_stop, "motion") < 1.05 * std_of(alone, "motion"))
    assert np.all(std_of(with_stop, "motion") > 0.5 * std_of(alone, "motion"))
    short = fuse(before + stop(4, start_s=120.0) + after)
    np.testing.assert_allclose(std_of(short, "motion"), std_of(with_stop, "motion"), rtol=0.25)


@pytest.mark.parametrize("apart_deg", [0.3, 1.0, 3.0])
def test_frames_of_a_stop_that_scatter_more_than_they_say_make_it_less_sure(apart_deg):
    """The motion of a standing car explains nothing: the noise of its frames is more than they say."""
    one = frame(TRUTH, 0.0)
    other = frame(TRUTH + np.radians([0.0, apart_deg, 0.0]), 1.0, stood=True)
    alike, apart = fuse([one, replace(one, stamp_s=1.0, stood=True)]), fuse([one, other])
    assert apart.mount.stood and std_of(alike, "scatter").max() == 0.0
    assert abs(apart.extrinsics.pitch_rad - TRUTH[1]) < 2.5 * apart.std.pitch_rad
    assert apart.std.height_m == pytest.approx(alike.std.height_m, rel=0.01)


def test_frames_of_which_most_would_be_outliers_are_all_used():
    rng = np.random.default_rng(0)
    frames = [
        frame(TRUTH + rng.normal(size=3) * [0.0, math.radians(3.0), 0.0], 1.0 * i, stood=i > 0)
        for i in range(50)
    ]
    fused = fuse(frames)
    assert fused.n_frames > 25
    assert abs(fused.extrinsics.pitch_rad - TRUTH[1]) < 3.0 * fused.std.pitch_rad
