"""The road as a few numbers, and the straight edges of its stripes in both images.

Parameters: height, pitch, roll, yaw of the lane, middles of the L stripes (at x = 0, left positive), their
L widths [m, rad].
"""

from __future__ import annotations

import numpy as np

from .extrinsics import Array, Extrinsics
from .geometry import SIDES, apply_homography, camera_centre_m, road_from_image
from .pattern import LanePattern
from .rig import StereoRig

# Where a road line is evaluated to be drawn in the image [m ahead].
_NEAR_M, _FAR_M = 5.0, 50.0


def predict_edges(parameters: Array, rig: StereoRig) -> Array:
    """Return the edges of the stripes in the images as straight lines u = a + m v.

    Args:
        parameters: (B, 4 + 2 L) roads.
        rig: Intrinsics and baseline.

    Returns:
        (B, 2 cameras, L stripes, 2 edges, 2): a [px] and m; the left edge first.
    """
    height, pitch, roll, yaw = parameters[:, :4].T
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    zero = np.zeros_like(cp)
    # Rows: body axes x, y, z from road axes, the transpose of R_y(pitch) R_x(roll).
    body_from_road = np.array([[cp, zero, -sp], [sp * sr, cr, cp * sr], [sp * cr, -sr, cp * cr]])
    middles, widths = np.split(parameters[:, 4:], 2, axis=1)
    start = middles[..., None] + widths[..., None] / 2.0 * np.array([1.0, -1.0])
    pixels = []
    for ahead in (_NEAR_M, _FAR_M):
        y = start - (np.tan(yaw) * ahead)[:, None, None]
        points = np.stack(np.broadcast_arrays(ahead, y, -height[:, None, None]))
        x_body, y_body, z_body = np.einsum("ijb,jbse->ibse", body_from_road, points)
        offsets = np.array([camera_centre_m(rig, side)[1] for side in SIDES])[:, None, None]
        u = rig.cx - rig.fx * (y_body[:, None] - offsets) / x_body[:, None]
        v = np.broadcast_to((rig.cy - rig.fy * z_body / x_body)[:, None], u.shape)
        pixels.append((u, v))
    (u0, v0), (u1, v1) = pixels
    slope = (u1 - u0) / (v1 - v0)
    return np.stack([u0 - slope * v0, slope], axis=-1)


def lane_in_road(pattern: LanePattern, rig: StereoRig, extrinsics: Extrinsics) -> Array:
    """Return lane yaw [rad] and the positions of both boundaries at x = 0 [m], from the left image."""
    to_road = road_from_image(rig, extrinsics, "left")
    ends = np.stack([pattern.columns[0][:, [0, -1]], np.broadcast_to(pattern.rows[[0, -1]], (2, 2))], axis=-1)
    far, near = np.moveaxis(apply_homography(to_road, ends), 1, 0)
    tangent = float(np.mean((far[:, 1] - near[:, 1]) / (far[:, 0] - near[:, 0])))
    # The lane runs at minus the camera's yaw.
    return np.concatenate([[-np.arctan(tangent)], near[:, 1] - tangent * near[:, 0]])
