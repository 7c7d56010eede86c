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

"""Recorded drives: direction of travel against what others found, and turns of the right camera."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from landmark_making import Frame

from stereo_selfcal import StereoRig
from stereo_selfcal.bags import StereoBag
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.drive.travel import estimate_travel, steps_of
from stereo_selfcal.core.drive.travel_vergence import vergence_of_parallax, vergence_of_travel
from stereo_selfcal.core.estimators.coarse_road import find_coarse_road
from stereo_selfcal.core.estimators.landmarks import describe_points
from stereo_selfcal.core.estimators.matched_points import match_points
from stereo_selfcal.core.evidence.road_surface import find_road_surface
from stereo_selfcal.core.geometry.alignment import optical_rotation
from stereo_selfcal.files.rig_file import read_rig_file

# May not be copied into the project (CC BY-NC-SA).
_PLACES = [folder / "shared" / "data" for folder in Path(__file__).resolve().parents[4:6]]
DATA = next((place for place in _PLACES if place.is_dir()), _PLACES[0])
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (DATA / "kitti_odometry07").is_dir(), reason=f"no recorded drives in {DATA}"),
]

# Yaw and pitch against the direction of travel by other methods [deg] (README of the data).
REFERENCES = {
    "kitti_odometry02": ((-0.29, -0.15), (0.67, 0.85)),
    "kitti_odometry07": ((-0.5, -0.1), (1.0, 1.2)),
}


def pairs(name):
    """Return the rig, and the left and right images of a drive."""
    if name == "kitti_odometry02":
        bag = StereoBag(DATA / name)
        return bag.read_rig(), [(each.left, each.right) for each in bag.frames()]
    folder = DATA / name
    images = [
        tuple(cv2.imread(str(folder / side / path.name), cv2.IMREAD_GRAYSCALE) for side in ("left", "right"))
        for path in sorted((folder / "left").iterdir())
    ]
    return read_rig_file(folder / "rig.json"), images


def turned(image, rig: StereoRig, yaw_rad):
    """Return the image of a right camera that looks farther left."""
    k = np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])
    homography = k @ optical_rotation(0.0, 0.0, yaw_rad).T @ np.linalg.inv(k)
    return cv2.warpPerspective(
        image, homography, (rig.width, rig.height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def frames(rig, images, yaw_rad=0.0):
    found = []
    for index, (left, right) in enumerate(images):
        pair = left, turned(right, rig, yaw_rad) if yaw_rad else right
        road, disparities = find_coarse_road(pair, rig, CalibratorConfig().search, 0)
        surface = find_road_surface(pair, rig, road)
        pose = None if surface is None or surface.located is None else surface.located.extrinsics
        landmarks = describe_points(left, match_points(pair, disparities))
        found.append(Frame(100.0 + 0.1 * index, landmarks, pose))
    return found


@pytest.mark.parametrize("name", REFERENCES)
def test_the_direction_of_travel_is_that_which_others_find(name):
    rig, images = pairs(name)
    steps = steps_of(frames(rig, images), rig)
    assert len(steps) > 0.9 * (len(images) - 1)
    found = estimate_travel(steps)
    for value, (low, high) in zip((found.yaw_rad, found.pitch_rad), REFERENCES[name], strict=True):
        assert low - 0.1 < math.degrees(value) < high + 0.1
    first, second = (estimate_travel(half) for half in (steps[: len(steps) // 2], steps[len(steps) // 2 :]))
    std = np.hypot(first.std, second.std)
    assert abs(first.yaw_rad - second.yaw_rad) < 2.5 * std[0]
    assert abs(first.pitch_rad - second.pitch_rad) < 2.5 * std[1]


def test_a_turn_of_the_right_camera_is_found_by_the_drive():
    rig, images = pairs("kitti_odometry02")
    found = []
    for yaw_rad in np.radians([0.0, 0.06, -0.06]):
        seen = frames(rig, images, yaw_rad)
        steps = steps_of(seen, rig)
        located = [each for each in seen if each.extrinsics is not None]
        both = vergence_of_travel(steps, located, rig), vergence_of_parallax(steps, rig)
        found.append([each.yaw_rad for each in both])
    change = np.degrees(np.array(found[1:]) - found[0])
    np.testing.assert_allclose(change, [[0.06, 0.06], [-0.06, -0.06]], atol=0.012)
