"""What no image of a road tells of the rig: errors of its calibration, and what they do to a pose.

A right camera that has turned about the vertical changes all disparities by the same number. The road then
fits another plane, and the surface fits it as well as before. What a calibration of the cameras leaves has a
prior here. Each unknown is given by the change of the pose that one standard deviation of it causes. The
unknowns are the same for the lines and for the surface, which respond to them differently: lines that are
parallel tell the horizon without any disparity.
"""

from __future__ import annotations

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.line_covariance import LineFit
from ..geometry.plane import jacobian_pose_wrt_plane, plane_from_pose
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm
from ..lanes.lane_pair import LanePattern
from ..road.priors import RECTIFICATION_STD_PX, VERGENCE_STD_RAD
from ..types import Array

# Term of the uncertainty of each unknown: the disparity is wrong by a constant, by a part that grows with the
# column, by one that grows with the row; and the rows of one image are lower than those of the other.
_TERMS = ("vergence", "rectification", "rectification", "row_offset")
# The names of these terms: their causes are the same in all frames of a rig, and do not average out.
RIG_TERMS = frozenset(_TERMS)


def response_of_surface(
    rig: StereoRig, pose: Extrinsics, vergence_std_rad: float = VERGENCE_STD_RAD
) -> Array:
    """Return the change (3, 4) of a pose over the road surface by one standard deviation of each unknown.

    Rows that are off by a fraction of a pixel do not change it, as texture has no direction.

    Args:
        rig: Intrinsics and baseline.
        pose: The pose.
        vergence_std_rad: Standard deviation of the right camera's turn about the vertical.
    """
    jac_pose_plane = jacobian_pose_wrt_plane(plane_from_pose(pose, rig), rig)
    # The ray (1, y, z) of a pixel decreases with its column and with its row.
    growth = np.diag([1.0, -2.0 * rig.fx / rig.width, -2.0 * rig.fy / rig.height])
    of_plane = jac_pose_plane @ growth * _disparity_stds_px(rig, vergence_std_rad)
    return np.column_stack([of_plane, np.zeros(3)])


def response_of_lines(
    fit: LineFit, pattern: LanePattern, rig: StereoRig, vergence_std_rad: float = VERGENCE_STD_RAD
) -> Array:
    """Return the change (3, 4) of a pose from two lines by one standard deviation of each unknown.

    Args:
        fit: The fit of a flat road to the lines.
        pattern: The lines.
        rig: Intrinsics and baseline.
        vergence_std_rad: Standard deviation of the right camera's turn about the vertical.
    """
    stds_px = _disparity_stds_px(rig, vergence_std_rad)
    changes = np.zeros((8, len(_TERMS)))
    for index, line in enumerate(pattern.right):
        # A disparity that is larger by e moves a line of the right image by e to the left.
        at_middle = [
            1.0,
            2.0 * (line.u_mid - rig.cx) / rig.width,
            2.0 * (line.v_mid - rig.cy) / rig.height,
        ]
        by_row = [0.0, 2.0 * line.slope / rig.width, 2.0 / rig.height]
        u_mid, slope = 2 * (len(pattern.left) + index), 2 * (len(pattern.left) + index) + 1
        changes[u_mid, :3] = -np.array(at_middle) * stds_px
        changes[slope, :3] = -np.array(by_row) * stds_px
        changes[u_mid, 3] = -line.slope * RECTIFICATION_STD_PX
    response: Array = fit.jac_pose_lines @ changes
    return response


def rig_terms(response: Array) -> tuple[UncertaintyTerm, ...]:
    """Return the terms of the uncertainty by the unknowns of the rig.

    Args:
        response: (3, 4) change of the pose by one standard deviation of each unknown.
    """
    return tuple(
        UncertaintyTerm(name, np.outer(change, change))
        for name, change in zip(_TERMS, response.T, strict=True)
    )


def _disparity_stds_px(rig: StereoRig, vergence_std_rad: float) -> Array:
    """Return the standard deviations (3,) of the three parts of the disparity's error, at the border [px]."""
    return np.array([vergence_std_rad * rig.fx, RECTIFICATION_STD_PX, RECTIFICATION_STD_PX])
