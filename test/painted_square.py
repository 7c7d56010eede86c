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

"""A square painted on a rendered road 10 m ahead, and where a transform of the camera puts it.

It shares no geometry with the program but the renderer: turns are written out by Rodrigues' formula, and the
square is measured in the left image itself, as the centre of what is brighter than the road.
"""

import math
from dataclasses import replace

import numpy as np

from stereo_selfcal import CalibrationResult, StereoRig
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.geometry.vehicle import PlaceInVehicle
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import custom_scene
from stereo_selfcal.synth.world import ASPHALT_GREY, LaneLine, Photometry, Road

RIG = StereoRig(1280, 720, 900.0, 880.0, 655.0, 350.0, 0.3)
YAW_RAD, LATERAL_M = math.radians(2.5), 0.4
PLACE = PlaceInVehicle(1.7, -0.25)
# In the lane's frame: ahead of the middle of the baseline, and left of the lane's middle.
AHEAD_M, LEFT_M, SIDE_M = 10.0, -1.1, 0.3
# In the vehicle's frame, which travels along the lane: the middle of the baseline is at PLACE.
TRUTH_M = np.array([AHEAD_M + PLACE.x_m, LEFT_M - LATERAL_M + PLACE.y_m, 0.0])
# A pixel of this camera covers 7 cm of road there.
TOLERANCE_M = 0.01

_SCENE = custom_scene(
    height_m=1.4,
    pitch_rad=math.radians(3.0),
    roll_rad=math.radians(-1.5),
    lane_yaw_rad=YAW_RAD,
    lateral_offset_m=LATERAL_M,
    rig=RIG,
).scene
_SQUARE = LaneLine(LEFT_M, SIDE_M, dash_m=SIDE_M, gap_m=1000.0, phase_m=AHEAD_M - SIDE_M / 2)
SCENE = replace(
    _SCENE,
    road=Road(lines=(_SQUARE,), texture_amplitude=0.0),
    left=Photometry(),
    right=Photometry(),
)


def calibrated(yaw_known=True):
    """Return the truth of the scene as a result."""
    variance = math.radians(0.05) ** 2
    travel = Travel(YAW_RAD, SCENE.extrinsics.pitch_rad, np.diag([variance, variance]), 50, 1.3, 30.0)
    return CalibrationResult(
        "good",
        extrinsics=SCENE.extrinsics,
        covariance=np.diag([1e-3, 1e-4, 1e-4]) ** 2,
        n_frames=9,
        travel=travel if yaw_known else None,
    )


def about(axis, angle):
    """Return the rotation about an axis: Rodrigues' formula, written out."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def fixed_axes(roll, pitch, yaw):
    """Return the rotation about the fixed axes x, then y, then z."""
    x, y, z = np.eye(3)
    return about(z, yaw) @ about(y, pitch) @ about(x, roll)


def of_quaternion(q):
    """Return the rotation of a geometry_msgs/Quaternion."""
    length = math.sqrt(q.x**2 + q.y**2 + q.z**2)
    return about(np.array([q.x, q.y, q.z]) / length, 2.0 * math.atan2(length, q.w))


def square_on_road(translation_m, rotation, optical):
    """Return the middle of the square on the road (3,) in the parent frame, by the left image.

    Args:
        translation_m: (3,) origin of the child in the parent.
        rotation: (3, 3) from the child to the parent.
        optical: Whether the child is the optical frame of the left camera; else the body.
    """
    left, _ = render(SCENE, np.random.default_rng(0))
    paint = left.astype(np.float64) - ASPHALT_GREY
    paint[: int(RIG.cy)] = 0.0  # the sky
    rows, columns = np.nonzero(paint > 1.0)
    area = np.s_[rows.min() - 2 : rows.max() + 3, columns.min() - 2 : columns.max() + 3]
    v, u = np.mgrid[area]
    right, down = (u - RIG.cx) / RIG.fx, (v - RIG.cy) / RIG.fy
    if optical:
        rays, origin = np.stack([right, down, np.ones_like(right)], -1), np.zeros(3)
    else:
        rays, origin = (
            np.stack([np.ones_like(right), -right, -down], -1),
            np.array([0.0, RIG.baseline_m / 2, 0]),
        )
    start, rays = translation_m + rotation @ origin, rays @ rotation.T
    points = start - rays * (start[2] / rays[..., 2])[..., None]
    (x_v, x_u), (y_v, y_u) = np.gradient(points[..., 0]), np.gradient(points[..., 1])
    weights = np.maximum(paint[area], 0.0) * np.abs(x_u * y_v - x_v * y_u)  # by how much road a pixel covers
    return (points * weights[..., None]).sum((0, 1)) / weights.sum()
