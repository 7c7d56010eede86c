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

"""The direction of travel in the report: the yaw of each step, and the camera in the car from above."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from travel_making import YAW, step

pytest.importorskip("jinja2")

from stereo_selfcal import CalibrationResult, CalibratorConfig, Extrinsics
from stereo_selfcal.bags import BagError
from stereo_selfcal.core.drive.drive import Drive, DriveSegment
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.offline import FrameRow, Replay, Selection
from stereo_selfcal.report.page import render_report
from stereo_selfcal.report.vehicle import vehicle_section, yaw_chart
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, 0.05, 0.0)
N_FRAMES = 21


def travel(yaw_rad=YAW, std_rad=0.001, lever_m=0.0):
    return Travel(yaw_rad, 0.03, np.diag([std_rad, 1e-3]) ** 2, N_FRAMES - 1, lever_m, 2.0)


def replay(told, steps=()):
    """Return a recording of 2 s from 100 s on, with its direction of travel and its steps."""
    good = CalibrationResult("fine", extrinsics=POSE, covariance=np.eye(3) * 1e-6, n_frames=N_FRAMES)
    rows = tuple(FrameRow.from_result(good, 100.0 + 0.1 * index) for index in range(N_FRAMES))
    estimate = replace(good, travel=told)
    drive = Drive(estimate, (DriveSegment(100.0, 102.0, estimate, POSE, None),))
    return Replay(rows, drive, PAPER_RIG, CalibratorConfig(), travel_steps=tuple(steps))


def page(outcome):
    def no_image(_):
        raise BagError("no picture here")

    names = {"name": "bag", "left_name": "/left", "right_name": "/right", "n_images": (3, 3)}
    return render_report(
        SimpleNamespace(**names, selection=Selection(), rig=PAPER_RIG, frame_at=no_image), outcome
    )


def elements(svg, kind):
    return [e for e in ElementTree.fromstring(svg).iter() if kind in (e.get("class") or "").split()]


def rows_of_dots(svg):
    (path,) = elements(svg, "frame")
    return np.array([float(row) for row in re.findall(r"M\S+ (\S+?)h0", path.get("d"))])


def test_each_step_is_a_dot_and_the_mount_a_level_with_its_band():
    """Steps to either side of the mean by 0.2 deg: their dots are as far from its line, in the same units."""
    off_rad = math.radians(0.2)
    steps = [step(i, yaw=YAW + (off_rad if i % 2 else -off_rad)) for i in range(N_FRAMES - 1)]
    (chart,) = yaw_chart(replay(travel(), steps))
    dots = rows_of_dots(chart["svg"])
    (line,), (band,) = (elements(chart["svg"], kind) for kind in ("mount", "band"))
    assert len(dots) == len(steps)
    level, px_per_deg = float(line.get("y1")), float(band.get("height")) / 2.0 / math.degrees(0.001)
    assert level - dots[1::2] == pytest.approx(0.2 * px_per_deg, abs=0.3)
    assert dots[::2] - level == pytest.approx(0.2 * px_per_deg, abs=0.3)


def test_in_bends_the_dots_have_what_the_lever_does_taken_off():
    """A camera 1.3 m ahead of the rear axle moves outwards in a bend; the mean does not."""
    lever_m, curvature = 1.3, 0.02
    steps = [step(i) for i in range(10)]
    steps += [step(i, yaw=YAW - lever_m * curvature, turn=curvature) for i in range(10, 20)]
    charts = (yaw_chart(replay(travel(lever_m=each), steps))[0] for each in (lever_m, 0.0))
    with_lever, without = (np.ptp(rows_of_dots(chart["svg"])) for chart in charts)
    assert with_lever < 0.05 * without


@pytest.mark.parametrize("unknown", [None, travel(std_rad=math.radians(1.01))])
def test_nothing_is_shown_while_the_yaw_is_unknown(unknown):
    outcome = replay(unknown, [step(i) for i in range(N_FRAMES - 1)])
    assert yaw_chart(outcome) == [] and vehicle_section(outcome.estimate) is None
    text = page(outcome)
    assert (
        'id="vehicle"' not in text and "Yaw [deg]" not in text and "</span> direction of travel" not in text
    )
    assert text == page(replace(outcome, travel_steps=()))


def test_steps_that_tell_less_than_any_mount_are_no_dots():
    """Of 5 cm, where a millimetre of noise is more than a degree of their direction; and backwards."""
    short = [step(i, way_m=0.051) for i in range(5)] + [step(i, way_m=-1.0) for i in range(5, 8)]
    assert yaw_chart(replay(travel(), short)) == []
    (chart,) = yaw_chart(replay(travel(), [*short, step(9)]))
    assert len(rows_of_dots(chart["svg"])) == 1


def test_the_page_has_chart_sketch_and_words():
    text = page(replay(travel(), [step(i) for i in range(N_FRAMES - 1)]))
    assert "Yaw [deg], against the direction of travel" in text
    assert (
        "The camera points 0.69° (standard deviation 0.057°) to the left of the direction of travel" in text
    )
    assert "The yaw is drawn 20 times as large as it is." in text
    assert text.index('id="course"') < text.index('id="vehicle"') < text.index('id="refusals"')


def angle_drawn_deg(section):
    """Return by how much the drawn heading of the camera is turned to the left of the direction of travel."""
    drawn = elements(section["svg"], "of-camera")
    (heading,) = [e for e in drawn if e.get("class") == "of-camera" and e.get("x1")]
    x1, y1, x2, y2 = (float(heading.get(name)) for name in ("x1", "y1", "x2", "y2"))
    return math.degrees(math.atan2(y1 - y2, x2 - x1))


@pytest.mark.parametrize(
    ("yaw_deg", "factor", "words"),
    [
        (0.4, 50, "to the left"),
        (-0.4, 50, "to the right"),
        (-1.1, 20, "to the right"),
        (2.9, 5, "to the left"),
        (20.0, 1, "to the left"),
    ],
)
def test_the_sketch_says_how_much_it_exaggerates(yaw_deg, factor, words):
    section = vehicle_section(replay(travel(math.radians(yaw_deg))).estimate)
    assert angle_drawn_deg(section) == pytest.approx(factor * yaw_deg, abs=0.1)
    assert words in section["sentence"]
    assert (f"drawn {factor} times as large" in section["drawn"]) == (factor > 1)


def test_a_large_yaw_is_drawn_smaller_and_said_so():
    section = vehicle_section(replay(travel(math.radians(-60.0))).estimate)
    assert angle_drawn_deg(section) == pytest.approx(-25.0, abs=0.1)
    assert "smaller than it is" in section["drawn"]


@pytest.mark.parametrize("yaw_deg", [-60.0, -2.9, -0.4, 0.0, 0.4, 2.9, 60.0])
def test_no_text_of_the_sketch_is_cut_off_and_none_overlap(yaw_deg):
    """Not on a phone either, where letters are 22 units high and at most 0.62 as wide on average."""
    svg = vehicle_section(replay(travel(math.radians(yaw_deg))).estimate)["svg"]
    _, _, width, height = map(float, ElementTree.fromstring(svg).get("viewBox").split())
    boxes = []
    for text in (e for e in ElementTree.fromstring(svg).iter() if e.tag.endswith("text")):
        x, y, long = float(text.get("x")), float(text.get("y")), 0.62 * 22 * len(text.text)
        left = x - {"middle": long / 2, "end": long}.get(text.get("class").split()[-1], 0.0)
        boxes.append((left, y - 18, left + long, y + 5))
    for number, (left, top, right, bottom) in enumerate(boxes):
        assert left >= 0 and top >= 0 and right <= width and bottom <= height
        for a, b, c, d in boxes[:number]:
            assert right <= a or c <= left or bottom <= b or d <= top
