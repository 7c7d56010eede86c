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

"""The report: one file that stands alone, whatever became of the recording."""

import math
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from drive_making import make_drive
from result_making import TRAVEL

pytest.importorskip("jinja2")

from stereo_selfcal.cli.replay import main
from stereo_selfcal.core.drive.drive import estimate_drive, fuse_frames
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.core.evidence.gates import GATES
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.pose import Extrinsics
from stereo_selfcal.core.geometry.uncertainty import TERMS
from stereo_selfcal.core.rejection import Bound, GateReading, RejectReason
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.offline import BagSource, Goal, calibrate_recording
from stereo_selfcal.offline.run import look_again
from stereo_selfcal.report import pictures
from stereo_selfcal.report.mount import how_reached
from stereo_selfcal.report.page import render_report
from stereo_selfcal.report.remedies import remedies, remedy_of
from stereo_selfcal.report.travel import travel_sentence
from stereo_selfcal.report.uncertainty import contributions

ROOT = Path(__file__).resolve().parent.parent.parent
VOID = {"meta", "img", "br", "rect", "line", "path", "link", "input", "hr"}


class Page(HTMLParser):
    """Checks that elements are closed, and keeps what can be asked about."""

    def __init__(self, text):
        super().__init__()
        self.open, self.sections, self.sources, self.words, self.tags = [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        given = dict(attributes)
        if tag == "section":
            self.sections.append(given["id"])
        self.sources += [given[name] for name in ("src", "href", "srcset", "data") if name in given]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


SEEN_AGAIN = {}


@pytest.fixture(autouse=True)
def seen_again_once(monkeypatch):
    """Read and calibrate a frame that many reports here show once only; a row says which frame it is."""

    def look_again_once(source, row, config=None):
        key = source, row.recorded_ns, config
        if key not in SEEN_AGAIN:
            SEEN_AGAIN[key] = look_again(source, row, config)
        return SEEN_AGAIN[key]

    monkeypatch.setattr(pictures, "look_again", look_again_once)


@pytest.fixture(scope="module")
def road():
    with BagSource([ROOT / "bags" / "straight_road"]) as source:
        yield source, calibrate_recording(source)


@pytest.fixture(scope="module")
def nothing():
    with BagSource([ROOT / "bags" / "no_lines"]) as source:
        yield source, calibrate_recording(source)


@pytest.fixture(scope="module")
def bend():
    with BagSource([ROOT / "bags" / "curve"]) as source:
        yield source, calibrate_recording(source)


@pytest.fixture(scope="module")
def road_text(road):
    return render_report(*road)


def test_parts_of_a_calibrated_recording(road, road_text):
    page = Page(road_text)
    pose = road[1].estimate.extrinsics
    height_m, pitch, roll = pose.height_m, math.degrees(pose.pitch_rad), math.degrees(pose.roll_rad)
    assert (height_m, pitch, roll) == pytest.approx((1.4, 3.0, 0.8), abs=0.01)
    assert page.sections == [
        "verdict", "estimate", "course", "progress", "alignment", "pictures", "refusals", "residuals",
        "provenance",
    ]  # fmt: skip
    where = f"The camera is {height_m:.3f} m above the road, pitched {pitch:.2f}° nose down"
    assert f"{where} and rolled {roll:.2f}° right" in page.text
    assert "p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height]" in page.text
    assert "10 of 10 frames accepted" in page.text
    for name in ("Best", "Median", "Worst"):
        assert f"{name} accepted frame" in page.text
    assert page.tags.count("img") == 6
    for piece in ("straight_road", "/stereo/left/image_rect", "516.6", "148.1 mm", "Seed", "OpenCV"):
        assert piece in page.text


def test_the_terms_of_the_uncertainty_are_a_table_with_the_sum_last(road, road_text):
    page = Page(road_text)
    estimate = road[1].estimate
    names = [TERMS[each.name] for each in contributions(estimate.uncertainty)]
    places = [page.text.index(f"{name[0].upper()}{name[1:]} ") for name in names]
    assert places == sorted(places) and len(names) >= 2
    total = estimate.std.height_m * 1e3
    assert float(re.search(r"All together ([\d.]+) [\d.]+ [\d.]+ 100 %", page.text)[1]) == pytest.approx(
        total, rel=0.01
    )
    assert re.search(rf"Height {total:.2g} mm: [\d.]+ ({chr(124).join(map(re.escape, names))})", page.text)
    assert page.text.count("The squares add up") == 1


def test_an_estimate_of_which_no_terms_are_known_has_no_such_table(road):
    source, replay = road
    segments = tuple(
        replace(each, estimate=replace(each.estimate, uncertainty=())) for each in replay.drive.segments
    )
    page = Page(render_report(source, replace(replay, drive=replace(replay.drive, segments=segments))))
    assert "What the standard deviation of the mount is made of" not in page.text
    assert "All together" not in page.text


def test_the_yaw_against_the_direction_of_travel_is_a_row_where_it_is_known(road):
    source, replay = road
    pages = {}
    for travel in (TRAVEL, None):
        segments = tuple(
            replace(each, estimate=replace(each.estimate, travel=travel)) for each in replay.drive.segments
        )
        drive = replace(replay.drive, segments=segments)
        pages[travel] = Page(render_report(source, replace(replay, drive=drive))).text
    assert "Yaw against travel -1.9099° 0.11° – – – " in pages[TRAVEL]
    assert f"{travel_sentence(TRAVEL)}." in pages[TRAVEL]
    assert "Yaw against travel" not in pages[None]
    assert f"{travel_sentence(None)}." in pages[None]


def test_what_was_tried_with_a_refused_frame_is_told(bend):
    page = Page(render_report(*bend))
    assert re.search(
        r"lines_not_straight , frame at \d+\.\d s: What was tried Verdict Why "
        r"1 Two lane lines of the whole image refused lines_not_straight "
        r"The lane lines bend to the left with a radius of [\d.]+ m, at least 1000 m needed\. "
        r"Check: straight lane",
        page.text,
    )


def test_what_was_tried_is_told_of_every_reason(nothing, bend):
    source, replay = bend
    rows = (*replay.rows, replace(nothing[1].rows[0], recorded_ns=replay.rows[0].recorded_ns))
    page = Page(render_report(source, replace(replay, rows=rows)))
    assert "no_lines_found : neither the road surface nor two lines to try in the frame." in page.text
    assert "lines_not_straight , frame at" in page.text


def test_parts_when_nothing_was_accepted(nothing):
    page = Page(render_report(*nothing))
    assert page.sections == ["verdict", "alignment", "pictures", "refusals", "residuals", "provenance"]
    assert "None of 3 frames could be used: no_lines_found (3)." in page.text
    assert f"What to do: {remedies()['no_lines_found']}" in page.text
    assert "no lane line was found in either image: the longest candidate is" in page.text
    assert "and too little of the road surface is seen: " in page.text
    assert "(2 of the 3 frames had nothing to try.)" in page.text  # in the other one, a weak surface was seen
    assert page.tags.count("img") == 2  # under the plane of the dense disparities


@pytest.mark.parametrize("which", ["road", "nothing"])
def test_it_needs_no_network_and_no_other_file(which, request):
    text = render_report(*request.getfixturevalue(which))
    page = Page(text)
    assert all(source.startswith("data:image/jpeg;base64,") for source in page.sources)
    assert "script" not in page.tags
    assert not re.search(r"https?:|@import|url\(|//[a-z]", re.sub(r"base64,[^\"]*", "", text))


def test_same_recording_same_bytes(road, road_text, monkeypatch):
    """With the frames that are shown calibrated anew."""
    monkeypatch.setattr(pictures, "look_again", look_again)
    assert render_report(*road) == road_text


def test_it_is_readable_on_a_phone_and_in_the_dark(road_text):
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in road_text
    assert "prefers-color-scheme: dark" in road_text


def test_every_reason_has_a_remedy():
    found = remedies()
    assert set(found) == {str(reason) for reason in RejectReason}
    assert all(found.values())
    for gate in GATES:
        assert found[str(gate.reason)] in {each.remedy for each in GATES if each.reason is gate.reason} or (
            gate.reason is RejectReason.LINES_NOT_MATCHED
        )


def test_names_are_text_and_not_markup(road):
    source, replay = road
    source.name, name = "<script>alert(1)</script>&amp;", source.name
    try:
        page = Page(render_report(source, replay))
    finally:
        source.name = name
    assert "script" not in page.tags
    assert "<script>alert(1)</script>&amp;" in page.text


def test_a_damaged_recording_says_so_first(road):
    source, replay = road
    page = Page(render_report(source, replace(replay, damage="the file ends early")))
    assert "Calibrated, with reservations The camera" in page.text
    assert "The recording is damaged: the file ends early." in page.text


def drive_of(road, *, steps=(), refused=()):
    """Return the recording with the rows of an hour's drive, each with a frame that is there."""
    source, replay = road
    stamps, poses, covariances = make_drive(steps=steps, rate_hz=0.2)
    rows = [
        replace(
            replay.rows[index % len(replay.rows)],
            stamp_s=float(stamp),
            extrinsics=Extrinsics.from_array(pose),
            covariance=covariance,
        )
        for index, (stamp, pose, covariance) in enumerate(zip(stamps, poses, covariances, strict=True))
    ]
    drive = estimate_drive(rows, replay.rig, fuse_frames(rows, replay.rig))
    return source, replace(replay, rows=(*rows, *refused), drive=drive)


def test_a_move_is_told_with_both_poses(road):
    text = render_report(*drive_of(road, steps=((1800.0, np.array([0.0, math.radians(1.0), 0.0])),)))
    page = Page(text)
    assert "changes" in page.sections
    assert re.search(r"The camera was moved once, at 1(89|90)\d\.\d s. Since then it is 1\.40", page.text)
    assert re.search(r"before it was 1\.\d+ m above the road, pitched (2\.9|3\.0)\d°", page.text)
    assert page.text.count("Part of the motion") >= 2
    assert page.text.count("What the standard deviation of the mount is made of") == 2, (
        "of each part of the drive"
    )
    assert page.text.count("All together") == 2
    assert page.text.count("The squares add up") == 1
    assert 'class="moved"' in text


def test_a_long_drive_without_a_move_says_that_it_was_none(road):
    page = Page(render_report(*drive_of(road)))
    assert "and did not move during 60 min." in page.text
    assert "changes" not in page.sections


def test_refusals_are_counted_with_what_to_do(road, nothing):
    refused = [replace(nothing[1].rows[0], recorded_ns=road[1].rows[0].recorded_ns, stamp_s=200.0)] * 3
    page = Page(render_report(*drive_of(road, refused=refused)))
    assert "no_lines_found 3 (0 %)" in page.text
    assert "Drive on in daylight, lens clean, where the road has texture or painted lines" in page.text
    assert "Refused: no_lines_found, as 3 of 723 frames" in page.text


def test_a_frame_that_cannot_be_read_again_has_no_picture(road):
    source, replay = road
    rows = tuple(replace(row, recorded_ns=1) for row in replay.rows)
    page = Page(render_report(source, replace(replay, rows=rows)))
    assert "img" not in page.tags
    assert page.text.count("No picture:") == 3


@pytest.mark.parametrize(
    ("value", "bound", "threshold", "used"),
    [
        (0.0, Bound.MOST, 1.0, "0 %"),
        (-2.0, Bound.MOST, 1.0, "0 %"),
        (3.0, Bound.MOST, 2.0, "150 %"),
        (1.0, Bound.MOST, 2.0, "50 %"),
        (4.0, Bound.LEAST, 1.0, "25 %"),
        (2.0, Bound.LEAST, 3.0, "150 %"),
        (-0.1, Bound.LEAST, -0.5, "20 %"),  # a pitch, and the least one searched
        (-2.0, Bound.LEAST, 1.0, "200 %"),
    ],
)
def test_gates_of_any_kind_can_be_shown(road, value, bound, threshold, used):
    source, replay = road
    passed = value >= threshold if bound is Bound.LEAST else value <= threshold
    gates = (GateReading("a_gate", "a gate", value, bound, threshold, "px", passed),)
    rows = tuple(replace(row, gates=gates) for row in replay.rows)
    page = Page(render_report(source, replace(replay, rows=rows)))
    assert f"a gate {used} {used} {0 if passed else 10} of 10" in page.text


def test_replay_writes_it(tmp_path, capsys):
    path = tmp_path / "out.html"
    assert main([str(ROOT / "bags" / "no_lines"), "--report", str(path)]) == 1
    assert "no_lines_found" in Page(path.read_text(encoding="utf-8")).text
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_without_jinja2_replay_runs_and_says_what_a_report_needs(tmp_path):
    code = (
        "import sys; sys.modules['jinja2'] = None\n"
        "from stereo_selfcal.cli.replay import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    bag = str(ROOT / "bags" / "no_lines")

    def run(*options):
        return subprocess.run(
            [sys.executable, "-c", code, bag, *options],
            cwd=ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip

    assert run().returncode == 1
    refused = run("--report", str(tmp_path / "out.html"))
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "jinja2" in refused.stderr


def test_a_reason_that_is_new_has_the_remedy_of_its_frame(nothing):
    row = nothing[1].rows[0]
    new = replace(row, reason="aliens", rejection=replace(row.rejection, remedy="leave at once"))
    assert remedy_of(new) == "leave at once"
    assert remedy_of(replace(new, rejection=None)) == ""
    assert remedy_of(row) == remedies()["no_lines_found"]


def test_reservations_of_most_frames_are_in_the_verdict(road):
    source, replay = road
    reserved = Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, "too little texture", 3)
    estimate = replace(replay.estimate, reservations=(reserved,), n_frames=4)
    told = replace(replay, drive=replace(replay.drive, estimate=estimate))
    assert told.with_reservations
    page = Page(render_report(source, told))
    assert "Calibrated, with reservations The camera" in page.text
    assert f"{reserved.sentence[1:]} (3 of 4 frames)." in page.text
    few = replace(estimate, reservations=(replace(reserved, frames=2),))
    page = Page(render_report(source, replace(replay, drive=replace(replay.drive, estimate=few))))
    assert "with reservations" not in page.text
    assert "(2 of 4 frames)" in page.text


def test_the_mount_and_a_frame_have_standard_deviations_of_their_own_names(road):
    """What a user must not mix up: the first is of the camera on the car, the second of one moment."""
    source, replay = road
    motion = Extrinsics(0.005, math.radians(0.15), math.radians(0.2))
    mount = MountEvidence(12.0, 0, 4, False, motion, np.full(3, 1.5), np.full(3, 6.0))
    (segment,) = replay.drive.segments
    wide = replace(segment.estimate, mount=mount, covariance=np.diag([0.02, 0.03, 0.04]) ** 2)
    drive = replace(replay.drive, segments=(replace(segment, estimate=wide),))
    page = Page(render_report(source, replace(replay, drive=drive)))
    own = np.median([row.covariance[0, 0] for row in replay.rows]) ** 0.5
    headings = "Standard deviation of the mount Standard deviation of a frame Scatter of the frames"
    assert headings in page.text
    assert re.search(rf"Height 1\.\d+ m 20\.?\d* mm {own * 1e3:.2g}\d* mm", page.text)
    for sentence in how_reached(mount, 10):
        assert f"{sentence}." in page.text


@pytest.mark.parametrize("reached", [True, False])
def test_what_was_asked_is_in_the_report(road, reached):
    source, replay = road
    goal = Goal(Targets(0.015), reached, reached, 10, 0.9, "" if reached else "the road is rough")
    page = Page(render_report(source, replace(replay, goal=goal)))
    assert f"Asked {goal.message}" in page.text
    said = f"{goal.message[0].upper()}{goal.message[1:]}."
    assert (said in page.text) is not reached
