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

"""The alignment of a road surface that was aligned in a frame shortly before.

Between two frames a car pitches by tenths of a degree and rises by millimetres, which moves the road by a
pixel or two. So no planes are searched, and the blur is that which the road has needed. A quarter of the
samples is enough, as most of the uncertainty is that of the road's own unevenness, which the frame before has
told.
"""

from __future__ import annotations

from ..camera.rig import StereoRig
from ..geometry.plane import plane_from_pose
from ..geometry.pose import Extrinsics
from ..rejection import NotFitted
from ..road.cell_grid import FAR_M, HALF_WIDTH_M
from ..types import Array, Image
from .sampling import ImageBlurs
from .texture_alignment import BLURS, align_from
from .texture_fit import TextureFit

_THINNING = 2  # of the samples, along the rows and across them


def follow_texture(
    images: tuple[Image, Image],
    rig: StereoRig,
    start: Extrinsics,
    before: TextureFit,
    turned: Array | None = None,
) -> TextureFit | NotFitted:
    """Align the grey values of a road again.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        start: Pose to start from, good to a pixel or two of disparity.
        before: The alignment of the same road in a frame before.
        turned: Homography (3, 3) of a right camera that has turned (:meth:`.CameraTurn.homography`).
    """
    blur_px = BLURS[before.attempt]
    layout = (0.0, (-HALF_WIDTH_M, HALF_WIDTH_M), FAR_M)
    plane, blurs = plane_from_pose(start, rig), ImageBlurs(images)
    return align_from(images, blurs, rig, plane, layout, blur_px, (_THINNING,), before.unevenness, turned)
