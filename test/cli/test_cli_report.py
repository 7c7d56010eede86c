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

"""The table and the JSON object of replay."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal.cli.report import FrameRow, as_json, table_header, table_row, table_summary
from stereo_selfcal.core.alignment_verdict import report_alignment
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.drive.camera_changes import CameraChange
from stereo_selfcal.core.drive.drive import Drive, DriveChange, DriveSegment
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected
from stereo_selfcal.core.search.attempt import Verdict
from stereo_selfcal.offline import AttemptSummary, Goal, Replay
from stereo_selfcal.report.mount import how_reached
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.0 / 3.0, math.radians(-2.0), 0.1)
RESULT = CalibrationResult("fine", None, POSE, np.diag([1e-6, 1e-8, 1e-8]), -0.02, n_frames=1)
REFUSED = rejected(
    Rejection(RejectReason.LINES_NOT_CONVERGING, "lines", 1, Bound.LEAST, 2, "px", "drive straight")
)


def replay(rows, drive):
    return Replay(tuple(rows), drive, PAPER_RIG, CalibratorConfig())


@pytest.mark.parametrize("reason", list(RejectReason))
def test_every_reason_fits_its_column(reason):
    rows = [FrameRow(1.7e9, str(reason), None), FrameRow(1.7e9, None, POSE)]
    assert len({len(line) for line in map(table_row, rows)}) == 1
    assert len(table_row(rows[0]).rstrip("\n")) == len(table_header().splitlines()[0])
    assert f" {reason} " in table_row(rows[0])


def test_pitch_and_roll_are_shown_in_degrees_with_sign():
    assert table_row(FrameRow(0.5, None, POSE)).split() == [
        "0.500000",
        "accepted",
        "0.3333",
        "-2.000",
        "+5.730",
    ]


def test_one_frame_has_no_spread():
    text = table_summary(replay([FrameRow(0.0, None, POSE)], Drive(RESULT)))
    assert "mean" in text
    assert "scatter" not in text


def test_refused_result_has_no_estimate():
    text = table_summary(replay([FrameRow.from_result(REFUSED, 0.0)] * 2, Drive(REFUSED)))
    assert "0 of 2 frames accepted" in text
    assert "2 x lines_not_converging" in text
    assert "mount" not in text


def test_json_keeps_every_digit():
    content = json.loads(as_json(replay([FrameRow.from_result(RESULT, 1.7e9 + 0.1)], Drive(RESULT))))
    assert content["extrinsics"] == {"height_m": 1 / 3, "pitch_rad": math.radians(-2.0), "roll_rad": 0.1}
    assert content["frames"][0]["stamp_s"] == 1.7e9 + 0.1
    assert content["std"]["height_m"] == math.sqrt(1e-6)


def test_json_never_holds_nan():
    broken = CalibrationResult("nan", None, Extrinsics(math.nan, 0, 0), np.eye(3))
    with pytest.raises(ValueError, match="JSON"):
        as_json(replay([], Drive(broken)))


TERMS = (
    UncertaintyTerm("noise", np.diag([0.19e-6, 0.19e-8, 0.19e-8])),
    UncertaintyTerm("motion", np.diag([0.81e-6, 0.81e-8, 0.81e-8])),
)
WITH_TERMS = replace(RESULT, uncertainty=TERMS)


def test_what_the_variance_is_made_of_is_a_line_below_the_standard_deviation():
    rows = [FrameRow.from_result(WITH_TERMS, 0.0)]
    lines = table_summary(replay(rows, Drive(WITH_TERMS))).splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith("standard deviation of the mount"))
    assert lines.pop(place + 1) == (
        "its variance: 81 % motion of the car over its road, 19 % noise of the pixels"
    )
    assert lines == table_summary(replay(rows, Drive(RESULT))).splitlines(), "all else is as without terms"


MOUNT = MountEvidence(
    30.0, 1, 2, False, Extrinsics(0.005, 0.003, 0.004), np.array([1.5, 2.0, math.nan]), np.full(3, 9.0)
)


def test_how_the_mount_was_reached_is_in_the_json_and_below_its_variance():
    reached = replace(RESULT, mount=MOUNT)
    segment = DriveSegment(0.0, 1.0, reached, Extrinsics(0.01, 0.02, 0.03), None)
    given = replay([FrameRow.from_result(replace(RESULT, known_start=True), 0.0)], Drive(reached, (segment,)))
    content = json.loads(as_json(given))
    assert content["mount"] == content["segments"][0]["mount"]
    assert content["mount"] == {
        "duration_s": 30.0,
        "outliers": 1,
        "known_starts": 2,
        "stood": False,
        "motion": {"height_m": 0.005, "pitch_rad": 0.003, "roll_rad": 0.004},
        "memory_s": {"height": 1.5, "pitch": 2.0, "roll": None},
        "looks": {"height": 9.0, "pitch": 9.0, "roll": 9.0},
    }
    assert content["frames"][0]["known_start"] and not content["frames"][0]["stood"]
    assert content["frames"][0]["std"] == content["std"]
    lines = table_summary(given).splitlines()
    for sentence in how_reached(MOUNT, 1):
        assert sentence in lines


@pytest.mark.parametrize("reached", [True, False])
def test_what_was_asked_is_told(reached):
    goal = Goal(Targets(0.015, 0.0, 0.0061, 3), reached, reached, 4, 0.3, "" if reached else "few frames")
    given = replace(replay([FrameRow.from_result(RESULT, 0.0)], Drive(RESULT)), goal=goal)
    content = json.loads(as_json(given))
    assert content["targets_reached"] is reached
    asked = {"height_std_m": 0.015, "pitch_std_rad": 0.0, "roll_std_rad": 0.0061, "min_frames": 3}
    assert content["targets"] == {"reached": reached, **asked, "frames": 4, "duration_s": 0.3} | {
        "message": goal.message
    }
    assert goal.message in table_summary(given).splitlines()


def test_json_has_the_standard_deviation_of_every_term():
    segment = DriveSegment(0.0, 1.0, WITH_TERMS, Extrinsics(0.01, 0.02, 0.03), None)
    content = json.loads(as_json(replay([], Drive(WITH_TERMS, (segment,)))))
    assert content["uncertainty"] == {
        "noise": pytest.approx({"height_m": 1e-3 * 0.19**0.5, "pitch_rad": 1e-4 * 0.19**0.5}
            | {"roll_rad": 1e-4 * 0.19**0.5}),
        "motion": pytest.approx({"height_m": 9e-4, "pitch_rad": 9e-5, "roll_rad": 9e-5}),
    }  # fmt: skip
    assert content["segments"][0]["uncertainty"] == content["uncertainty"]
    squares = [sum(each[name] ** 2 for each in content["uncertainty"].values()) for name in content["std"]]
    assert np.sqrt(squares) == pytest.approx(list(content["std"].values()), rel=1e-12)


ALIGNMENT = Alignment(1e-4, 0.0, 2.4e-3, np.diag([1e-10, 4e-10, 3e-8]))
TURNED = replace(RESULT, alignment=ALIGNMENT)


def test_alignment_is_a_line_in_the_users_units():
    rows = [FrameRow.from_result(TURNED, 0.0)]
    lines = table_summary(replay(rows, Drive(TURNED))).splitlines()
    told = [line for line in lines if line.startswith("alignment: ")]
    assert told == [f"alignment: {report_alignment(ALIGNMENT, PAPER_RIG).message}"]
    assert "the right camera looks 0.14 +- 0.01 deg too far left: depths are too large" in told[0]
    lines.remove(told[0])
    assert lines == table_summary(replay(rows, Drive(RESULT))).splitlines(), "all else is as without it"


def test_json_has_the_alignment_of_the_estimate_and_of_each_frame():
    refused = replace(REFUSED, alignment=replace(ALIGNMENT, covariance=np.diag([1e-10, 4e-10, math.inf])))
    rows = [FrameRow.from_result(each, 0.0) for each in (TURNED, refused, RESULT)]
    content = json.loads(as_json(replay(rows, Drive(TURNED))))
    assert content["alignment"] == {
        "pitch_rad": 1e-4,
        "roll_rad": 0.0,
        "yaw_rad": 2.4e-3,
        "std": {"pitch_rad": 1e-5, "roll_rad": 2e-5, "yaw_rad": math.sqrt(3e-8)},
        "verdict": "correctable",
        "message": report_alignment(ALIGNMENT, PAPER_RIG).message,
    }
    first, second, third = (frame["alignment"] for frame in content["frames"])
    assert first == content["alignment"] and third is None
    assert second["yaw_rad"] is second["std"]["yaw_rad"] is None
    assert (second["pitch_rad"], second["verdict"]) == (1e-4, "not_seen")


def test_alignment_of_a_frame_before_other_cameras_is_told_by_their_rig():
    wide = replace(PAPER_RIG, baseline_m=10 * PAPER_RIG.baseline_m)
    change = CameraChange(5.0, wide, PAPER_RIG, ())
    rows = (FrameRow.from_result(TURNED, 4.0), FrameRow.from_result(TURNED, 5.0))
    changed = replace(replay(rows, Drive(TURNED)), camera_changes=(change,), since=1)
    before, after = (frame["alignment"]["message"] for frame in json.loads(as_json(changed))["frames"])
    assert before == report_alignment(ALIGNMENT, wide).message
    assert after == report_alignment(ALIGNMENT, PAPER_RIG).message != before


def test_json_of_a_refused_recording_has_no_uncertainty():
    content = json.loads(as_json(replay([FrameRow.from_result(REFUSED, 0.0)], Drive(REFUSED))))
    assert content["uncertainty"] is None
    assert content["frames"][0]["attempts"] == []


def test_json_has_the_attempts_of_every_frame():
    assert REFUSED.rejection is not None
    attempts = (
        AttemptSummary(FoundBy.HOUGH, Verdict.REFUSED, REFUSED.rejection, "some gate"),
        AttemptSummary(FoundBy.SURFACE, Verdict.NOT_FITTED, comment="no line lies in it"),
        AttemptSummary(FoundBy.ROAD, Verdict.ACCEPTED),
    )
    content = json.loads(as_json(replay([FrameRow(0.0, None, POSE, attempts=attempts)], Drive(RESULT))))
    message = "lines: 1 px, at least 2 px needed; drive straight"
    assert [list(attempt.values()) for attempt in content["frames"][0]["attempts"]] == [
        ["hough", "refused", "lines_not_converging", message],
        ["surface", "not_fitted", None, "no line lies in it"],
        ["road", "accepted", None, ""],
    ]
    assert all(
        list(attempt) == ["found_by", "verdict", "reason", "message"]
        for attempt in content["frames"][0]["attempts"]
    )


def moved_drive():
    later = Extrinsics(0.5, math.radians(-1.0), 0.1)
    after = CalibrationResult("moved", None, later, np.diag([1e-6, 1e-8, 1e-8]), n_frames=7)
    spread = Extrinsics(0.01, 0.02, 0.03)
    segments = (
        DriveSegment(100.0, 160.0, RESULT, spread, None),
        DriveSegment(161.0, 900.0, after, spread, Extrinsics(0.001, 0.002, 0.003)),
    )
    change = DriveChange(160.5, 2.0, POSE, later, np.array([50.0, 10.0, 0.0]))
    return Drive(after, segments, (change,), True)


def test_a_move_is_told_with_what_was_before_and_after():
    text = table_summary(replay([FrameRow(0.0, None, POSE)] * 2, moved_drive()))
    lines = [line.split() for line in text.splitlines()]
    assert ["100.0", "s", "to", "160.0", "s", "0.3333", "-2.000", "+5.730"] in lines
    assert ["moved", "160.5", "s", "(within", "2.0", "s)", "by", "0.1667", "+1.000", "+0.000"] in lines
    assert ["161.0", "s", "to", "900.0", "s", "0.5000", "-1.000", "+5.730"] in lines
    assert "mean" not in text, "of two mounts there is none"


def test_json_has_segments_and_changes():
    content = json.loads(as_json(replay([], moved_drive())))
    before, after = content["segments"]
    assert before["extrinsics"]["height_m"] == 1 / 3
    assert before["standard_error"] is None
    assert after["standard_error"] == {"height_m": 0.001, "pitch_rad": 0.002, "roll_rad": 0.003}
    assert (after["start_s"], after["end_s"], after["frames"]) == (161.0, 900.0, 7)
    (change,) = content["changes"]
    assert (change["at_s"], change["within_s"]) == (160.5, 2.0)
    assert change["shift"]["height_m"] == pytest.approx(0.5 - 1 / 3)
