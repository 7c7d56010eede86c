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

"""Values of `/diagnostics` are numbers whose unit ends the key, or words; docs/node.md names all keys."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.camera.pairing import PairCounts
from stereo_selfcal.core.drive.alignment_watch import AlignmentFinding, AlignmentState
from stereo_selfcal.core.drive.targets import USUAL_TARGETS
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.travel import RightDelay, Travel
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera
from stereo_selfcal.ros.calibration_keeper import ActiveCalibration
from stereo_selfcal.ros.call_progress import CallProgress
from stereo_selfcal.ros.diagnostics import (
    CalibrationReport,
    CameraInfoReport,
    ImagesReport,
    Snapshot,
    diagnostics_message,
)
from stereo_selfcal.ros.intake import ImageFormat
from stereo_selfcal.ros.pair_source import Topics
from stereo_selfcal.ros.record import FrameStatistics
from stereo_selfcal.ros.transform_report import TransformReport

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "node.md").read_text(encoding="utf-8")

WORDS = {
    "state", "state_reason", "call", "saved", "notes", "transform", "alignment_verdict", "alignment",
    "synchronisation", "alignment_state", "alignment_change", "watch", "road_pose", "last_answer",
    "road_frame", "camera_frame", "last_rejection", "last_rejection_finding", "last_rejection_bound",
    "last_rejection_unit", "last_rejection_remedy", "left_encoding", "right_encoding", "left_topic",
    "right_topic", "incompatible_qos", "source", "faults", "doubts",
}  # fmt: skip
# What is counted has no unit; what limits a frame has one that depends on the reason: `last_rejection_unit`.
COUNTS = re.compile(
    r"from_frames|call_frames_(accepted|seen)|alignment_now_frames|frames_(accepted|rejected)|"
    r"(rejected|dropped)_[a-z_]+|left|right|pairs|resets|(left|right)_publishers|repeated_(left|right)"
)
OF_REASON = {"last_rejection_measured", "last_rejection_limit"}
UNITS = ("_m", "_rad", "_s", "_hz", "_px")

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
TURN = Alignment(1e-5, 2e-4, 3e-3, np.diag([1e-10, 4e-10, 3e-10]))
RESULT = CalibrationResult(
    "calibrated",
    extrinsics=Extrinsics(1.4, math.radians(3.0), math.radians(-0.5)),
    covariance=np.diag([1e-6, 1e-8, 1e-7]),
    n_frames=4,
    reservations=(Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, frames=3),),
    alignment=TURN,
    travel=Travel(0.02, 0.05, np.eye(2) * 1e-6, 50, 1.3, 30.0),
    delay=RightDelay(0.004, 0.0, np.diag([1e-8, 1e-4]), 40, (8.0, 14.0)),
)
REJECTION = Rejection(
    RejectReason.LINES_NOT_STRAIGHT, "radius", 320.0, Bound.LEAST, 1000.0, "m", "go straight"
)
FULL = Snapshot(
    "/stereo_selfcal",
    "road",
    "stereo_camera",
    CalibrationReport(
        "calibrating",
        "on the way",
        ActiveCalibration(RESULT, RIG, 0.0, "saved to /data/x.yaml"),
        312.0,
        frames=FrameStatistics(7, {"no_lines_found": 5}, REJECTION, 75.0, 0.06, 0.05, 0.1),
        alignment=AlignmentFinding(AlignmentState.DRIFTED, TURN, 7, "it has turned"),
        progress=CallProgress(3, 5, 1.2, 60.0, USUAL_TARGETS, Extrinsics(0.01, 1e-3, 2e-3)),
        transform=TransformReport(place_camera(RESULT, RIG, FrameNames(), InfoFrames("left", "right"))),
    ),
    ImagesReport(
        PairCounts(90, 91, 90),
        PairCounts(90, 60, 30),
        3.0,
        nearest_s=0.012,
        topics=Topics("/l", "/r", "/li", "/ri"),
        publishers=(1, 2),
        drops={"size_changed": 3},
        formats={"left": ImageFormat(640, 480, "mono8"), "right": ImageFormat(640, 480, "mono8")},
    ),
    CameraInfoReport("CameraInfo", RIG),
)
BARE = Snapshot(
    "/stereo_selfcal",
    "road",
    "stereo_camera",
    CalibrationReport("uncalibrated"),
    ImagesReport(PairCounts(), PairCounts(), 0.0),
    CameraInfoReport("CameraInfo"),
)


def values_of(snapshot):
    statuses = diagnostics_message(Time(), snapshot).status
    pairs = [(pair.key, pair.value) for status in statuses for pair in status.values]
    assert len(dict(pairs)) == len(pairs), "a key stands twice"
    return dict(pairs)


@pytest.mark.parametrize("snapshot", [FULL, BARE], ids=["full", "bare"])
def test_values_are_numbers_with_their_unit_in_the_key_or_words(snapshot):
    for key, value in values_of(snapshot).items():
        if key in WORDS:
            continue
        assert math.isfinite(float(value)), key
        assert key.endswith(UNITS) or COUNTS.fullmatch(key) or key in OF_REASON, f"{key} has no unit"


def test_all_words_are_seen():
    """Else this file would hold keys that nobody sends any more."""
    assert set(values_of(FULL)) >= WORDS


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_left_out(value):
    result = replace(RESULT, extrinsics=Extrinsics(value, 0.0, 0.0))
    calibration = replace(FULL.calibration, active=ActiveCalibration(result, RIG, 0.0), age_s=value)
    values = values_of(replace(FULL, calibration=calibration))
    assert "height_m" not in values and "age_s" not in values
    assert values["pitch_rad"] == "0.0"


def test_the_page_names_every_key():
    table = PAGE[PAGE.index("| key | what it is |") : PAGE.index("## States and the watch")]
    told = set(re.findall(r"`([a-z_<>]+)`", table))
    for key in values_of(FULL):
        general = re.sub(r"^(rejected|dropped)_.*", r"\1_<reason>", key)
        alike = re.sub(r"^right_(?!rate|delay)", "left_", general)
        assert told & {key, general, alike}, f"docs/node.md does not name {key}"
