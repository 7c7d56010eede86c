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

"""limits: what it prints and draws, and what it refuses."""

import json
import math

import cv2
import numpy as np
import pytest

from stereo_selfcal import Extrinsics, StereoRig
from stereo_selfcal.cli.chart import Curve, Panel, draw_charts, log_ticks, spread
from stereo_selfcal.cli.limits import main
from stereo_selfcal.core.analysis.cramer_rao import limits, location_std
from stereo_selfcal.synth.scenes import PAPER_RIG

WIDE_RIG = StereoRig(1280, 720, 900.0, 905.0, 640.0, 350.0, 0.5)


def asked(capsys, *options):
    """Return the JSON object for some options."""
    assert main([*options, "--json"]) == 0
    out, err = capsys.readouterr()
    assert (err, out.count("\n")) == ("", 1)
    return json.loads(out)


def test_table_names_every_figure_with_its_unit(capsys):
    assert main(["--pitch-deg", "4", "--noise", "0.05", "--psf-px", "0"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    rows = {line[:21].strip(): line[21:].split() for line in out.splitlines()[6:]}
    # The example of issue 3.
    assert rows["height"] == ["0.542", "mm"]
    assert rows["pitch"] == ["0.000573", "deg"]
    assert rows["roll"] == ["0.0177", "deg"]
    assert [label for label in rows if label.startswith("location")] == [
        "location at 10 m",
        "location at 20 m",
        "location at 30 m",
        "location at 50 m",
    ]
    value, unit, percent, sign = rows["location at 30 m"]
    assert (unit, sign) == ("mm", "%")
    assert float(percent) == pytest.approx(float(value) / 30e3 * 100, rel=0.01)
    assert "148.1 mm" in out and "noise 5 %" in out
    assert max(map(len, out.splitlines())) <= 100


def test_json_has_what_the_core_computes(capsys):
    options = (
        "--height-m",
        "1.2",
        "--pitch-deg",
        "2",
        "--noise",
        "0.1",
        "--contrast",
        "80",
        "--psf-px",
        "0.7",
    )
    found = asked(capsys, *options, "--lane-width-m", "3.0", "--line-width-m", "0.15")
    pose = Extrinsics(1.2, math.radians(2), 0.0)
    expected = limits(
        PAPER_RIG,
        pose,
        line_positions_m=(1.5, -1.5),
        line_width_m=0.15,
        contrast=80,
        noise_grey=25.5,
        psf_sigma_px=0.7,
    )
    assert found["covariance"] == expected.tolist()
    assert list(found["std"].values()) == np.sqrt(np.diag(expected)).tolist()
    assert list(found["std"]) == ["height_m", "pitch_rad", "roll_rad"]
    assert found["location"] == [
        {"distance_m": d, "std_m": location_std(expected, PAPER_RIG, pose, d)}
        for d in (10.0, 20.0, 30.0, 50.0)
    ]
    assert StereoRig.from_mapping(found["rig"]) == PAPER_RIG


def test_frames_are_averaged(capsys):
    one, hundred = asked(capsys), asked(capsys, "--frames", "100")
    assert hundred["std"]["height_m"] == pytest.approx(one["std"]["height_m"] / 10)
    assert hundred["location"][2]["std_m"] == pytest.approx(one["location"][2]["std_m"] / 10)


@pytest.mark.parametrize("name", ["rig.yaml", "rig.json"])
def test_rig_file(tmp_path, capsys, name):
    path = tmp_path / name
    path.write_text(json.dumps(WIDE_RIG.to_mapping()))
    found = asked(capsys, "--rig", str(path))
    assert StereoRig.from_mapping(found["rig"]) == WIDE_RIG
    assert found["std"]["height_m"] < asked(capsys)["std"]["height_m"] / 3


def test_ros_arguments_are_passed_over(capsys):
    assert asked(capsys, "--ros-args", "-r", "a:=b", "--") == asked(capsys)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--noise", "0"], "--noise"),
        (["--noise", "nan"], "--noise"),
        (["--noise", "1.5"], "at most 1"),
        (["--contrast", "300"], "--contrast"),
        (["--height-m", "-1"], "--height-m"),
        (["--height-m", "inf"], "--height-m"),
        (["--height-m", "high"], "invalid number value: 'high'"),
        (["--psf-px", "-1"], "at least 0"),
        (["--frames", "0"], "0 is not in 1 ... "),
        (["--lane-width-m", "0.1"], "the lines would overlap"),
        (["--pitch-deg", "-50"], "cannot be determined"),
        (["--rig", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
        (["--plot", "nowhere/limits.png"], "choose a writable folder"),
        (["--plot", "limits.svg"], "limits.svg: charts are written as PNG"),
        (["extra"], "extra"),
    ],
)
def test_refusals_are_one_line(tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert main(options) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("limits: ")
    assert message in err
    assert not list(tmp_path.iterdir())


def test_help_names_the_defaults(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert "(default: 1.4)" in out and "exit status" in out


@pytest.mark.slow
def test_plot(tmp_path, capsys):
    path = tmp_path / "limits.PNG"
    assert main(["--plot", str(path), "--noise", "0.05"]) == 0
    assert "height" in capsys.readouterr().out
    picture = cv2.imread(str(path))
    assert picture.shape[1] > 1000
    colours = set(map(tuple, picture.reshape(-1, 3)[::3].tolist()))
    assert {(178, 114, 0), (0, 94, 213), (115, 158, 0)} <= colours, "three curves"


@pytest.mark.slow
def test_plot_of_an_unusual_rig_and_noise(tmp_path):
    rig = tmp_path / "rig.json"
    rig.write_text(json.dumps(WIDE_RIG.to_mapping() | {"baseline_m": 0.03}))
    path = tmp_path / "limits.png"
    assert main(["--rig", str(rig), "--noise", "0.4", "--plot", str(path)]) == 0
    assert cv2.imread(str(path)) is not None


def test_curves_are_drawn_where_the_axes_say():
    panel = Panel("title", "x", (1.0, 100.0), (Curve("a", (1.0, 100.0)),), point=(10.0, 10.0))
    picture = draw_charts("", [[panel]])
    blue = np.argwhere((picture == (178, 114, 0)).all(axis=2))
    (top, right), (bottom, left) = blue[blue[:, 0].argmin()], blue[blue[:, 0].argmax()]
    # The ring is white inside and lies in the middle of a straight line on logarithmic axes.
    middle = ((top + bottom) / 2, (left + right) / 2)
    assert picture[round(middle[0]), round(middle[1])].tolist() == [255, 255, 255]
    assert left < right and top < bottom


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.1, 1.0, [0.1, 0.2, 0.5, 1.0]),
        (0.8, 30.0, [1.0, 2.0, 5.0, 10.0, 20.0]),
        (1e-4, 10.0, [1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0]),
    ],
)
def test_ticks(low, high, ticks):
    assert log_ticks(low, high) == ticks


def test_names_of_curves_do_not_cover_each_other():
    moved = spread([100.0, 101.0, 99.0, 300.0], 10.0)
    assert sorted(moved)[1:] - np.array(sorted(moved)[:-1]) == pytest.approx(
        [10.0, 10.0, moved[3] - moved[1]], abs=0.1
    )
    assert moved[2] < moved[0] < moved[1]
    assert spread([5.0, 50.0], 10.0) == [5.0, 50.0]
