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

"""Pictures by which a person judges a calibration at a glance: the views and the verdict in one."""

from __future__ import annotations

import numpy as np

from ..core.camera.rig import StereoRig
from ..core.geometry.pose import Extrinsics
from ..core.geometry.travel import Travel
from ..core.results import CalibrationResult
from ..core.types import Array, Image
from .birds_eye import BIRDS_EYE_ASPECT, draw_birds_eye
from .camera_view import Drawn, draw_camera_view, fits, legend, shown_extrinsics
from .canvas import MIN_WIDTH_PX
from .contradiction import contradicts, draw_contradiction
from .travel_direction import shown_travel
from .verdict import StripContent, gate_strip, verdict_of, verdict_strip

# A stream of pictures is looked at in a window and sent over a network: no wider than this.
MAX_STREAM_WIDTH_PX = 1280


def draw_overview(left: Image, right: Image, rig: StereoRig, result: CalibrationResult) -> Image:
    """Compose verdict, camera view and bird's-eye view into one picture.

    Where lines and road surface contradict each other, the right image shows both.

    Args:
        left: (H, W) uint8 image of the left camera.
        right: The same of the right camera.
        rig: The rig both images come from.
        result: Their calibration, accepted or not.

    Returns:
        (H', W', 3) uint8 BGR, at least :data:`MIN_WIDTH_PX` wide.
    """
    if left.size == 0:
        left = np.zeros((rig.height, rig.width), dtype=np.uint8)
    scale = max(1.0, MIN_WIDTH_PX / left.shape[1])
    view = draw_camera_view(left, rig, result, scale)
    width = view.shape[1]
    panels = [verdict_strip(verdict_of(result), width), view, legend(width, Drawn.of(left, rig, result))]
    if contradicts(result):
        panels += draw_contradiction(right, rig, result, scale)
    if result.gates:
        panels.append(gate_strip(result, width))
    extrinsics = shown_extrinsics(result)
    if extrinsics is not None and fits(rig, left, right):
        panels.append(draw_birds_eye(left, right, rig, extrinsics, width, shown_travel(result)))
    return np.vstack(panels)


def draw_debug_image(
    left: Image,
    rig: StereoRig | None,
    result: CalibrationResult | None,
    verdict: StripContent,
    stripes: Array | None = None,
) -> Image:
    """Compose a verdict and the camera view into the picture of a stream.

    Args:
        left: (H, W) uint8 image of the left camera, not empty.
        rig: The rig it comes from, None if it is not known.
        result: The calibration to draw over it, None if there is none.
        verdict: Text of the strip above the view.
        stripes: (N, 2) image points [px] on stripes.

    Returns:
        (H', W', 3) uint8 BGR, :data:`MIN_WIDTH_PX` to :data:`MAX_STREAM_WIDTH_PX` wide.
    """
    view = draw_camera_view(left, rig, result, _stream_width(left) / left.shape[1], stripes)
    width = view.shape[1]
    return np.vstack(
        [verdict_strip(verdict, width), view, legend(width, Drawn.of(left, rig, result, stripes))]
    )


def draw_fringes(
    left: Image,
    right: Image,
    rig: StereoRig,
    extrinsics: Extrinsics,
    verdict: StripContent,
    travel: Travel | None = None,
) -> Image:
    """Compose a verdict and the bird's-eye view into the picture of a stream.

    Args:
        left: (H, W) uint8 image of the left camera, of the rig's size.
        right: The same of the right camera.
        rig: The rig both images come from.
        extrinsics: Its pose over the road.
        verdict: Text of the strip above the view.
        travel: Direction of travel, which tells the yaw; None to draw none.

    Returns:
        (H', W', 3) uint8 BGR, as wide as :func:`draw_debug_image` of the same images.
    """
    width = _stream_width(left)
    view = draw_birds_eye(left, right, rig, extrinsics, width, travel)
    return np.vstack([verdict_strip(verdict, width), view])


def draw_notice(verdict: StripContent) -> Image:
    """Return a picture that says in words why there is nothing to show."""
    return verdict_strip(verdict, MIN_WIDTH_PX, round(MIN_WIDTH_PX * BIRDS_EYE_ASPECT))


def _stream_width(left: Image) -> int:
    """Return how wide a picture of a stream is [px]."""
    return int(min(max(left.shape[1], MIN_WIDTH_PX), MAX_STREAM_WIDTH_PX))
