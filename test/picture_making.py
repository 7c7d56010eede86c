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

"""Results and images for the tests of pictures."""

from dataclasses import replace

import numpy as np

from stereo_selfcal.core.lanes.lane_pair import ImageLine, LanePattern
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

RIG = PAPER_RIG
SCENE = named_scene("straight_road")
POSE = SCENE.scene.extrinsics
FRAME = SCENE.frame(0)
COVARIANCE = np.diag([1e-6, 1e-8, 1e-8])
REJECTION = Rejection(RejectReason.LINES_NOT_STRAIGHT, "bend", 3, Bound.MOST, 1, "px", "drive straight " * 20)


def line(u_mid, slope):
    rows = np.arange(280.0, 480.0, 2.0)
    columns = u_mid + slope * (rows - 380.0)
    return ImageLine(
        u_mid,
        slope,
        380.0,
        np.eye(2),
        rows,
        columns,
        np.ones(rows.size),
        rows.size,
        width_px=6.0,
        contrast=90.0,
    )


LINES = (line(200.0, -1.2), line(440.0, 1.2))
BLACK = np.zeros((480, 640), np.uint8)
PATTERN = LanePattern(LINES, LINES, np.array([320.0, 280.0]), LINES[0].rows, np.zeros((2, 2, 100)))
ACCEPTED = CalibrationResult("good", None, POSE, COVARIANCE, 0.01, pattern=PATTERN, n_frames=3)


def has_colour(image, colour, tolerance=40):
    return int((np.abs(image.astype(int) - colour).max(axis=2) <= tolerance).sum())


def replace_size(width, height):
    scale = width / RIG.width
    return replace(
        RIG, width=width, height=height, fx=RIG.fx * scale, fy=RIG.fy * scale, cx=width / 2, cy=height / 2
    )
