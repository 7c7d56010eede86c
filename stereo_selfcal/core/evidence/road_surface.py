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

"""The road surface of a frame, found without its lines: a coarse plane, then the alignment of the texture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.coarse_road import CoarseRoad
from ..estimators.sampling import ImageBlurs
from ..estimators.texture_alignment import align_texture
from ..estimators.texture_fit import MIN_CELL_SHARE, MIN_SIGMAS, TextureFit
from ..estimators.texture_search import SEARCH_RANGE
from ..geometry.pose import Extrinsics
from ..rejection import Bound, NotFitted
from ..road.extent import OUTLIER_WEIGHT
from ..road.priors import HALF_STRIP_M
from ..types import Floats, Image, Mask

# Of a road that shows less than this, no lane shows enough: in rendered roads, lanes show up to a third more
# than all of the road does.
_BARE_SHARE = 0.75 * MIN_CELL_SHARE
_LEAST_STRIP_SHARE = 0.5  # of the road under the car: most of it lies in the plane, or that is another one


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCells:
    """The road surface that was aligned, in cells of a metre or more, for pictures.

    Attributes:
        pose: Pose over its plane.
        xy_m: (C, 2) middles of the cells on the road [m].
        height_m: (C,) heights over the plane [m]; NaN without texture.
        weight: (C,) 0 ... 1: whether the cell agrees with the plane.
    """

    pose: Extrinsics
    xy_m: Floats
    height_m: Floats
    weight: Floats

    @classmethod
    def of(cls, fit: TextureFit | NotFitted | None) -> SurfaceCells | None:
        """Return the cells of an alignment; None without one."""
        if fit is None or isinstance(fit, NotFitted):
            return None
        cells = (fit.cells_xy_m, fit.cells_height_m, fit.cells_weight)
        return cls(fit.extrinsics, *(each.astype(np.float32) for each in cells))

    @property
    def agrees(self) -> Mask:
        """(C,) whether a cell has texture that lies in the plane."""
        agrees: Mask = np.isfinite(self.height_m) & (self.weight > OUTLIER_WEIGHT)
        return agrees


@dataclass(frozen=True, slots=True, eq=False)
class RoadSurface:
    """What the images show of the road surface.

    Attributes:
        coarse: Plane of the dense disparities; or why there is none; None where it was not looked for.
        texture: Alignment of the texture, from that plane or a known pose on; or why there is none.
        strip: Alignment of the strip under the car alone, from there on; or why there is none, as where the
            surface is not seen. A pavement beside the lane is not the road, and its texture may have
            determined the plane.
    """

    coarse: CoarseRoad | NotFitted | None
    texture: TextureFit | NotFitted
    strip: TextureFit | NotFitted

    @property
    def clear_plane(self) -> CoarseRoad | None:
        """The coarse plane, where enough of the road agrees with it to exclude lines; else None."""
        return self.coarse if isinstance(self.coarse, CoarseRoad) and self.coarse.clear else None

    @property
    def seen(self) -> TextureFit | None:
        """The alignment, where both images show the same texture on enough of the road; else None.

        Most of the strip under the car agrees with it. So it may exclude lines.
        """
        if isinstance(self.texture, NotFitted) or not self.texture.common_texture:
            return None
        return self.texture if self.texture.quality.strip_share >= _LEAST_STRIP_SHARE else None

    @property
    def located(self) -> TextureFit | None:
        """The alignment, where the strip under the car alone can be aligned, too; else None."""
        own = not isinstance(self.strip, NotFitted) and self.strip.common_texture
        return self.seen if own else None

    def bare_at(self, pose: Extrinsics) -> TextureFit | None:
        """Return the alignment where the road at a pose shows too little texture, however it is looked at.

        Args:
            pose: The pose, by other evidence.

        Returns:
            The alignment near that pose; None where it is another one, or shows so much of the road that a
            part of it may show enough.
        """
        if isinstance(self.texture, NotFitted):
            return None
        apart = np.abs(self.texture.extrinsics.as_array() - pose.as_array())
        near = bool(np.all(apart <= SEARCH_RANGE))
        return self.texture if near and self.texture.quality.cell_share < _BARE_SHARE else None

    @property
    def lacking(self) -> NotFitted | None:
        """Why the surface does not locate the road, with value and limit; None where it does."""
        if self.located is not None:
            return None
        for found in (self.coarse, self.texture):
            if isinstance(found, NotFitted):
                return found
        assert isinstance(self.texture, TextureFit)
        if not self.texture.common_texture:
            return too_little_texture(self.texture)
        if self.seen is None:
            what = "part of the road under the car whose texture lies in the plane of the road surface"
            share = 100 * self.texture.quality.strip_share
            return NotFitted(what, share, Bound.LEAST, 100 * _LEAST_STRIP_SHARE, "%")
        return too_little_texture(self.strip)

    @property
    def described(self) -> str:
        """What of the surface is seen, in words, and what is missing."""
        lacking = self.lacking
        if lacking is None:
            return "the road surface is seen"
        if isinstance(self.coarse, NotFitted):
            return f"the road surface is not seen: {lacking.reason}"
        if isinstance(self.texture, NotFitted):
            return f"the texture of the road surface does not align in both images: {lacking.reason}"
        if self.seen is not None:
            return f"the road surface under the car alone does not align: {lacking.reason}"
        return f"too little of the road surface is seen: {lacking.reason}"


def too_little_texture(fit: TextureFit | NotFitted) -> NotFitted:
    """Return why an alignment does not locate the road: too small a part of it, or too weak a texture.

    Args:
        fit: The alignment of a road with too little texture that both images have; or why there is none.
    """
    if isinstance(fit, NotFitted):
        return fit
    sigmas, share = fit.quality.sigmas / MIN_SIGMAS, fit.quality.cell_share / MIN_CELL_SHARE
    if sigmas < share:
        what = "texture that both images have, over what noise alone would leave"
        return NotFitted(what, fit.quality.sigmas, Bound.LEAST, MIN_SIGMAS)
    what = "part of the road whose texture lies in one plane"
    return NotFitted(what, 100 * fit.quality.cell_share, Bound.LEAST, 100 * MIN_CELL_SHARE, "%")


def find_road_surface(
    images: tuple[Image, Image], rig: StereoRig, coarse: CoarseRoad | NotFitted
) -> RoadSurface:
    """Find the road surface, from the coarse plane on.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        coarse: Plane of the dense disparities; or why there is none.
    """
    if isinstance(coarse, NotFitted):
        return RoadSurface(coarse, coarse, coarse)
    return surface_from(coarse.extrinsics, images, rig, coarse)


def surface_from(
    start: Extrinsics,
    images: tuple[Image, Image],
    rig: StereoRig,
    coarse: CoarseRoad | None = None,
    first_attempt: int = 0,
) -> RoadSurface:
    """Align the road surface, all of it and the strip under the car, from a pose on.

    Args:
        start: The pose.
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        coarse: Plane of the dense disparities; None where it was not looked for.
        first_attempt: As of :func:`.align_texture`.
    """
    align = partial(align_texture, images, rig, blurs=ImageBlurs(images))
    texture = align(start, first_attempt=first_attempt)
    # Under the car alone, only a surface that is seen is looked at again.
    found = RoadSurface(coarse, texture, too_little_texture(texture))
    if found.seen is None:
        return found
    assert isinstance(texture, TextureFit)  # as it is seen
    under_car_m = (-HALF_STRIP_M, HALF_STRIP_M)
    strip = align(texture.extrinsics, limits_m=under_car_m, first_attempt=texture.attempt)
    return replace(found, strip=strip)
