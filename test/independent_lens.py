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

"""Lens distortion and rectification by the formulas of the models, without OpenCV's maps."""

import cv2
import numpy as np


def distorted(model, d, x, y):
    """Return the normalised image point of a ray (x, y, 1) by the formulas of the models' papers."""
    r2 = x * x + y * y
    if model == "equidistant":
        r = np.sqrt(r2)
        theta = np.arctan(r)
        bent = theta * (1 + d[0] * theta**2 + d[1] * theta**4 + d[2] * theta**6 + d[3] * theta**8)
        factor = np.where(r > 1e-12, bent / np.maximum(r, 1e-12), 1.0)
        return x * factor, y * factor
    d = (*d, *[0.0] * (8 - len(d)))
    factor = (1 + d[0] * r2 + d[1] * r2**2 + d[4] * r2**3) / (1 + d[5] * r2 + d[6] * r2**2 + d[7] * r2**3)
    return (
        x * factor + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x),
        y * factor + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y,
    )


def raw_pixel(info, columns, rows, p=None):
    """Return where the raw camera sees what the rectified one sees at these pixels."""
    p = info.p if p is None else p
    rays = np.stack([(columns - p[2]) / p[0], (rows - p[6]) / p[5], np.ones_like(columns)])
    x, y, z = np.tensordot(np.array(info.r).reshape(3, 3).T, rays, 1)
    x, y = distorted(info.distortion_model, info.d, x / z, y / z)
    return info.k[0] * x + info.k[2], info.k[4] * y + info.k[5]


def raw_image(info, rectified):
    """Return the image the raw camera takes of what the rectified one sees, by inversion of raw_pixel."""
    rows, columns = np.mgrid[0 : info.height, 0 : info.width].astype(float)
    u, v = columns.copy(), rows.copy()
    off_px, steps = np.inf, 0
    while off_px > 1e-7 and steps < 40:  # a fixed point: the mapping is near the identity
        at_u, at_v = raw_pixel(info, u, v)
        u, v = u + columns - at_u, v + rows - at_v
        off_px, steps = max(np.abs(at_u - columns).max(), np.abs(at_v - rows).max()), steps + 1
    assert off_px < 1e-6
    return cv2.remap(rectified, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
