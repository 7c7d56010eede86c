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

"""What `replay --json` prints is what docs/replay.schema.json describes, and nothing else."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from json_schema import Checker

from stereo_selfcal.cli import replay
from stereo_selfcal.cli.report import as_dict
from stereo_selfcal.core.alignment_verdict import AlignmentVerdict
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.drive.camera_changes import CameraChange
from stereo_selfcal.core.drive.drive import Drive, DriveChange, DriveSegment
from stereo_selfcal.core.evidence.frame_evidence import FoundBy
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.travel import RightDelay, Travel
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.core.results import CalibrationResult
from stereo_selfcal.core.search.attempt import Verdict
from stereo_selfcal.offline import FrameRow, Replay
from stereo_selfcal.synth.scenes import PAPER_RIG

ROOT = Path(__file__).resolve().parents[2]
BAGS = ROOT / "bags"
SCHEMA = json.loads((ROOT / "docs" / "replay.schema.json").read_text(encoding="utf-8"))
DEFS = SCHEMA["$defs"]

RESULT = CalibrationResult(
    "fine",
    extrinsics=Extrinsics(1.4, 0.05, 0.01),
    covariance=np.diag([1e-6, 1e-8, 1e-8]),
    n_frames=9,
    reservations=(Reservation(ReservationKind.ONE_LINE_ONLY, frames=7),),
    alignment=Alignment(1e-3, 0.0, 2e-3, np.diag([1e-10, 4e-10, np.inf])),
    travel=Travel(0.02, 0.05, np.eye(2) * 1e-6, 50, 1.3, 30.0),
    delay=RightDelay(0.004, 0.0, np.diag([1e-8, 1e-4]), 40, (8.0, 14.0)),
    mount=MountEvidence(30.0, 1, 2, False, Extrinsics(0.005, 0.003, 0.004), np.full(3, np.nan), np.ones(3)),
)
SEGMENT = DriveSegment(0.0, 1.0, RESULT, Extrinsics(0.01, 0.02, 0.03), Extrinsics(0.01, 0.02, 0.03))

PAIR = {"name": "pair1", "left": "/l", "right": "/r"}


@pytest.fixture(scope="module")
def checker():
    return Checker(SCHEMA)


def printed(capsys, *arguments):
    replay.main([*map(str, arguments), "--json", "--jobs", "1"])
    return json.loads(capsys.readouterr().out)


def full_replay():
    rig = replace(PAPER_RIG, fx=500.0, fy=500.0)
    rows = tuple(FrameRow.from_result(RESULT, float(stamp_s)) for stamp_s in range(3))
    return Replay(
        rows,
        Drive(
            RESULT,
            (SEGMENT, SEGMENT),
            (DriveChange(0.5, 0.1, Extrinsics(1.4, 0.05, 0.01), Extrinsics(1.4, 0.06, 0.01), np.ones(3)),),
        ),
        PAPER_RIG,
        CalibratorConfig(),
        "it is cut short",
        ("two images have no partner",),
        (CameraChange(0.5, PAPER_RIG, rig, ()),),
        1,
    )


def test_outputs_are_what_the_schema_describes(checker, capsys):
    """Real ones of every kind, and one with all that a drive can have; then no property is left over."""
    road = BAGS / "straight_road"
    outputs = [
        printed(capsys, road, "--until-good", "--max-frames", 3),
        printed(capsys, road, "--all", "--max-frames", 1),
        printed(capsys, BAGS / "no_lines", "--max-frames", 1),
        as_dict(full_replay()),
        {"pairs": [PAIR | as_dict(full_replay()), PAIR | {"accepted": False, "error": "no rig"}]},
    ]
    for output in outputs:
        assert not checker.errors(output)
    named = {"name": "a.png"} | outputs[0]["frames"][0]
    assert not checker.errors(named, DEFS["frame"])
    assert not checker.unmet()


def test_the_checker_finds_what_is_wrong(checker, capsys):
    good = printed(capsys, BAGS / "straight_road", "--max-frames", 1)
    for change in (
        {"accepted": 1},
        {"reason": "bad_weather"},
        {"more": 1},
        {"frames": [good["frames"][0] | {"height_m": "1.4"}]},
        {"extrinsics": {"height_m": 1.4, "pitch_rad": 0.05}},
    ):
        assert checker.errors(good | change), change
    assert checker.errors({name: value for name, value in good.items() if name != "std"})


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (DEFS["reason"], RejectReason),
        (DEFS["reservation"]["properties"]["kind"], ReservationKind),
        (DEFS["attempt"]["properties"]["found_by"], FoundBy),
        (DEFS["attempt"]["properties"]["verdict"], Verdict),
        (DEFS["alignment"]["properties"]["verdict"], AlignmentVerdict),
    ],
    ids=["reason", "reservation", "found_by", "verdict", "alignment"],
)
def test_words_are_those_of_the_code(words, kind):
    assert set(words["enum"]) == {str(each) for each in kind}
