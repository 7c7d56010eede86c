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

"""The calibrator as a whole: accuracy over random roads, the same bytes again, fusion, and every refusal."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from refusal_words import assert_says_everything

from stereo_selfcal import (
    CalibrationResult,
    Calibrator,
    CalibratorConfig,
    Extrinsics,
    RejectReason,
    StereoRig,
    calibrate,
)
from stereo_selfcal.core.calibrator import NoPattern
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.core.lanes.lane_pair import LanePattern
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import NAMED_SCENES, random_scene
from stereo_selfcal.synth.world import LaneLine, Road

SMALL_RIG = StereoRig(96, 80, 80.0, 80.0, 47.5, 39.5, 0.15)
GREY = np.full((480, 640), 90, np.uint8)

# Largest error of one frame: height [m], pitch [rad], roll [rad]. Four times what issue 2 asks for the RMS
# at 0, 5 and 10 %, and twice the 10 % figures at 20 %: here what is broken is to be found, and what has
# become worse in the benchmarks.
LIMITS = {
    0.0: (0.012, math.radians(0.04), math.radians(0.4)),
    0.05: (0.020, math.radians(0.08), math.radians(0.8)),
    0.10: (0.040, math.radians(0.12), math.radians(1.6)),
    0.20: (0.080, math.radians(0.24), math.radians(3.2)),
}


def rendered_as(scene, **changes):
    return render(replace(scene, **changes), np.random.default_rng(0))


def configured(**settings_):
    return CalibratorConfig.from_mapping({name.replace("__", "."): v for name, v in settings_.items()})


def assert_refused(result, reason, *words):
    """Check the whole of a refusal: its enum, and a sentence with value, threshold, unit and remedy."""
    assert not result.accepted
    assert result.reason is reason, result.message
    assert (result.extrinsics, result.covariance, result.std, result.lane_yaw_rad) == (None,) * 4
    assert result.n_frames == 0
    rejection = result.rejection
    assert_says_everything(rejection)
    assert result.message.endswith(rejection.remedy)
    for word in words:
        assert word in result.message, result.message


AS_IT_IS = configured(alignment__correct="none")


def same_bytes(first, second):
    """Whether two accepted results are the same to the last bit."""
    numbers = [
        np.concatenate([r.extrinsics.as_array(), r.covariance.ravel(), [r.lane_yaw_rad]]).tobytes()
        for r in (first, second)
    ]
    return numbers[0] == numbers[1] and first.message == second.message


@pytest.mark.parametrize("noise", LIMITS)
@pytest.mark.parametrize("seed", range(4))
def test_random_roads(calibrated, seed, noise):
    scene, result = calibrated(seed, noise)
    assert result.accepted, result.message
    error = np.abs(result.extrinsics.as_array() - scene.extrinsics.as_array())
    np.testing.assert_array_less(error, LIMITS[noise])
    # 0.2 degrees: the yaw of the lane is known about as well as the pitch.
    assert result.lane_yaw_rad == pytest.approx(scene.lane_yaw_rad, abs=math.radians(0.2))


@pytest.mark.parametrize("noise", [0.05, 0.10, 0.20])
def test_error_is_what_the_standard_deviation_says(calibrated, noise):
    """RMS of error over standard deviation: 1 if the claim is right; 12 values give it to 20 %.

    That by noise alone: the paint is parallel, and the cameras are those of their calibration. What the
    noise leaves of the comparison of the rows is a part of it.
    """
    ratios = []
    for seed in range(4):
        scene, result = calibrated(seed, noise)
        (of_noise,) = (term.covariance for term in result.uncertainty if term.name == "noise")
        error = result.extrinsics.as_array() - scene.extrinsics.as_array()
        ratios.append(error / np.sqrt(np.diag(of_noise)))
        assert np.all(np.abs(error) < 3.0 * result.std.as_array())
    # Two of these 20 % on the claim, and as much again as the claim itself may be off (test_uncertainty).
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_accepted_result_is_complete(calibrated):
    _, result = calibrated(0, 0.05)
    assert result.reason is None
    assert result.rejection is None
    assert result.n_frames == 1
    assert list(result.stages)[-3:] == ["genetic", "closed_form", "refined"]
    assert result.stages["refined"] == result.extrinsics
    np.testing.assert_array_equal(result.covariance, result.covariance.T)
    assert np.all(np.linalg.eigvalsh(result.covariance) > 0)
    assert isinstance(result.pattern, LanePattern)
    assert result.genetic.converged
    np.testing.assert_array_equal(result.genetic.best, result.stages["genetic"].as_array())
    assert result.message.startswith(
        f"calibrated from 1 frame: height {result.extrinsics.height_m:.4f} m (std "
    )


@pytest.mark.parametrize("name", [scene.name for scene in NAMED_SCENES])
def test_scenes_of_the_bags_give_what_they_are_made_for(name):
    named = next(scene for scene in NAMED_SCENES if scene.name == name)
    _, left, right = named.frame(0)
    result = calibrate(left, right, named.scene.rig)
    assert ("calibrated" if result.accepted else str(result.reason)) == named.expected


def test_same_input_and_seed_same_bytes(rendered, calibrated):
    scene, left, right = rendered(1, 0.05)
    assert same_bytes(calibrate(left.copy(), right.copy(), scene.rig), calibrated(1, 0.05)[1])


def test_result_of_a_frame_does_not_depend_on_what_came_before(rendered, calibrated):
    scene, left, right = rendered(1, 0.05)
    calibrator = Calibrator(scene.rig)
    calibrator.add(*rendered(2, 0.05)[1:])
    calibrator.add(None, None)
    assert same_bytes(calibrator.add(left, right), calibrated(1, 0.05)[1])


def test_seed_of_the_call_replaces_that_of_the_settings(rendered, calibrated):
    scene, left, right = rendered(1, 0.05)
    config = configured(seed=7)
    assert same_bytes(calibrate(left, right, scene.rig, config=config), calibrated(1, 0.05)[1])
    other, by_config = (
        calibrate(left, right, scene.rig, seed=7),
        Calibrator(scene.rig, config).add(left, right),
    )
    assert same_bytes(other, by_config)
    assert other.genetic.history.tobytes() != calibrated(1, 0.05)[1].genetic.history.tobytes()


def poses_of_ten_seeds(scene, left, right):
    return [calibrate(left, right, scene.rig, seed=seed).extrinsics.as_array() for seed in range(10)]


def test_seeds_agree_within_the_papers_variance(rendered):
    """Ten runs on one frame: 1e-2 mm^2, 1e-8 rad^2, 1e-10 rad^2."""
    poses = poses_of_ten_seeds(*rendered(0, 0.05))
    np.testing.assert_array_less(np.var(poses, axis=0, ddof=1), [1e-8, 1e-8, 1e-10])


def test_seeds_agree_where_both_cameras_tempt(rendered):
    """E2 is the smaller of two angles, so each camera has its own optimum: here two nearly as good."""
    poses = poses_of_ten_seeds(*rendered(1, 0.05))
    np.testing.assert_array_less(np.var(poses, axis=0, ddof=1), [1e-8, 1e-8, 1e-10])


def test_images_are_not_changed_and_any_layout_will_do(rendered, calibrated):
    scene, left, right = rendered(1, 0.05)  # read-only
    wide = [np.repeat(image, 2, axis=1)[:, ::2] for image in (left, right)]
    turned = [np.asfortranarray(image) for image in (left, right)]
    upside_down = [image[::-1].copy()[::-1] for image in (left, right)]
    for images in (wide, turned, upside_down):
        assert same_bytes(calibrate(*images, scene.rig), calibrated(1, 0.05)[1])


def frame_of_drive(scene, index, noise=0.05):
    scene = scene.with_noise(noise)
    return render(replace(scene, travelled_m=1.4 * index), np.random.default_rng([5, index]))


@pytest.fixture(scope="module")
def driven(rendered):
    """Return a scene, and the results of six frames of a drive through it, 100 s and more after the start."""
    scene = rendered(1, 0.05)[0]
    calibrator = Calibrator(scene.rig)
    return scene, [calibrator.add(*frame_of_drive(scene, i), 100.0 + i) for i in range(6)]


def test_estimate_before_any_frame():
    estimate = Calibrator(SMALL_RIG).estimate
    assert_refused(
        estimate, RejectReason.NO_FRAMES, "frames: 0, at least 1 needed", "add a stereo frame first"
    )


def test_estimate_is_the_last_refusal_until_a_frame_is_accepted(rendered):
    scene, left, right = rendered(1, 0.05)
    calibrator = Calibrator(scene.rig)
    refused = calibrator.add(GREY, GREY, 1.0)
    assert calibrator.estimate.rejection is refused.rejection
    accepted = calibrator.add(left, right, 2.0)
    mount = calibrator.estimate
    assert mount.extrinsics == accepted.extrinsics
    assert mount.covariance[1, 1] > accepted.covariance[1, 1] + math.radians(0.15) ** 2
    assert not calibrator.add(GREY, GREY, 3.0).accepted
    assert same_bytes(calibrator.estimate, mount)
    assert calibrator.estimate.stamp_s == 2.0


def test_a_moment_is_not_the_mount(calibrated):
    """The result of a frame is the pose then; of the mount, one frame of a moving car tells 0.2 deg."""
    scene, moment = calibrated(1, 0.05)
    calibrator = Calibrator(scene.rig)
    calibrator.remember(moment)
    mount = calibrator.estimate
    assert moment.mount is None and "motion" not in {term.name for term in moment.uncertainty}
    of_motion, of_lean = (term.covariance for term in mount.uncertainty if term.name in ("motion", "lean"))
    std = np.sqrt(np.diag(of_motion))
    assert np.all(std > [0.004, math.radians(0.15), math.radians(0.15)])
    assert np.all(std < [0.012, math.radians(0.3), math.radians(0.45)])
    np.testing.assert_allclose(
        mount.covariance, moment.covariance + of_motion + of_lean, rtol=1e-9, atol=1e-15
    )


def test_two_frames_of_a_noisy_road_are_no_worse_than_one():
    """Apart by their noise: a factor by what two frames scatter would make them worse by twice."""
    named = next(scene for scene in NAMED_SCENES if scene.name == "noisy_10")
    calibrator = Calibrator(named.scene.rig)
    stds = []
    for index in range(2):
        _, left, right = named.frame(index)
        assert calibrator.add(left, right, 0.2 * index).accepted
        stds.append(calibrator.estimate.std.as_array())
    assert np.all(stds[1] < 1.02 * stds[0])


def test_estimate_is_fused_over_the_accepted_frames(driven):
    scene, results = driven
    calibrator, n = Calibrator(scene.rig), len(results)
    for result in results:
        calibrator.remember(result)
    calibrator.add(GREY, GREY, 200.0)
    fused = calibrator.estimate
    assert [result.stamp_s for result in results] == [100.0 + i for i in range(n)]
    assert fused.accepted
    assert fused.n_frames == n
    assert fused.stamp_s == 105.0
    assert fused.message.startswith(f"calibrated from {n} frames in 5.0 s: height ")
    poses = np.array([result.extrinsics.as_array() for result in results])
    assert np.all(fused.extrinsics.as_array() > poses.min(axis=0))
    assert np.all(fused.extrinsics.as_array() < poses.max(axis=0))
    alone = Calibrator(scene.rig)
    alone.remember(results[0])
    assert np.all(fused.std.as_array() < alone.estimate.std.as_array())
    noise = [
        {term.name: np.sqrt(np.diag(term.covariance)) for term in each.uncertainty}["noise"]
        for each in (fused, *results)
    ]
    # By the root of 6, where all count alike.
    assert np.all(noise[0] < 0.6 * np.max(noise[1:], axis=0))
    assert fused.lane_yaw_rad == pytest.approx(np.mean([result.lane_yaw_rad for result in results]))
    assert fused.mount.duration_s == 5.0 and not fused.mount.stood
    np.testing.assert_allclose(fused.stages["refined"].as_array(), poses.mean(axis=0))


def test_a_frame_that_does_not_fit_the_others_is_set_aside(driven):
    scene, results = driven
    calibrator = Calibrator(scene.rig)
    for result in results[:5]:
        calibrator.remember(result)
    other = replace(scene, extrinsics=replace(scene.extrinsics, pitch_rad=scene.extrinsics.pitch_rad + 0.03))
    assert calibrator.add(*frame_of_drive(other, 0)).accepted
    fused = calibrator.estimate
    assert fused.n_frames == 5
    assert "calibrated from 5 frames in 4.0 s (1 more set aside as outliers): " in fused.message
    assert fused.extrinsics.pitch_rad == pytest.approx(scene.extrinsics.pitch_rad, abs=math.radians(0.02))


def test_memory_does_not_grow_by_patterns(rendered):
    """What is remembered of a frame is a few numbers, not the points and lines it was made from."""
    scene, left, right = rendered(1, 0.05)
    calibrator = Calibrator(scene.rig)
    result = calibrator.add(left, right)
    assert result.pattern is not None
    assert calibrator.estimate.pattern is None
    assert calibrator.estimate.genetic is None
    # One frame as it is kept: the terms of its uncertainty and a sentence; the last full result comes on top
    # once.
    first = len(pickle.dumps(calibrator))
    for _ in range(4):
        calibrator.remember(result)
    assert len(pickle.dumps(calibrator)) - first < 4 * 2500


# --- every refusal -----------------------------------------------------------------------------------


def test_refuses_empty_images():
    for pair in ((None, GREY), (GREY, None), (GREY, np.empty((0, 0), np.uint8))):
        result = Calibrator(StereoRig(640, 480, 500, 500, 320, 240, 0.15)).add(*pair, 7.0)
        assert_refused(result, RejectReason.IMAGE_EMPTY, "px")
        assert result.stamp_s == 7.0


def test_refuses_images_of_another_type(rendered):
    scene, left, right = rendered(1, 0.05)
    for image in (right.astype(np.float32), np.dstack([right] * 3), right.tolist()):
        assert_refused(calibrate(left, image, scene.rig), RejectReason.IMAGE_TYPE, "right", "grey")


def test_refuses_images_of_two_sizes(rendered):
    scene, left, right = rendered(1, 0.05)
    result = calibrate(left, right[:, :-1], scene.rig)
    assert_refused(result, RejectReason.IMAGE_SIZES_DIFFER, "640 x 480", "639 x 480")


def test_refuses_images_of_another_size_than_the_rigs(rendered):
    scene, left, right = rendered(1, 0.05)
    result = calibrate(left[::2, ::2], right[::2, ::2], scene.rig)
    assert_refused(result, RejectReason.RIG_SIZE_MISMATCH, "320 x 240", "640 x 480")


@pytest.mark.parametrize("offsets", [(), (1.75,), (-1.75,)])
def test_refuses_a_road_without_two_lines(rendered, offsets):
    scene = rendered(2, 0.01)[0]
    road = Road(lines=tuple(LaneLine(offset) for offset in offsets))
    missing = {(): "no lane line", (1.75,): "no right lane line", (-1.75,): "no left lane line"}[offsets]
    result = calibrate(*rendered_as(scene, road=road), scene.rig)
    assert_refused(result, RejectReason.NO_LINES_FOUND, missing, "at least 40 px")


def test_refuses_one_camera_that_sees_no_lines(rendered):
    scene, left, right = rendered(2, 0.01)
    bare = rendered_as(scene, road=replace(scene.road, lines=()))
    for pair, camera in (((bare[0], right), "left"), ((left, bare[1]), "right")):
        result = calibrate(*pair, scene.rig)
        assert_refused(result, RejectReason.NO_LINES_FOUND, f"lane line was found in the {camera} image")


def test_refuses_a_single_short_dash(rendered):
    scene = rendered(2, 0.01)[0]
    dashes = tuple(LaneLine(y, dash_m=2.0, gap_m=40.0, phase_m=7.0) for y in (1.75, -1.75))
    result = calibrate(*rendered_as(scene, road=Road(lines=dashes)), scene.rig)
    assert_refused(result, RejectReason.NO_LINES_FOUND)
    assert result.rejection.value < 40


def test_refuses_swapped_and_equal_images(rendered):
    scene, left, right = rendered(2, 0.01)
    swapped = calibrate(right, left, scene.rig)
    assert_refused(swapped, RejectReason.CAMERAS_SWAPPED, "exchange the topics")
    assert swapped.rejection.value < -5
    assert_refused(calibrate(left, left, scene.rig), RejectReason.LINES_NOT_MATCHED, "the same picture")


def test_refuses_lines_on_a_road_rolled_too_far(rendered):
    scene, left, right = rendered(2, 0.01)
    config = configured(search__roll_max_rad=abs(scene.extrinsics.roll_rad) / 2)
    result = calibrate(left, right, scene.rig, config=config)
    assert_refused(result, RejectReason.LINES_NOT_MATCHED, "on a road whose roll")


def test_refuses_a_horizon_above_the_image(rendered):
    scene = rendered(2, 0.01)[0]
    images = rendered_as(scene, extrinsics=Extrinsics(1.4, math.radians(27), 0.0))
    result = calibrate(*images, scene.rig)
    assert_refused(result, RejectReason.LINES_NOT_CONVERGING, "the horizon must be in view", "at least 0 px")
    # 516.6 tan(27 deg) = 263 px above row 239.5.
    assert result.rejection.value == pytest.approx(-23.7, abs=1.0)
    assert result.pattern is not None  # for a picture


@pytest.mark.parametrize(("curvature_per_m", "side"), [(1 / 150, "left"), (-1 / 400, "right")])
def test_refuses_a_bend(rendered, curvature_per_m, side):
    scene = rendered(2, 0.01)[0]
    result = calibrate(*rendered_as(scene, road=Road(curvature_per_m=curvature_per_m)), scene.rig)
    assert_refused(
        result, RejectReason.LINES_NOT_STRAIGHT, f"to the {side}", "at least 1000 m", "straight road"
    )
    assert result.rejection.value == pytest.approx(abs(1 / curvature_per_m), rel=0.15)
    assert result.stages.keys() - {"coarse"} == {"genetic"}


def test_refuses_images_that_are_a_row_off(rendered):
    """The lines still fit a plane, to 0.6 px."""
    scene, left, right = rendered(2, 0.01)
    result = calibrate(left, np.roll(right, 1, axis=0), scene.rig, config=AS_IT_IS)
    # In units of what calibrations leave, the lines contradict each other by about the limit.
    assert result.reason in (RejectReason.LINES_INCONSISTENT, RejectReason.IMAGES_NOT_RECTIFIED)
    assert_refused(result, result.reason, "a row of one")


def test_refuses_images_that_are_not_rectified(rendered):
    """The right image is shifted down: its lines meet elsewhere, and no plane explains them."""
    scene, left, right = rendered(2, 0.01)
    result = calibrate(left, np.roll(right, 4, axis=0), scene.rig, config=AS_IT_IS)
    assert_refused(
        result, RejectReason.FITNESS_TOO_LOW, "miss every road plane by", "at most 1 px", "parallel"
    )
    assert result.rejection.threshold == pytest.approx(1 / (1 + 1e-4))
    assert result.rejection.value < result.rejection.threshold
    assert result.stages.keys() - {"coarse"} == {"genetic"}


@pytest.mark.parametrize("rows", [1, 4])
def test_rows_that_are_off_are_corrected_and_told(rendered, rows):
    """A right image that is lower is that of a camera that is nose up, by less than half a degree here."""
    scene, left, right = rendered(2, 0.01)
    result = calibrate(left, np.roll(right, rows, axis=0), scene.rig)
    assert result.accepted, result.message
    error = result.extrinsics.as_array() - scene.extrinsics.as_array()
    assert np.all(np.abs(error) < 2.0 * result.std.as_array())
    pitch_std = result.alignment.std[0]
    assert result.alignment.pitch_rad == pytest.approx(-rows / scene.rig.fy, abs=3.0 * pitch_std)
    assert pitch_std < math.radians(0.02)


EDGES = [
    ("height", {"search__height_max_m": 1.2}, 1.2),  # the truth is 1.257 m
    ("height", {"search__height_min_m": 1.3}, 1.3),
    ("pitch", {"search__pitch_max_rad": 0.04}, math.degrees(0.04)),  # the truth is 0.0435
]


@pytest.mark.parametrize(("name", "box", "limit"), EDGES, ids=[f"{n} {b}" for n, b, _ in EDGES])
def test_refuses_an_estimate_at_the_edge_of_the_search_space(rendered, name, box, limit):
    scene, left, right = rendered(2, 0.01)
    result = calibrate(left, right, scene.rig, config=configured(**box))
    assert_refused(
        result, RejectReason.SEARCH_SPACE_EDGE, f"best {name}, ", "is at the edge", "widen search.*"
    )
    assert result.rejection.threshold == pytest.approx(limit)
    assert result.stages.keys() - {"coarse"} == {"genetic"}


def test_extract_returns_the_pattern_or_the_refusal(rendered):
    scene, left, right = rendered(2, 0.01)
    calibrator = Calibrator(scene.rig)
    assert isinstance(calibrator.extract(left, right), LanePattern)
    refused = calibrator.extract(GREY, GREY)
    assert isinstance(refused, NoPattern)
    assert refused.rejection.reason is RejectReason.NO_LINES_FOUND
    # Looking is not adding.
    assert calibrator.estimate.reason is RejectReason.NO_FRAMES


# --- whatever comes -----------------------------------------------------------------------------------

shapes = st.one_of(
    st.just((80, 96)),
    st.tuples(st.integers(0, 100), st.integers(0, 100)),
    npst.array_shapes(min_dims=0, max_dims=4, max_side=6),
)
dtypes = st.one_of(
    st.just(np.dtype(np.uint8)), npst.scalar_dtypes(), st.just(np.dtype(object)), st.just(np.dtype("U3"))
)


@st.composite
def anything(draw):
    """Draw an image of the rig's size filled in some way, any other array, or no array at all."""
    kind = draw(st.sampled_from(["random", "blocks", "flat", "array", "nan", "other"]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if kind == "random":
        return rng.integers(0, 256, (80, 96), dtype=np.uint8)
    if kind == "blocks":
        size = draw(st.sampled_from([2, 4, 8, 16]))
        blocks = rng.integers(0, 256, (80 // size, 96 // size), dtype=np.uint8)
        return np.kron(blocks, np.ones((size, size), np.uint8))
    if kind == "flat":
        return np.full((80, 96), draw(st.integers(0, 255)), np.uint8)
    if kind == "array":
        return np.zeros(draw(shapes), draw(dtypes))
    if kind == "nan":
        return np.full((80, 96), draw(st.sampled_from([np.nan, np.inf, -np.inf])))
    return draw(st.one_of(st.none(), st.integers(), st.text(max_size=5), st.lists(st.lists(st.integers()))))


@pytest.mark.slow
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(left=anything(), right=anything())
def test_whatever_comes_is_a_result(left, right):
    result = calibrate(left, right, SMALL_RIG)
    assert isinstance(result, CalibrationResult)
    assert not result.accepted
    assert isinstance(result.reason, RejectReason)
    assert result.message.endswith(result.rejection.remedy)
    assert math.isfinite(result.rejection.value)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    rows=st.lists(st.integers(0, 479), max_size=40),
    grey=st.integers(0, 255),
    shift=st.integers(-40, 40),
    data=st.data(),
)
def test_damaged_roads_are_results_and_finite(rendered, rows, grey, shift, data):
    """Real lines, with rows lost, blocks covered and the right image moved: a pose or a reason, never NaN."""
    scene, left, right = rendered(2, 0.01)
    left, right = left.copy(), np.roll(right, shift, axis=1)
    left[rows] = grey
    v, u = data.draw(st.tuples(st.integers(0, 400), st.integers(0, 560)))
    right[v : v + 80, u : u + 80] = grey
    result = calibrate(left, right, scene.rig)
    assert result.accepted is (result.extrinsics is not None)
    if result.accepted:
        assert np.all(np.isfinite(result.extrinsics.as_array()))
        assert np.all(np.linalg.eigvalsh(result.covariance) > 0)
        assert math.isfinite(result.lane_yaw_rad)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_second_line_beside_each_is_not_taken_for_the_first_one(seed):
    """Each has another one 1.25 m beyond it: matched crosswise, they are a road a few times too small."""
    scene = random_scene(np.random.default_rng(seed), 0.01, texture_amplitude=0.0)
    left, right = scene.road.lines[:2]
    more = (replace(left, offset_m=left.offset_m + 1.25), replace(right, offset_m=right.offset_m - 1.25))
    scene = replace(scene, road=replace(scene.road, lines=(*scene.road.lines, *more)))
    result = Calibrator(scene.rig).add(*render(scene, np.random.default_rng(seed)))
    assert result.accepted
    assert abs(result.extrinsics.height_m - scene.extrinsics.height_m) < 0.005


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"extrinsics": Extrinsics(math.nan, 0.05, 0.01)}, "pose"),
        ({"extrinsics": Extrinsics(-1.4, 0.05, 0.01)}, "pose"),
        ({"stamp_s": math.nan}, "pose"),
        ({"uncertainty": (UncertaintyTerm("noise", np.eye(3)),)}, "terms"),
        ({"covariance": -np.eye(3)}, "covariance"),
    ],
)
def test_a_result_that_would_spoil_the_mean_is_not_remembered(calibrated, changes, why):
    scene, moment = calibrated(1, 0.05)
    calibrator = Calibrator(scene.rig)
    with pytest.raises(ValueError, match=why):
        calibrator.remember(replace(moment, **changes))
    assert not calibrator.estimate.accepted
