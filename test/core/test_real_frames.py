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

"""Real frames against lidar and dense disparity: what is accepted is right. Skipped where they are not."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from refusal_words import assert_says_everything

from stereo_selfcal import StereoRig, calibrate
from stereo_selfcal.bags import StereoBag

# May not be copied into the project (CC BY-NC-SA).
# Beside the checkout, or beside the folder it is in.
_PLACES = [folder / "shared" / "data" for folder in Path(__file__).resolve().parents[3:5]]
DATA = next((place for place in _PLACES if place.is_dir()), _PLACES[0])
FRAMES, BAG = DATA / "kitti_frames", DATA / "kitti_odometry02"
pytestmark = pytest.mark.skipif(not FRAMES.is_dir(), reason=f"no real frames in {DATA}")

READABLE = np.array([1e3, np.degrees(1.0), np.degrees(1.0)])
# Beyond this a result is wrong, whatever it says of itself [mm, deg, deg].
WRONG = np.array([60.0, 0.5, 1.2])


def frame(name):
    """Return rig, both images and the pose by lidar, 15 mm lower as the stereo pair sits (mm, deg, deg)."""
    rig = StereoRig(**json.loads((FRAMES / "rig.json").read_text()))
    left, right = (
        cv2.imread(str(FRAMES / side / f"{name}.png"), cv2.IMREAD_GRAYSCALE) for side in ("left", "right")
    )
    with (FRAMES / "truth.csv").open(newline="") as lines:
        row = next(row for row in csv.DictReader(lines) if row["id"] == name)
    lidar = [float(row[f"lidar_{value}"]) for value in ("height_m", "pitch_deg", "roll_deg")]
    return rig, left, right, np.array(lidar) * [1e3, 1, 1] - [15.0, 0.0, 0.0]


def error(result, reference):
    return np.abs(result.extrinsics.as_array() * READABLE - reference)


@pytest.mark.parametrize(
    ("name", "last"),
    [
        ("000036", "combined"),  # two lines that both cameras see well
        ("000076", "combined"),  # two of several lines
        ("000107", "combined"),
        ("000063", "combined"),  # two lines, of which one may be a kerb
        ("000040", "textured"),  # one line
        ("000109", "combined"),  # a bend
        ("000043", "combined"),  # a crossing
        ("000089", "combined"),  # in a bend, standing
        ("000149", "textured"),  # clutter, and no pair of lines
    ],
)
def test_roads_are_calibrated(name, last):
    rig, left, right, lidar = frame(name)
    result = calibrate(left, right, rig)
    assert result.accepted, result.message
    assert list(result.stages)[-1] == last
    assert np.all(error(result, lidar) < WRONG)
    assert np.all(error(result, lidar) < 4 * result.std.as_array() * READABLE)


@pytest.mark.parametrize("name", ["000002", "000112"])
def test_clutter_without_a_road_is_refused_with_a_reason(name):
    rig, left, right, _ = frame(name)
    result = calibrate(left, right, rig)
    assert not result.accepted
    assert_says_everything(result.rejection)


@pytest.mark.skipif(not BAG.is_dir(), reason=f"no recording in {DATA}")
@pytest.mark.parametrize("index", [1, 18, 19])
def test_kerbs_beside_the_line_are_not_taken_for_it(index):
    """With the lines alone these frames were 65 to 70 mm and 1.2 to 2.5 deg of roll off."""
    recording = StereoBag(BAG)
    pair = next(pair for i, pair in enumerate(recording.frames()) if i == index)
    result = calibrate(pair.left, pair.right, recording.read_rig())
    plane = np.loadtxt(DATA / "kitti_odometry02_stereo_plane.csv", delimiter=",", skiprows=1)[index, 1:]
    # That plane is 4 mm low and 0.1 deg nose-up on frames with lidar.
    assert not result.accepted or np.all(error(result, plane * [1e3, 1, 1] + [4.0, 0.1, 0.0]) < WRONG / 2)
