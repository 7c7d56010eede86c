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

"""One call of ~/calibrate against a scripted camera: what it answers, and when. No DDS."""

import dataclasses
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
from call_making import ARRIVED, RIG, Source, config, image, pair

from stereo_selfcal import CalibrationResult, CalibratorConfig, Extrinsics
from stereo_selfcal.core.camera.frozen import FrozenImage
from stereo_selfcal.core.camera.pairing import PairCounts
from stereo_selfcal.core.camera.stamp_pattern import NoPairCause, StampPattern
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.ros import calibration
from stereo_selfcal.ros.calibration import CalibrationCall
from stereo_selfcal.ros.pair_source import Topics, no_pair_reason

RAW_TOPICS = Topics("/left/image_raw", "/right/image_raw", "/left/camera_info", "/right/camera_info")


def without_rig(**changes):
    return config(**{f"rig__{name}": type(value)(0) for name, value in RIG.items()}, **changes)


def info(fx=5.0, shift=0.0, **changes):
    k = [fx, 0, 1.5, 0, fx, 1.0, 0, 0, 1]
    p = [fx, 0, 1.5, shift, 0, fx, 1.0, 0, 0, 0, 1, 0]
    return SimpleNamespace(**{"width": 4, "height": 3, "k": k, "p": p, **changes})


def unequal(nearest_s, cause=NoPairCause.UNEQUAL):
    """Return the pattern of two 30 Hz cameras whose images form no pair."""
    return StampPattern(cause, nearest_s, 1 / 30, (0.8, 0.6))


class FakeCalibrator:
    """Accepts images with values above 50 and remembers what it was given."""

    made = ()

    def __init__(self, rig, settings):
        self.rig, self.settings, self.frames = rig, settings, []
        FakeCalibrator.made = (*self.made, self)

    def add(self, left, right, stamp_s, stamp_difference_s):
        assert left.shape == right.shape == (3, 4) and left.dtype == np.uint8
        if left[0, 0] <= 50:
            return rejected(
                Rejection(
                    RejectReason.NO_LINES_FOUND, "lines found", 0, Bound.LEAST, 2, "", "look at the road"
                )
            )
        self.frames.append(stamp_s)
        return self.estimate

    @property
    def estimate(self):
        return CalibrationResult(
            "height 1.2 m", extrinsics=Extrinsics(1.2, 0, 0), covariance=np.eye(3), n_frames=len(self.frames)
        )


@pytest.fixture(autouse=True)
def calibrator(monkeypatch):
    FakeCalibrator.made = ()
    monkeypatch.setattr(calibration, "Calibrator", FakeCalibrator)


def test_first_good_pair_is_the_answer():
    outcome = CalibrationCall(Source(pair(1_500_000_000), pair()), config()).run()
    assert outcome.message == "height 1.2 m"
    assert outcome.result.n_frames == 1
    assert outcome.stamp_ns == 1_500_000_000
    assert dataclasses.asdict(outcome.rig) == RIG
    assert FakeCalibrator.made[0].frames == [1.5]


@pytest.mark.parametrize(
    ("yaw_rad", "told"),
    [
        (0.0, ""),
        (
            2e-3,
            "; the right camera looks 0.1146 +- 0.0006 deg too far left: depths are too large, by 10 % at 10",
        ),
    ],
)
def test_answer_says_that_the_right_camera_has_turned(monkeypatch, yaw_rad, told):
    turned = Alignment(0.0, 0.0, yaw_rad, np.eye(3) * 1e-10)  # 0.0006 deg
    plain = FakeCalibrator.estimate.fget
    estimate = property(lambda self: dataclasses.replace(plain(self), alignment=turned))
    monkeypatch.setattr(FakeCalibrator, "estimate", estimate)
    message = CalibrationCall(Source(pair()), config()).run().message
    assert message.startswith(f"height 1.2 m{told}")
    assert bool(told) == (message != "height 1.2 m")


def test_settings_reach_the_calibrator():
    CalibrationCall(Source(pair()), config(seed=5, genetic__population=30)).run()
    expected = CalibratorConfig.from_mapping({"seed": 5, "genetic.population": 30})
    assert FakeCalibrator.made[0].settings == expected


def test_refused_frames_are_followed_by_better_ones():
    source = Source(pair(left=image(0)), pair(left=image(0)), pair(3))
    assert CalibrationCall(source, config()).run().result is not None


def test_frames_are_fused():
    source = Source(*(pair(i * 10**9, image(0 if i == 1 else 100)) for i in range(6)))
    outcome = CalibrationCall(source, config(frames=3)).run()
    assert FakeCalibrator.made[0].frames == [0.0, 2.0, 3.0]
    assert outcome.result.n_frames == 3
    assert len(source.pairs) == 2


def test_too_few_accepted_frames_say_how_many():
    outcome = CalibrationCall(Source(pair(), pair(left=image(0))), config(frames=3)).run()
    assert outcome.result is None
    assert outcome.message.startswith(
        "1 of 3 frames accepted, 2 pairs in 0.0 s: raise timeout_s or lower frames"
    )
    assert "lines found: 0, at least 2 needed; look at the road" in outcome.message


def test_refusal_is_passed_on_with_the_number_of_pairs():
    outcome = CalibrationCall(Source(pair(left=image(0)), pair(left=image(0))), config()).run()
    assert outcome.result is None
    assert outcome.message.startswith(
        "no frame accepted, 2 pairs in 0.0 s; last refusal: lines found: 0, at least 2 needed"
    )


def test_wrong_encoding_is_named_with_its_topic():
    outcome = CalibrationCall(Source(pair(right=image(encoding="yuv422"))), config()).run()
    assert "/right/image_rect: image encoding 'yuv422' is not supported" in outcome.message


def test_wrong_step_is_named_with_its_topic():
    outcome = CalibrationCall(Source(pair(left=image(step=3))), config()).run()
    assert "/left/image_rect: step is 3 bytes" in outcome.message


def test_rig_from_camera_info():
    source = Source(pair(), infos=(info(), info(shift=-1.0)))
    outcome = CalibrationCall(source, without_rig()).run()
    assert outcome.rig.baseline_m == 0.2


def raw_info(side, **changes):
    """Return the CameraInfo of a raw camera that needs no change."""
    fields = {"d": [], "r": np.eye(3).ravel(), "distortion_model": "plumb_bob", **changes}
    return info(shift=-1.0 if side == "right" else 0.0, **fields)


def test_raw_images_are_rectified(monkeypatch):
    """Here by a flip of the principal point: one column to the right."""
    shown = []
    monkeypatch.setattr(
        FakeCalibrator, "add", lambda self, left, right, *_: shown.append((left, right)) or self.estimate
    )
    left, right = raw_info("left"), raw_info("right")
    left.k[2] += 1.0
    columns = bytes([60, 70, 80, 90] * 3)
    source = Source(pair(left=image_of(columns), right=image_of(columns)), infos=(left, right))
    source.topics = RAW_TOPICS
    assert CalibrationCall(source, without_rig(rectified=False)).run().result is not None
    assert shown[0][0].tolist()[0] == [70, 80, 90, 0]
    assert shown[0][1].tolist()[0] == [60, 70, 80, 90]


def image_of(data):
    message = image()
    message.data = data
    return message


def test_raw_images_of_an_unknown_model_are_refused():
    infos = raw_info("left", distortion_model="fov"), raw_info("right", distortion_model="fov")
    outcome = CalibrationCall(Source(pair(), infos=infos), without_rig(rectified=False)).run()
    assert outcome.result is None
    assert outcome.message.startswith("left CameraInfo has the distortion model 'fov', known are equidistant")


def test_doubts_about_the_cameras_are_told_with_any_answer():
    infos = info(), info(shift=-13.0)
    for images, start in ((pair(), "height 1.2 m"), (pair(left=image(0)), "no frame accepted")):
        outcome = CalibrationCall(Source(images, infos=infos), without_rig()).run()
        assert outcome.message.startswith(start)
        assert outcome.message.endswith(
            "the baseline is 2.6 m, usual is at least 0.03 m and at most 2 m: check P[3]"
        )


def test_parameters_win_over_camera_info():
    source = Source(pair(), infos=(info(fx=9.0), info(fx=9.0, shift=-1.0)))
    assert CalibrationCall(source, config()).run().rig.fx == 5.0


@pytest.mark.parametrize(
    ("infos", "words"),
    [
        (
            (None, None),
            "no CameraInfo on /left/camera_info (1 publisher) and /right/camera_info (0 publishers)",
        ),
        (
            (info(), None),
            "no CameraInfo on /right/camera_info (0 publishers): publish it or set the parameters",
        ),
        (
            (info(k=[0.0] * 9, p=[0.0] * 12), info()),
            "left CameraInfo is uncalibrated (K[0] = 0 and P[0] = 0)",
        ),
        ((info(), info()), "baseline of zero (P[3] is 0 in both cameras"),
        ((info(), info(shift=1.0)), "P[3] is 0 in the left camera and 1 in the right one"),
    ],
)
def test_what_is_wrong_with_camera_info(infos, words):
    outcome = CalibrationCall(Source(pair(), pair(), infos=infos), without_rig()).run()
    assert outcome.result is None
    assert words in outcome.message and outcome.message.endswith("(2 pairs in 0.0 s)")


def test_camera_info_may_come_after_the_images():
    source = Source(pair(), pair())
    first = source.next_pair

    def next_pair(timeout_s):
        if len(source.pairs) == 1:
            source.camera_infos = (info(), info(shift=-1.0))
        return first(timeout_s)

    source.next_pair = next_pair
    assert CalibrationCall(source, without_rig()).run().result is not None


def test_frames_of_other_cameras_begin_anew():
    """Three frames are needed: two of the first cameras do not count for the second ones."""
    source = Source(*(pair(i * 10**9) for i in range(5)), infos=(info(), info(shift=-1.0)))
    first = source.next_pair

    def next_pair(timeout_s):
        if len(source.pairs) == 3:
            source.camera_infos = (info(), info(shift=-1.5))
        return first(timeout_s)

    source.next_pair = next_pair
    outcome = CalibrationCall(source, without_rig(frames=3)).run()
    assert [made.frames for made in FakeCalibrator.made] == [[0.0, 1.0], [2.0, 3.0, 4.0]]
    assert outcome.result.n_frames == 3
    assert outcome.rig.baseline_m == pytest.approx(0.3)
    assert outcome.message == (
        "height 1.2 m; CameraInfo changed at 2.0 s (P[3] of the right camera -1 -> -1.5): frames from before "
        "are of another rig and not in the result"
    )


def source_of(infos_of, n_pairs):
    """Return a source whose pair at n seconds has the CameraInfo ``infos_of(n)``."""
    source = Source(*(pair(i * 10**9) for i in range(n_pairs)), infos=infos_of(0))
    source.camera_infos_of = lambda each: infos_of(each.stamp_ns // 10**9)
    return source


def test_each_frame_has_the_camera_info_of_its_own_stamp():
    """The last one that has arrived may be of a later frame."""
    source = source_of(lambda i: (info(), info(shift=-1.0 if i < 2 else -1.5)), 5)
    source.camera_infos = info(), info(shift=-1.5)
    outcome = CalibrationCall(source, without_rig(frames=2)).run()
    assert FakeCalibrator.made[0].frames == [0.0, 1.0]
    assert outcome.rig.baseline_m == pytest.approx(0.2)


def test_two_publishers_on_one_topic_are_refused():
    source = source_of(lambda i: (info(), info(shift=-1.0 - i % 2)), 4)
    outcome = CalibrationCall(source, without_rig(frames=2)).run()
    assert outcome.result is None
    assert outcome.message.startswith(
        "CameraInfo alternates between P[3] of the right camera -2 and P[3] of the right camera -1"
    ) or outcome.message.startswith("CameraInfo alternates between P[3] of the right camera -1 and")


def test_raw_images_that_are_taken_for_rectified_are_refused():
    changes = {"d": [-2.0, 0.5, 0, 0, 0], "r": np.eye(3).ravel(), "distortion_model": "plumb_bob"}
    source = Source(pair(), infos=(info(**changes), info(shift=-1.0, **changes)))
    assert CalibrationCall(source, without_rig()).run().result is not None  # they are called rectified
    source.topics, source.pairs = RAW_TOPICS, deque([pair()])
    outcome = CalibrationCall(source, without_rig()).run()
    assert outcome.result is None
    assert outcome.message.startswith("/left/image_raw is not called rectified, and by its CameraInfo (D is")
    assert "set rectified: false, or rig.* if they are rectified after all" in outcome.message


def test_binning_is_not_applied_to_images_of_the_whole_sensor():
    infos = info(binning_x=2, binning_y=2), info(shift=-1.0, binning_x=2, binning_y=2)
    outcome = CalibrationCall(Source(pair(), infos=infos), without_rig()).run()
    assert outcome.rig.fx == 5.0
    assert (
        "the left images show the whole sensor, although their CameraInfo has binning 2 x 2"
        in outcome.message
    )


def test_half_a_rig_by_parameters_names_the_other_half():
    outcome = CalibrationCall(Source(pair()), config(rig__fx=0.0, rig__baseline_m=0.0)).run()
    assert "rig.fx, rig.baseline_m not set: set all parameters of rig.* or none of them" in outcome.message


def test_impossible_rig_by_parameters_is_explained():
    outcome = CalibrationCall(Source(pair()), config(rig__cx=40.0)).run()
    assert "principal point (40.0, 1.0) lies outside the 4 x 3 image" in outcome.message


@pytest.mark.parametrize(
    ("state", "changes", "words"),
    [
        (
            {"counts": PairCounts(160, 10)},
            {},
            "no pair in 5.0 s: left 30.0 Hz, right 0.0 Hz; nothing arrives on /right/image_rect (0 publ",
        ),
        (
            {"counts": PairCounts(10, 160)},
            {},
            "no pair in 5.0 s: left 0.0 Hz, right 30.0 Hz; nothing arrives on /left/image_rect (1 publ",
        ),
        (
            {"counts": PairCounts(10, 10)},
            {},
            "right 0.0 Hz; nothing arrives on /left/image_rect (1 publisher) and /right/image_rect (0 pub",
        ),
        (
            {"counts": PairCounts(160, 160), "pattern": unequal(0.012)},
            {},
            "left 30.0 Hz, right 30.0 Hz; the nearest stamps differ by 12.000 ms: set approximate_sync, and "
            "approximate_sync_tolerance_seconds to 0.015 (half a frame is 16.7 ms)",
        ),
        (
            {"counts": PairCounts(160, 160), "pattern": unequal(0.017, NoPairCause.CLOCKS)},
            {},
            "more than half a frame (a frame is 33.3 ms): no tolerance helps, the clocks of the cameras",
        ),
        (
            {"counts": PairCounts(10, 160), "mismatches": ("/cam publishes x on y, z is read",)},
            {},
            "nothing arrives on /left/image_rect (1 publisher): /cam publishes x on y, z is read",
        ),
        (
            {"counts": PairCounts(160, 160), "pattern": unequal(0.012)},
            {"approximate_sync": True},
            "differ by 12.000 ms, approximate_sync_tolerance_seconds allows 10.000 ms: raise it to 0.015",
        ),
        (
            {"counts": PairCounts(160, 160), "pattern": unequal(0.002, NoPairCause.QUEUE)},
            {"approximate_sync": True},
            "differ by 2.000 ms, which is tolerated, but none was formed: raise queue_size from 5",
        ),
        (
            {"counts": PairCounts(30, 60), "pattern": unequal(1 / 30, NoPairCause.LOST)},
            {},
            "images are lost on the way: the nearest stamps differ by 33.333 ms, whole frames (a frame is "
            "33.3 ms); missing are 80% of the left and 60% of the right images; no tolerance helps: make the",
        ),
        (
            {"counts": PairCounts(30, 60), "pattern": unequal(0.01, NoPairCause.UNCLEAR)},
            {},
            "either images are lost on the way and no two of one moment arrived, or the stamps of the "
            "cameras differ: a tolerance might pair images of different moments; make the subscriptions",
        ),
        ({"counts": PairCounts(12, 12)}, {}, "too few images arrived on both sides to tell why"),
    ],
)
def test_why_there_is_no_pair(state, changes, words):
    source = Source(**state)
    source.states.popleft()  # the state in which the call began
    reason = no_pair_reason(source, config(**changes), ARRIVED, elapsed_s=5.0)
    assert words in reason


def test_call_that_ends_at_once_divides_by_no_zero(monkeypatch):
    monkeypatch.setattr(calibration.time, "monotonic", lambda: 100.0)
    assert CalibrationCall(Source(), config()).run().message.startswith("no pair in 0.0 s: left 0.0 Hz")


def test_call_without_pairs_answers_with_that_reason():
    outcome = CalibrationCall(Source(counts=PairCounts(10, 10)), config()).run()
    assert outcome.result is None
    assert outcome.message.startswith("no pair in ")


def test_call_ends_at_its_timeout_while_refusals_go_on():
    source = Source(*(pair(left=image(0)) for _ in range(10**5)))
    outcome = CalibrationCall(source, config(timeout_s=0.1)).run()
    assert outcome.message.startswith("no frame accepted, ")
    assert source.pairs


def test_a_fault_of_the_estimator_refuses_the_pair_and_is_reported(monkeypatch):
    def fail(*_args):
        raise ZeroDivisionError

    reports = []
    monkeypatch.setattr(FakeCalibrator, "add", fail)
    outcome = CalibrationCall(Source(pair()), config(), reports.append).run()
    assert "ended the work on this frame: ZeroDivisionError (test_calibration.py, line" in outcome.message
    assert "Traceback" in reports[0].result.fault.trace


def test_shutdown_ends_the_call():
    source = Source()
    source.stopped = True
    assert CalibrationCall(source, config()).run().message == "interrupted: the node shuts down"


def test_a_fault_while_a_pair_is_read_refuses_it_and_the_next_one_is_taken(monkeypatch):
    read, calls, reports = calibration._grey, [], []

    def read_or_fail(message, topic, size):
        calls.append(topic)
        if len(calls) == 1:
            raise IndexError("a bug")
        return read(message, topic, size)

    monkeypatch.setattr(calibration, "_grey", read_or_fail)
    outcome = CalibrationCall(Source(pair(1), pair(2)), config(), reports.append).run()
    assert outcome.result is not None
    refused = reports[0].result
    assert refused.reason is RejectReason.INTERNAL_ERROR
    assert "IndexError: a bug (test_calibration.py, line" in refused.message
    assert "Traceback" in refused.fault.trace
    assert (reports[0].left.size, reports[0].rig, reports[0].stamp_ns) == (0, None, 1)


def test_a_call_of_faults_only_says_so(monkeypatch):
    def fail(*_args):
        raise IndexError("a bug")

    monkeypatch.setattr(calibration, "_grey", fail)
    outcome = CalibrationCall(Source(pair(1), pair(2)), config()).run()
    assert outcome.result is None
    assert "no frame accepted, 2 pairs" in outcome.message
    assert "last refusal: 1 fault of this program, 0 allowed, ended the work on this frame" in outcome.message


def image_of_12_bits(value):
    data = np.full(12, value, "<u2").tobytes()
    return SimpleNamespace(data=data, width=4, height=3, step=8, encoding="mono16", is_bigendian=0)


def test_images_of_12_bits_are_scaled_alike_and_the_answer_says_so(monkeypatch):
    seen = []

    def calibrate(rig, add, left, right, stamp_ns, stamp_difference_s):
        seen.append((int(left.max()), int(right.max())))
        return SimpleNamespace(result=SimpleNamespace(accepted=False, message="no lines", reason="none"))

    monkeypatch.setattr(calibration, "calibrate_timed", calibrate)
    pairs = [pair(1, image_of_12_bits(4000), image_of_12_bits(2000)), pair(2, image_of_12_bits(160), image())]
    outcome = CalibrationCall(Source(*pairs), config()).run()
    assert seen == [(250, 125), (10, 100)]
    assert "no value above 4095: they are taken as images of 12 bits" in outcome.message


def test_compressed_image_that_states_gigabytes_is_refused_with_both_sizes():
    header = b"P5\n65000 65000\n255\n"
    bomb = SimpleNamespace(data=header, format="pgm")
    outcome = CalibrationCall(Source(pair(1, bomb, bomb)), config()).run()
    assert "PGM image states 65000 x 65000 pixels, the rig has 4 x 3" in outcome.message


def stripes(value=100):
    message = image()
    message.data = bytes(range(value, value + 12))
    return message


@pytest.mark.parametrize("n_frames", [1, 2])
def test_a_pair_with_a_repeated_image_is_refused(n_frames):
    frozen = FrozenImage("right", 2_500_000_000)
    stale = dataclasses.replace(pair(3_000_000_000, stripes(), stripes()), frozen=frozen)
    reports = []
    good = pair(1, stripes(), stripes()), pair(2, stripes(), stripes())
    outcome = CalibrationCall(Source(*good, stale), config(frames=n_frames), reports.append).run()
    assert outcome.result is not None
    outcome = CalibrationCall(Source(good[0], good[1], stale), config(frames=3), reports.append).run()
    assert outcome.result is None
    assert (
        "the right camera repeats its last image since 2.500 s, while the left one goes on" in outcome.message
    )
    assert reports[-1].result.reason is RejectReason.IMAGE_FROZEN and reports[-1].left.shape == (3, 4)


def test_the_first_pair_of_a_call_is_refused_where_the_second_one_repeats_its_image():
    """Nobody has seen the pair before it: the image may be an hour old."""
    stale = dataclasses.replace(pair(2, stripes(), stripes()), frozen=FrozenImage("left", 1))
    outcome = CalibrationCall(Source(pair(1, stripes(), stripes()), stale), config(frames=1)).run()
    assert outcome.result is None
    assert "the left camera repeats its last image since 0.000 s" in outcome.message


def test_images_that_came_twice_are_told_in_the_answer():
    counts = dataclasses.replace(ARRIVED, repeated_left=2, repeated_right=1)
    outcome = CalibrationCall(Source(pair(), counts=counts), config()).run()
    assert outcome.result is not None
    words = "; 2 left and 1 right images came twice (one stamp and the same bytes): each counts once"
    assert outcome.message.endswith(words)
