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

"""The diagnostics from snapshots: levels, sentences and keys, without a graph."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.camera.pairing import PairCounts
from stereo_selfcal.core.drive.alignment_watch import AlignmentFinding, AlignmentState
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.ros.calibration_keeper import ActiveCalibration, CalibrationKeeper
from stereo_selfcal.ros.diagnostics import (
    ERROR,
    OK,
    WARN,
    CalibrationReport,
    CameraInfoReport,
    ImagesReport,
    Snapshot,
    age_text,
    diagnostics_message,
)
from stereo_selfcal.ros.intake import ImageFormat
from stereo_selfcal.ros.pair_source import Topics
from stereo_selfcal.ros.record import FrameStatistics

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
RESULT = CalibrationResult(
    "calibrated",
    extrinsics=Extrinsics(1.4, math.radians(3.0), math.radians(-0.5)),
    covariance=np.diag([1e-6, math.radians(0.01) ** 2, math.radians(0.02) ** 2]),
    n_frames=4,
    reservations=(Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, frames=3),),
)
ACTIVE = ActiveCalibration(RESULT, RIG, 0.0, "saved to /data/x.yaml")
REJECTION = Rejection(
    RejectReason.LINES_NOT_STRAIGHT, "radius", 320.0, Bound.LEAST, 1000.0, "m", "drive straight"
)
TOPICS = Topics("/l", "/r", "/li", "/ri")
MONO = ImageFormat(640, 480, "mono8")
GOOD = ImagesReport(PairCounts(90, 91, 90), PairCounts(90, 60, 30), 3.0, topics=TOPICS, publishers=(1, 2))
BASE = Snapshot(
    "/stereo_selfcal",
    "road",
    "stereo_camera",
    CalibrationReport("calibrated", active=ACTIVE, age_s=312.0, last_success=True),
    GOOD,
    CameraInfoReport("CameraInfo", RIG),
)


def report(**changes):
    """Return {topic: (level, message, values)} of the base snapshot with changed parts."""
    message = diagnostics_message(Time(sec=5), replace(BASE, **changes))
    assert message.header.stamp.sec == 5
    assert all(status.hardware_id == "stereo_camera" for status in message.status)
    return {
        status.name.removeprefix("/stereo_selfcal: "): (
            status.level[0],
            status.message,
            {pair.key: pair.value for pair in status.values},
        )
        for status in message.status
    }


def calibration(state="calibrated", **changes):
    return report(calibration=replace(BASE.calibration, state=state, **changes))["calibration"]


def test_all_is_well():
    statuses = report()
    assert list(statuses) == ["calibration", "images", "camera info"]
    assert [level for level, *_ in statuses.values()] == [OK] * 3
    _, text, values = statuses["calibration"]
    assert text.startswith("calibrated: height 1.4000 m (std 1.0 mm), pitch +3.0000 deg (std 0.0100)")
    assert text.endswith("5 min 12 s old")
    assert (values["height_m"], float(values["height_std_m"])) == ("1.4", pytest.approx(1e-3))
    assert float(values["roll_rad"]) == math.radians(-0.5)
    assert float(values["roll_std_rad"]) == pytest.approx(math.radians(0.02))
    assert values["age_s"] == "312.0"
    assert (values["from_frames"], values["saved"]) == ("4", "saved to /data/x.yaml")
    assert values["notes"] == "not checked against the texture of the road surface (3 of 4 frames)"


@pytest.mark.parametrize(
    ("state", "level"),
    [
        ("calibrated", OK),
        ("calibrating", OK),
        ("uncalibrated", WARN),
        ("suspect", WARN),
        ("invalid", ERROR),
        ("a state of the future", WARN),
    ],
)
def test_level_of_a_state(state, level):
    assert calibration(state)[0] == level
    assert calibration(state, active=None)[0] == level
    _, text, values = calibration(state, reason="the pitch has moved by 0.4 deg", watch="drift, proven")
    assert text.startswith(f"{state}: the pitch has moved by 0.4 deg") == (level != OK)
    assert values["state_reason"] == "the pitch has moved by 0.4 deg"
    assert values["watch"] == "drift, proven"


def test_never_calibrated_says_what_to_do():
    level, text, values = calibration(
        "uncalibrated", active=None, last_success=None, reason=CalibrationKeeper().reason
    )
    assert (level, text) == (WARN, "uncalibrated: call ~/calibrate on a straight road with painted lines")
    assert not {"height_m", "height_std_m", "age_s"} & set(values)


def test_refused_call_is_a_warning_with_its_reason():
    level, text, _ = calibration(last_success=False, last_answer="no frame accepted, 3 pairs")
    assert level == WARN
    assert text.startswith("the last call was refused: no frame accepted, 3 pairs")
    level, text, _ = calibration("uncalibrated", active=None, last_success=False, last_answer="no pair")
    assert (level, text) == (WARN, "uncalibrated: no pair")


def test_result_that_is_not_saved_is_a_warning_only_if_it_was_to_be():
    unsaved = replace(ACTIVE, saved="not saved, as output_path is empty")
    assert calibration(active=unsaved)[0] == OK
    failed = replace(ACTIVE, saved="in effect, but not saved: disk full", save_failed=True)
    level, text, _ = calibration(active=failed)
    assert level == WARN and text.endswith("in effect, but not saved: disk full")


def test_refusals_are_counted_and_the_last_one_is_explained():
    frames = FrameStatistics(
        7, {"no_lines_found": 5, "lines_not_straight": 2}, REJECTION, 75.0, 0.06, 0.05, 0.1
    )
    values = calibration(frames=frames)[2]
    assert (values["frames_accepted"], values["frames_rejected"]) == ("7", "7")
    assert (values["rejected_no_lines_found"], values["rejected_lines_not_straight"]) == ("5", "2")
    assert values["last_rejection"] == "lines_not_straight"
    assert values["last_rejection_finding"] == "radius: 320 m, at least 1000 m needed"
    assert (values["last_rejection_measured"], values["last_rejection_limit"]) == ("320.0", "1000.0")
    assert (values["last_rejection_bound"], values["last_rejection_unit"]) == ("at least", "m")
    assert (values["last_rejection_remedy"], values["last_rejection_age_s"]) == ("drive straight", "75.0")
    times = [values[f"time_per_frame{which}_s"] for which in ("", "_mean", "_longest")]
    assert times == ["0.06", "0.05", "0.1"]
    assert not any(key.startswith("last_rejection") for key in calibration()[2])


def test_rates_are_per_second():
    level, text, values = report()["images"]
    assert (values["left_rate_hz"], values["right_rate_hz"], values["pair_rate_hz"]) == (
        "30.0",
        "20.0",
        "10.0",
    )
    assert (level, text) == (OK, "10.0 pairs per second (left 30.0 Hz, right 20.0 Hz)")
    assert (values["left"], values["pairs"]) == ("90", "90")
    assert (values["left_topic"], values["right_publishers"]) == ("/l", "2")


def images(**changes):
    return report(images=replace(GOOD, **changes))["images"]


def test_no_pairs_is_a_warning_with_the_reason():
    level, text, _ = images(added=PairCounts(90, 0), no_pair="no pair in 3.0 s: ...")
    assert (level, text) == (WARN, "no pair in 3.0 s: ...")
    level, text, _ = images(added=PairCounts(90, 0))
    assert (level, text) == (WARN, "no pairs: left 30.0 Hz, right 0.0 Hz")


def test_nobody_warns_of_images_that_are_not_wanted():
    assert images(added=PairCounts(), receiving=False)[0] == OK


def test_what_the_input_knows_is_passed_on():
    values = images(
        nearest_s=0.012, drops={"size_changed": 3}, formats={"left": MONO, "right": ImageFormat(0, 0, "png")}
    )[2]
    assert values["nearest_stamp_difference_s"] == "0.012"
    assert values["dropped_size_changed"] == "3"
    assert [values[f"left_{name}"] for name in ("width_px", "height_px", "encoding")] == [
        "640",
        "480",
        "mono8",
    ]
    assert values["right_encoding"] == "png" and "right_width_px" not in values
    assert values["incompatible_qos"] == "none"


@pytest.mark.parametrize("field", ["incompatible_qos", "unusable"])
def test_what_cannot_work_is_an_error_even_if_nothing_is_wanted(field):
    level, text, _ = images(
        **{field: ("reliability: offered best_effort, requested reliable",)}, receiving=False
    )
    assert level == ERROR and "offered best_effort" in text


def camera_info(*arguments, **changes):
    return report(camera_info=CameraInfoReport(*arguments, **changes))["camera info"]


def test_camera_info():
    level, text, values = camera_info("CameraInfo", RIG)
    assert (level, text) == (OK, "640 x 480 px, baseline 0.1481 m, from CameraInfo")
    assert (values["fx_px"], values["width_px"], values["baseline_m"]) == ("516.6", "640", "0.1481")
    assert camera_info("CameraInfo", missing="no CameraInfo on /li")[:2] == (WARN, "no CameraInfo on /li")
    assert camera_info("CameraInfo")[0] == WARN
    assert camera_info("CameraInfo", RIG, faults=("a", "b"), doubts=("c",))[:2] == (ERROR, "a; b")
    level, text, values = camera_info("CameraInfo", RIG, doubts=("D is not zero",))
    assert (level, text, values["doubts"]) == (WARN, "D is not zero", "D is not zero")


@pytest.mark.parametrize(
    ("age_s", "text"),
    [
        (0.0, "0 s"),
        (-3.0, "0 s"),
        (59.9, "59 s"),
        (60.0, "1 min 0 s"),
        (312.0, "5 min 12 s"),
        (3600.0, "1 h"),
        (7500.0, "2 h 5 min"),
        (2 * 86400.0 + 3 * 3600.0 + 59.0, "2 d 3 h"),
        (math.nan, "unknown"),
        (math.inf, "unknown"),
    ],
)
def test_age(age_s, text):
    assert age_text(age_s) == text


numbers = st.floats() | st.integers(-10, 10).map(float)


def aligned(**changes):
    """Return the values of a calibration whose right camera is turned so."""
    turn = replace(Alignment(1e-5, 0.0, 0.0, np.diag([1e-10, 4e-10, 3e-10])), **changes)
    return calibration(active=replace(ACTIVE, result=replace(RESULT, alignment=turn)))


def test_alignment_is_numbers_in_radians_a_verdict_and_a_sentence():
    level, text, values = aligned()
    assert level == OK and "rows" not in text
    numbers = {k: float(v) for k, v in values.items() if k.startswith("alignment") and k.endswith("_rad")}
    assert numbers == {
        "alignment_pitch_rad": 1e-5,
        "alignment_roll_rad": 0.0,
        "alignment_yaw_rad": 0.0,
        "alignment_pitch_std_rad": pytest.approx(1e-5, rel=1e-12),
        "alignment_roll_std_rad": pytest.approx(2e-5, rel=1e-12),
        "alignment_yaw_std_rad": pytest.approx(math.sqrt(3e-10), rel=1e-12),
    }
    assert values["alignment_verdict"] == "good"
    assert values["alignment"].startswith("depths are right to ")


@pytest.mark.parametrize(("yaw_rad", "verdict"), [(2.4e-3, "correctable"), (0.02, "calibrate_again")])
def test_camera_that_has_turned_is_a_warning_with_the_error_of_depths(yaw_rad, verdict):
    level, text, values = aligned(yaw_rad=yaw_rad)
    assert level == WARN
    assert text.startswith("calibrated: height 1.4000 m")
    assert "; the right camera looks " in text and "depths are too large, by " in text
    assert values["alignment_verdict"] == verdict


def test_present_alignment_and_its_change_are_told():
    now = Alignment(1e-5, 0.0, 2e-3, np.diag([1e-10, 4e-10, math.inf]))
    finding = AlignmentFinding(AlignmentState.STEADY, now, 7)
    level, _, values = calibration(alignment=finding)
    assert level == OK
    assert (values["alignment_state"], values["alignment_now_frames"]) == ("steady", "7")
    assert float(values["alignment_now_pitch_rad"]) == 1e-5
    assert "alignment_now_yaw_rad" not in values and "alignment_change" not in values
    drifted = replace(finding, state=AlignmentState.DRIFTED, message="the right camera has turned")
    level, text, values = calibration(alignment=drifted)
    assert level == WARN and text.endswith("; the right camera has turned")
    assert (values["alignment_state"], values["alignment_change"]) == ("drifted", drifted.message)
    assert calibration()[2]["alignment_state"] == "not_watched"


def test_angle_that_is_not_known_has_no_number():
    level, _, values = aligned(covariance=np.diag([1e-10, 4e-10, math.inf]))
    assert level == OK
    assert values["alignment_verdict"] == "not_seen"
    assert {key for key in values if key.startswith("alignment") and key.endswith("_rad")} == {
        "alignment_pitch_rad",
        "alignment_roll_rad",
        "alignment_pitch_std_rad",
        "alignment_roll_std_rad",
    }
    assert calibration()[2]["alignment"] == "it is not seen how the right camera is turned"
    assert not any(key.startswith("alignment") for key in calibration("uncalibrated", active=None)[2])


@given(numbers, numbers, numbers, st.integers(-5, 10**12))
def test_no_number_makes_a_report_fail(value, age_s, elapsed_s, count):
    """Strange numbers are shown, they must not end the report."""
    broken = replace(RESULT, extrinsics=Extrinsics(value, value, value))
    rejection = replace(REJECTION, value=value, threshold=value)
    frames = FrameStatistics(1, {"no_lines_found": count}, rejection, age_s, value, value, value)
    statuses = report(
        calibration=CalibrationReport(
            "suspect", "x", ActiveCalibration(broken, RIG, 0.0), age_s, frames=frames
        ),
        images=ImagesReport(PairCounts(count), PairCounts(count, count, count), elapsed_s, nearest_s=value),
        camera_info=CameraInfoReport("CameraInfo"),
    )
    assert len(statuses) == 3
