"""The road surface of a frame, found without its lines: a coarse plane, then the alignment of the texture."""

from __future__ import annotations

from dataclasses import dataclass

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..estimators.coarse_road import CoarseRoad, find_coarse_road
from ..estimators.texture_alignment import TextureFit, align_texture
from ..rejection import NotFitted
from ..types import Image


@dataclass(frozen=True, slots=True, eq=False)
class RoadSurface:
    """What the images show of the road surface.

    Attributes:
        coarse: Plane of the dense disparities; or why there is none.
        texture: Alignment of the texture, from that plane on; or why there is none.
    """

    coarse: CoarseRoad | NotFitted
    texture: TextureFit | NotFitted

    @property
    def clear_plane(self) -> CoarseRoad | None:
        """The coarse plane, where enough of the road agrees with it to exclude lines; else None."""
        return None if isinstance(self.coarse, NotFitted) or not self.coarse.clear else self.coarse

    @property
    def located(self) -> TextureFit | None:
        """The alignment, where both images show the same texture on enough of the road; else None."""
        if isinstance(self.texture, NotFitted) or not self.texture.common_texture:
            return None
        return self.texture


def find_road_surface(images: tuple[Image, Image], rig: StereoRig, config: CalibratorConfig) -> RoadSurface:
    """Find the road surface, without any prior pose.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        config: Settings: the search space and the seed.
    """
    coarse = find_coarse_road(images, rig, config.search, config.seed)
    if isinstance(coarse, NotFitted):
        return RoadSurface(coarse, coarse)
    return RoadSurface(coarse, align_texture(images, rig, coarse.extrinsics))
