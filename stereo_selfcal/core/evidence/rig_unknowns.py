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

"""What no image of a road tells of the rig: errors of its calibration, and what they do to a pose.

A right camera that has turned about the vertical changes all disparities by the same number. The road then
fits another plane, and the surface fits it as well as before. What a calibration of the cameras leaves has a
prior here; what the rows of both images tell makes it smaller. Each unknown is given by the change of the
pose that one standard deviation of it causes. The unknowns are the same for the lines and for the surface,
which respond to them differently: lines that are parallel tell the horizon without any disparity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.line_covariance import LineFit
from ..geometry.plane import jacobian_pose_wrt_plane, plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm
from ..lanes.lane_pair import LanePattern
from ..road.priors import CALIBRATED_TURN_STD_RAD, RECTIFICATION_STD_PX
from ..types import Array

# Term of the uncertainty of each unknown: the disparity is wrong by a constant, by a part that grows with the
# column, by one that grows with the row; the right camera is turned in pitch, and in roll; it sits farther
# ahead, or its images are late.
_TERMS = ("vergence", "rectification", "rectification", "row_offset", "row_offset", "ahead")
# The names of these terms: their causes are the same in all frames of a rig, and do not average out.
RIG_TERMS = frozenset(_TERMS)
# The same where the rows of the frame were compared: what remains of pitch and roll is the noise of that.
_TERMS_WITH_ROWS = ("vergence", "rectification", "rectification", "noise", "noise", "ahead")
# Distance of the texture that tells the roll, over the height of the camera: right images that are 2 to 5 ms
# late roll rendered roads by as much as at 5 to 6 heights.
_TELLING_HEIGHTS = 5.0


@dataclass(frozen=True, slots=True)
class RigStd:
    """Standard deviations of what is unknown of the rig, after the corrections.

    Attributes:
        pitch_rad: Of the right camera's pitch [rad].
        roll_rad: Of its roll.
        yaw_rad: Of its yaw, the vergence.
        distortion_px: Of what lenses and rectification leave in the disparities, at the border [px].
        rows_measured: Whether pitch and roll were measured in the same frame.
        ahead: Of how far ahead it sits, over the baseline, beyond what calibrations leave.
    """

    pitch_rad: float = CALIBRATED_TURN_STD_RAD[0]
    roll_rad: float = CALIBRATED_TURN_STD_RAD[1]
    yaw_rad: float = CALIBRATED_TURN_STD_RAD[2]
    distortion_px: float = RECTIFICATION_STD_PX
    rows_measured: bool = False
    ahead: float = 0.0


CALIBRATED = RigStd()  # what calibrations leave


@dataclass(frozen=True, slots=True, eq=False)
class RigResponse:
    """What the unknowns of the rig do to a pose.

    Attributes:
        changes: (3, K) change of the pose by one standard deviation of each unknown.
        terms: (K,) names of the terms of the uncertainty that they cause.
    """

    changes: Array
    terms: tuple[str, ...]

    @classmethod
    def of(cls, changes: Array, std: RigStd) -> RigResponse:
        """Return the response to unknowns with these standard deviations."""
        return cls(changes, _TERMS_WITH_ROWS if std.rows_measured else _TERMS)

    def through(self, gain: Array) -> RigResponse:
        """Return the response (N, K) of what is a linear function (N, 3) of the pose."""
        return RigResponse(gain @ self.changes, self.terms)


def response_of_surface(rig: StereoRig, pose: Extrinsics, std: RigStd = CALIBRATED) -> RigResponse:
    """Return the change of a pose over the road surface by one standard deviation of each unknown.

    Rows that are off by a fraction of a pixel do not change it, as texture has no direction.

    Args:
        rig: Intrinsics and baseline.
        pose: The pose.
        std: Standard deviations of the unknowns.
    """
    jac_pose_plane = jacobian_pose_wrt_plane(plane_from_pose(pose, rig), rig)
    # The ray (1, y, z) of a pixel decreases with its column and with its row.
    across, down = -2.0 * rig.fx / rig.width, -2.0 * rig.fy / rig.height
    changes = np.zeros((3, len(_TERMS)))
    changes[0, 0] = rig.fx * std.yaw_rad
    changes[1, 1] = across * std.distortion_px
    changes[2, 2] = down * std.distortion_px
    # A right camera whose right side is too low: what lies lower moves to the right.
    changes[2, 4] = rig.fx * std.roll_rad
    # A right camera that sits farther ahead: what lies to the right moves to the right, the more the nearer.
    changes[1, 5] = std.ahead * rig.fx * rig.baseline_m / (_TELLING_HEIGHTS * pose.height_m)
    return RigResponse.of(jac_pose_plane @ changes, std)


def response_of_lines(
    fit: LineFit, pattern: LanePattern, rig: StereoRig, std: RigStd = CALIBRATED
) -> RigResponse:
    """Return the change of a pose from two lines by one standard deviation of each unknown.

    Args:
        fit: The fit of a flat road to the lines.
        pattern: The lines.
        rig: Intrinsics and baseline.
        std: Standard deviations of the unknowns.
    """
    return RigResponse.of(fit.jac_pose_lines @ changes_of_lines(pattern, rig, std), std)


def changes_of_lines(pattern: LanePattern, rig: StereoRig, std: RigStd = CALIBRATED) -> Array:
    """Return the change of two lines in both images by one standard deviation of each unknown.

    Lines along the way are the same from farther ahead.

    Args:
        pattern: The lines.
        rig: Intrinsics and baseline.
        std: Standard deviations of the unknowns.

    Returns:
        (8, 6) changes of (u_mid, slope) of the lines of the left and of the right camera.
    """
    stds_px = np.array([rig.fx * std.yaw_rad, std.distortion_px, std.distortion_px])
    changes = np.zeros((8, len(_TERMS)))
    for index, line in enumerate(pattern.right):
        u_mid, slope = 2 * (len(pattern.left) + index), 2 * (len(pattern.left) + index) + 1
        x, y = (line.u_mid - rig.cx) / rig.fx, (line.v_mid - rig.cy) / rig.fy
        # A disparity that is larger by e moves a line of the right image by e to the left.
        at_middle = [1.0, 2.0 * rig.fx / rig.width * x, 2.0 * rig.fy / rig.height * y]
        by_row = [0.0, 2.0 * line.slope / rig.width, 2.0 / rig.height]
        changes[u_mid, :3] = -np.array(at_middle) * stds_px
        changes[slope, :3] = -np.array(by_row) * stds_px
        # Rows that are higher by e move a line by its slope times e.
        changes[u_mid, 3] = line.slope * rig.fy * std.pitch_rad
        changes[u_mid, 4] = (rig.fx * y + line.slope * rig.fy * x) * std.roll_rad
        changes[slope, 4] = (rig.fx / rig.fy + line.slope**2 * rig.fy / rig.fx) * std.roll_rad
    return changes


def rig_terms(response: RigResponse) -> tuple[UncertaintyTerm, ...]:
    """Return the terms of the uncertainty by the unknowns of the rig.

    Args:
        response: What they do to the pose.
    """
    return tuple(
        UncertaintyTerm(name, np.outer(change, change))
        for name, change in zip(response.terms, response.changes.T, strict=True)
    )
