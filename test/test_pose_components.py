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

"""The components of a pose stand in one place: whoever adds one there finds it everywhere."""

import ast
import json
import os
import shutil
import subprocess
import sys
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from stereo_selfcal.core.geometry.pose import POSE_COMPONENTS, Extrinsics

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "stereo_selfcal"
PLACE = PACKAGE / "core" / "geometry" / "pose.py"
# The options of a rendered scene are those of the renderer, which has more of them than a pose has numbers.
OPTIONS_OF_SYNTH = PACKAGE / "cli" / "synth.py"

NAMES = {component.name for component in POSE_COMPONENTS}
STD_NAMES = {component.std_name for component in POSE_COMPONENTS}
LABELS = {component.label for component in POSE_COMPONENTS}

# What has to be written to add a component: a field and a line of the table.
FIELD = "    roll_rad: float\n"
LINE = "# Names of the values and of their standard deviations"
NEW_FIELD = "    tilt_rad: float = 0.0\n"
NEW_LINE = 'POSE_COMPONENTS += (PoseComponent("tilt_rad", DEGREES, DEGREES, "+", "Tilt, > 0: left"),)\n'

# Says of every place that people or programs read what it has of a pose. No images are needed: a source that
# gives none is a recording that is gone.
SCRIPT = """
import json
import sys
from types import SimpleNamespace

import numpy as np

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.cli.report import as_dict, table_header, table_row
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.drive.drive import Drive, DriveChange, DriveSegment
from stereo_selfcal.core.errors import SelfcalError
from stereo_selfcal.files.result_file import format_result, result_parameters
from stereo_selfcal.fleet.index import index_page
from stereo_selfcal.fleet.outcome import BagOutcome
from stereo_selfcal.fleet.table import csv_of
from stereo_selfcal.offline import FrameRow, Replay, Selection, as_csv
from stereo_selfcal.pictures.verdict import verdict_of
from stereo_selfcal.report.page import render_report


def no_image(row):
    raise SelfcalError("the recording is gone")


rig = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
pose = Extrinsics(1.4, 0.05, -0.01, 0.02)
result = CalibrationResult("fine", extrinsics=pose, covariance=np.diag([1e-6] * 4), stamp_s=1.0, n_frames=3)
row = FrameRow.from_result(result, 1.0)
segments = tuple(DriveSegment(start, start + 1.0, result, pose, pose) for start in (0.0, 2.0))
drive = Drive(result, segments, (DriveChange(1.5, 0.5, pose, pose, np.ones(4)),), judged=True)
replay = Replay((row,) * 3, drive, rig, CalibratorConfig())
outcome = BagOutcome.from_replay("bag", replay, ("/left", "/right"))
source = SimpleNamespace(
    rig=rig,
    name="bag",
    left_name="/left",
    right_name="/right",
    n_images=(3, 3),
    selection=Selection(),
    frame_at=no_image,
)
found = {
    "result file": format_result(result, rig, "bag", 0),
    "parameters": " ".join(result_parameters(result)),
    "JSON": json.dumps(as_dict(replay)),
    "CSV": as_csv([row]),
    "table": table_header() + table_row(row),
    "fleet's CSV": csv_of([outcome]),
    "fleet's index": index_page([outcome], ""),
    "sentence": pose.describe(pose),
    "picture": verdict_of(result).lines[0],
    "report": render_report(source, replay),
}
assert BagOutcome.from_mapping(outcome.to_mapping()) == outcome
if "rclpy" in sys.argv:
    from stereo_selfcal.ros import diagnostics, parameters
    from stereo_selfcal.ros.calibration_keeper import ActiveCalibration

    report = diagnostics.CalibrationReport("calibrated", active=ActiveCalibration(result, rig, 0.0))
    found["diagnostics"] = " ".join(diagnostics._estimate(report))
    found["descriptions of parameters"] = json.dumps(parameters._RESULT_DESCRIPTION)
print(json.dumps(found))
"""
# Words by which the new component is found; the column in the table has its unit.
WORDS = {
    "result file": ("tilt_rad: 0.02", "tilt_std_rad: 0.001"),
    "parameters": ("extrinsics.tilt_rad", "extrinsics.tilt_std_rad"),
    "JSON": ('"tilt_rad": 0.02',),
    "CSV": ("tilt_rad", "tilt_std_rad"),
    "table": ("tilt [deg]", "+1.146"),
    "fleet's CSV": ("tilt_rad", "tilt_std_rad"),
    "fleet's index": ("<th>tilt [deg]</th>", ">+1.146 &plusmn; 0.057<"),
    "sentence": ("tilt +1.1459 deg (std 1.1459)",),
    "picture": ("tilt +1.146 deg (std 0.0573)",),
    "report": ("<td>Tilt</td>", 'data-label="Tilt"', '<th class="n">Tilt</th>', "Tilt [deg]", "Tilt: RMS"),
    "diagnostics": ("tilt",),
    "descriptions of parameters": (
        "Tilt, > 0: left [rad]",
        "Standard deviation of the tilt [rad]",
    ),
}


def test_components_are_the_fields_of_a_pose_in_the_order_of_its_array():
    assert [component.name for component in POSE_COMPONENTS] == [field.name for field in fields(Extrinsics)]
    values = np.arange(len(POSE_COMPONENTS)) + 1.0
    pose = Extrinsics.from_array(values)
    assert [component.of(pose) for component in POSE_COMPONENTS] == list(values)
    assert list(pose.as_dict()) == [component.name for component in POSE_COMPONENTS]


def test_names_of_values_and_standard_deviations_are_the_public_ones():
    assert [component.name for component in POSE_COMPONENTS] == ["height_m", "pitch_rad", "roll_rad"]
    stds = [component.std_name for component in POSE_COMPONENTS]
    assert stds == ["height_std_m", "pitch_std_rad", "roll_std_rad"]
    assert [component.heading for component in POSE_COMPONENTS] == ["height [m]", "pitch [deg]", "roll [deg]"]


def test_pose_by_name_there_and_back():
    pose = Extrinsics(1.4, 0.05, -0.01)
    assert pose.as_dict() == {"height_m": 1.4, "pitch_rad": 0.05, "roll_rad": -0.01}
    assert Extrinsics.from_mapping(pose.as_dict() | {"lane_yaw_rad": 0.1}) == pose
    assert Extrinsics.from_mapping({"height_m": "1.4", "pitch_rad": 0, "roll_rad": 1}) == Extrinsics(
        1.4, 0, 1
    )


@pytest.mark.parametrize(
    ("change", "error"),
    [({"pitch_rad": None}, TypeError), ({"pitch_rad": "up"}, ValueError), ({"pitch": 1.0}, KeyError)],
)
def test_pose_by_name_is_refused_where_a_component_is_wrong_or_missing(change, error):
    values = {"height_m": 1.4, "roll_rad": 0.0} | change
    with pytest.raises(error):
        Extrinsics.from_mapping(values)


def texts_in(node: ast.AST) -> set[str]:
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}


def attributes_of(node: ast.AST) -> set[str]:
    """Return the attributes in a literal, also those inside a call such as `float(pose.roll_rad)`."""
    return {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def lists_all_components(node: ast.AST) -> bool:
    """Whether a literal, or a text that is put together, has a part for each component of a pose."""
    if isinstance(node, ast.JoinedStr):
        text = " ".join(sorted(texts_in(node)))
        return all(label in text.lower() for label in LABELS) and attributes_of(node) >= NAMES
    if isinstance(node, ast.Tuple | ast.List | ast.Set | ast.Dict):
        texts = texts_in(node)
        return any(all_of <= texts for all_of in (NAMES, STD_NAMES, LABELS)) or attributes_of(node) >= NAMES
    return False


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ('("height_m", "pitch_rad", "roll_rad")', True),
        ('{"height": 1, "pitch": 2, "roll": 3}', True),
        ('[("height", "m"), ("pitch", "deg"), ("roll", "deg")]', True),
        ('("height_m", "lane_yaw_rad")', False),
        ("(pose.height_m, float(pose.pitch_rad), pose.roll_rad)", True),
        ("Extrinsics(pose.height_m, pose.pitch_rad, 0.0)", False),
        ('f"height {a.height_m} m, pitch {a.pitch_rad}, roll {a.roll_rad}"', True),
        ('f"{a.height_m} m"', False),
    ],
)
def test_a_list_of_the_components_is_recognised(source, expected):
    assert any(map(lists_all_components, ast.walk(ast.parse(source)))) == expected


@pytest.mark.parametrize(
    "path",
    sorted(set(PACKAGE.rglob("*.py")) - {PLACE, OPTIONS_OF_SYNTH}),
    ids=lambda p: str(p.relative_to(PACKAGE)),
)
def test_no_other_module_lists_the_components(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        assert not lists_all_components(node), f"line {node.lineno}: take POSE_COMPONENTS of geometry/pose.py"


@pytest.fixture(scope="module")
def with_tilt(tmp_path_factory) -> dict[str, str]:
    """Add a component to a copy of the package, and return what each place says of a pose then."""
    root = tmp_path_factory.mktemp("with_tilt")
    copy = shutil.copytree(PACKAGE, root / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
    place = copy / PLACE.relative_to(PACKAGE)
    text = place.read_text(encoding="utf-8")
    assert text.count(FIELD) == text.count(LINE) == 1
    place.write_text(text.replace(FIELD, FIELD + NEW_FIELD).replace(LINE, NEW_LINE + LINE), encoding="utf-8")
    ros = ["rclpy"] if find_spec("rclpy") else []
    path = os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, *ros],
        cwd=root,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


@pytest.mark.parametrize("place", WORDS)
def test_a_component_that_is_added_appears_in(place, with_tilt):
    if place not in with_tilt:
        pytest.skip("needs rclpy")
    for words in WORDS[place]:
        assert words in with_tilt[place]
