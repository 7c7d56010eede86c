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

"""A right camera that has turned about the vertical, in whole frames."""

import cv2
import numpy as np
import pytest

from stereo_selfcal import RejectReason, calibrate
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene


@pytest.mark.parametrize("turn_px", [-2.0, -1.0, 1.0, 2.0])
def test_turned_camera_is_refused_with_its_angle_or_measured(turn_px):
    """Images of a textured road with two lines, the right one turned as by a rotation of its camera.

    By whole pixels, so that the images are as sharp as before. With one pixel, the surface of the road is
    refused, and the lines, which are parallel, tell both the pose and the turn.
    """
    scene = random_scene(np.random.default_rng(3), texture_amplitude=12.0)
    left, right = render(scene, np.random.default_rng(0))
    assert calibrate(left, right, scene.rig).accepted
    rig, turn_rad = scene.rig, turn_px / scene.rig.fx
    camera = np.array([[rig.fx, 0.0, rig.cx], [0.0, rig.fy, rig.cy], [0.0, 0.0, 1.0]])
    # A camera that looks farther left sees everything farther right.
    about_vertical = cv2.Rodrigues(np.array([0.0, turn_rad, 0.0]))[0]
    seen = camera @ about_vertical @ np.linalg.inv(camera)
    turned = cv2.warpPerspective(
        right, seen, right.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    result = calibrate(left, turned, scene.rig)
    assert abs(result.alignment.yaw_rad - turn_rad) < 3.0 * result.alignment.std[2]
    if result.accepted:
        error = result.extrinsics.as_array() - scene.extrinsics.as_array()
        assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(result.covariance)))
        assert abs(result.alignment.yaw_rad) > 5.0 * result.alignment.std[2]
        return
    assert result.reason is RejectReason.IMAGES_NOT_RECTIFIED
    assert f"farther to the {'left' if turn_px > 0 else 'right'}" in result.message
