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

"""The right camera's turn in the report: the verdict, the angles, and the frames that tell them."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("jinja2")

from stereo_selfcal import CalibrationResult, CalibratorConfig, Extrinsics
from stereo_selfcal.bags import BagError
from stereo_selfcal.core.drive.drive import Drive, DriveSegment
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.offline import FrameRow, Replay, Selection
from stereo_selfcal.report.alignment import alignment_section
from stereo_selfcal.report.page import render_report
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.05, 0.01)
REFUSED = rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines", 1, Bound.LEAST, 2, "", "drive on"))


def turned(yaw_deg=0.0, std_deg=(0.002, 0.004, 0.005)):
    return Alignment(0.0, 0.0, math.radians(yaw_deg), np.diag(np.square(np.radians(std_deg))))


def replay(fused, frames):
    """Return a recording: the alignment of all its frames, and that of each, the odd ones refused."""
    good = CalibrationResult("fine", extrinsics=POSE, covariance=np.eye(3) * 1e-6, n_frames=3)
    rows = tuple(
        FrameRow.from_result(replace(REFUSED if index % 2 else good, alignment=each), float(index))
        for index, each in enumerate(frames)
    )
    estimate = replace(good, alignment=fused)
    segment = DriveSegment(0.0, float(len(frames)), estimate, POSE, None)
    return Replay(rows, Drive(estimate, (segment,)), PAPER_RIG, CalibratorConfig())


def page(outcome):
    def no_image(_):
        raise BagError("no picture here")

    source = SimpleNamespace(
        name="bag",
        left_name="/left",
        right_name="/right",
        n_images=(3, 3),
        selection=Selection(),
        rig=PAPER_RIG,
        frame_at=no_image,
    )
    return render_report(source, outcome)


def dots(section, title):
    (svg,) = (chart["svg"] for chart in section["charts"] if chart["title"].startswith(title))
    return svg.split('class="frame')[1].split("/>")[0].count("M"), svg.count('class="band"')


def test_camera_that_has_turned_is_in_the_verdict_and_in_a_section_of_its_own():
    text = page(replay(turned(0.14), [turned(0.13), turned(0.15), turned(0.14)]))
    section = text[text.index('<section id="alignment">') :]
    sentence = "The right camera looks 0.140 ± 0.005° too far left: depths are too large, by 16 % at 10 m"
    assert text.index(sentence) < text.index('<section id="alignment">'), "among the doubts of the verdict"
    assert ">Correctable</b>" in section and sentence in section
    row = re.search(r"<tr><td><b>Yaw</b>.*?</tr>", section, re.DOTALL)[0]
    assert re.findall(r">([^<>]+)</td>", row) == ["&gt; 0: too far left", "+0.140°", "0.005°", "0.03°", "yes"]
    for angle in ("Pitch", "Roll", "Yaw"):
        assert f"<h3>{angle} of the right camera [deg]</h3>" in section


def test_good_one_is_no_doubt():
    text = page(replay(turned(), [turned()] * 3))
    assert ">Good</b>: Depths are right to " in text
    assert text.count("Depths are right to ") == 1


def test_frames_that_do_not_tell_an_angle_are_no_dots():
    """A frame without far things and lines has the yaw anywhere: a dot at zero would be a lie."""
    unseen = turned(0.0, (0.002, 0.004, 0.29))
    section = alignment_section(replay(turned(0.14), [turned(0.13), unseen, turned(0.14), unseen]))
    assert dots(section, "Yaw") == (2, 1)
    assert dots(section, "Pitch") == (4, 1)
    none = alignment_section(replay(unseen, [unseen] * 3))
    assert [chart["title"].split()[0] for chart in none["charts"]] == ["Pitch", "Roll"]
    assert none["word"] == "Not seen well enough"
    assert none["lines"][2][2:] == ["+0.000°", "0.290°", "0.03°", "no"]


def test_of_a_recording_without_a_calibration_the_frames_are_shown():
    outcome = replay(None, [turned(0.14)] * 3)
    section = alignment_section(replace(outcome, drive=Drive(replace(REFUSED, alignment=turned(0.14)))))
    assert section["sentence"].startswith("The right camera looks 0.140 ± 0.005° too far left")
    assert dots(section, "Yaw") == (3, 1)


def test_there_is_none_where_nothing_was_measured():
    outcome = replay(None, [None] * 3)
    assert alignment_section(outcome) is None
    assert '<section id="alignment">' not in page(outcome)
