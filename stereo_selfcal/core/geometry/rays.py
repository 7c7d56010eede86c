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

"""Rays through pixels, in the body axes of a camera."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..types import Array

LEAST_DISPARITY_PX = 1.0  # least disparity of a point that is measured


def pixel_rays(rig: StereoRig, u: npt.ArrayLike, v: npt.ArrayLike) -> Array:
    """Return the rays (1, y, z) through pixels in body axes: x forward, y left, z up.

    Args:
        rig: Intrinsics; they are the same for both cameras and for the camera in the middle of the baseline.
        u: Columns [px], of any shape that broadcasts with the rows.
        v: Rows [px].

    Returns:
        Rays (..., 3).
    """
    y, z = (rig.cx - np.asarray(u, np.float64)) / rig.fx, (rig.cy - np.asarray(v, np.float64)) / rig.fy
    rays = np.ones((*np.broadcast(y, z).shape, 3))
    rays[..., 1], rays[..., 2] = y, z
    return rays
