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

"""The drive's progress in the report and in a line."""

from dataclasses import replace
from pathlib import Path

import pytest

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.offline import BagSource, Goal, ProgressPoint, calibrate_recording
from stereo_selfcal.report.page import render_report
from stereo_selfcal.report.progress import progress_line, progress_section

ROAD = Path(__file__).resolve().parents[2] / "bags" / "straight_road"
POINTS = (
    ProgressPoint(0.0, 1, Extrinsics(0.016, 0.0044, 0.0115)),
    ProgressPoint(5.0, 51, Extrinsics(0.018, 0.0042, 0.0045)),
)


@pytest.fixture(scope="module")
def replay():
    with BagSource([ROAD]) as source:
        return calibrate_recording(source)


def test_line_has_the_first_and_the_last():
    assert (
        progress_line(POINTS) == "after 1 frame 16 mm, 0.25, 0.66 deg; after 51 frames 18 mm, 0.24, 0.26 deg"
    )
    assert progress_line(POINTS[:1]) == "after 1 frame 16 mm, 0.25, 0.66 deg"
    assert progress_line(()) == ""


def test_a_recording_ends_with_its_own_standard_deviations(replay):
    assert replay.progress[0].accepted == 1
    last = replay.progress[-1]
    assert (last.accepted, last.std) == (sum(row.accepted for row in replay.rows), replay.estimate.std)
    section = progress_section(replay)
    assert [chart["title"] for chart in section["charts"]] == [
        "Height: standard deviation [mm]", "Pitch: standard deviation [deg]", "Roll: standard deviation [deg]"
    ]  # fmt: skip
    assert all('class="way"' in chart["svg"] for chart in section["charts"])
    assert "frames were accepted." in section["sentence"]
    assert not any("band" in chart["svg"] for chart in section["charts"])


def test_what_was_asked_for_is_a_line(replay):
    targets = Targets(0.01, 0.0, 0.004, 1)
    asked = replace(replay, goal=Goal.of(targets, replay.estimate, 3, 1.0, False))
    drawn = ["band" in chart["svg"] for chart in progress_section(asked)["charts"]]
    assert drawn == [True, False, True]  # any pitch was good enough


def test_of_one_estimate_there_is_no_course(replay):
    alone = replace(replay, progress=replay.progress[:1])
    assert progress_section(alone) is None
    with BagSource([ROAD]) as source:
        assert 'id="progress"' in render_report(source, replay)
        assert 'id="progress"' not in render_report(source, alone)
