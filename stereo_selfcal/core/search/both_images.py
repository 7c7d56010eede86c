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

"""How the two images of a frame fit each other: one picture twice, or one of them mirrored or turned.

Both cameras look at one scene from two places. So the same things are in both images, in the same rows and
the same way up, and what is near is shifted along the rows. Only frames that were refused are looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..config import CalibratorConfig
from ..rejection import Bound, Rejection, RejectReason
from ..types import Array, Image

# Edges of the road of both images, compared at the same pixels in bands of the lower half, without the
# borders at the sides, which a rectification may leave black. Of 19 recorded and rendered pairs, the greatest
# correlation in a band was 0.19; of one picture twice, with noise of 3 grey levels or JPEG of quality 50, the
# least was 0.99.
_BANDS, _BORDER = 6, 1 / 8
_LEAST_BANDS = 3  # that have edges
_EDGE_PERCENTILE = 98
_LEAST_EDGE = 2.0  # grey levels per pixel
_SAME = 0.8
_SMOOTHING_PX = 1.0
# Shift of the near road by which edges are surely apart.
_LEAST_SHIFT_PX = 3.0

# Bands of small images without their coarse grey, compared at their best shift. Of those pairs, the mean
# correlation was 0.68 or more as they are, 0.71 or less with one mirrored (rendered roads are nearly
# symmetric, and had more as they are) and 0.24 or less with one upside down.
_SMALL = 160, 120
_SMALL_BANDS = 8
_COARSE_PX = 6.0
_REACH_PX = 24
_LEAST_CONTRAST = 0.7  # grey levels: bands with less are left out
_LEAST_FIT = 0.5
_CLEARLY_BETTER = 0.1
_LEAST_SHIFTS = 4  # bands that tell what is near


class Relation(Enum):
    """How the right image fits the left one."""

    AS_IT_IS = (False, False)
    MIRRORED = (False, True)
    FLIPPED = (True, False)
    TURNED = (True, True)

    def applied_to(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an image that is turned or mirrored like that."""
        rows, columns = (-1 if backwards else 1 for backwards in self.value)
        return np.ascontiguousarray(image[::rows, ::columns])


def same_picture(images: tuple[Image, Image], rig: StereoRig, config: CalibratorConfig) -> Rejection | None:
    """Return the refusal of images that show one picture, be it with other noise or compressed anew.

    Args:
        images: (H, W) uint8 image of each camera.
        rig: Intrinsics and baseline.
        config: Tells the greatest height of the cameras.
    """
    greatest_m = config.search.bounds()[1][0]
    equal = np.array_equal(*images)
    # The horizon is above the lower quarter.
    if not equal and rig.baseline_m / greatest_m * rig.height / 4 < _LEAST_SHIFT_PX:
        return None
    slopes = [np.array_split(_slopes(image), _BANDS) for image in images]
    visible = []
    for left, right in zip(*slopes, strict=True):
        agreement = _agreement(left, right)
        if agreement is not None and agreement < _SAME:
            return None
        visible += [] if agreement is None else [agreement]
    if len(visible) < (1 if equal else _LEAST_BANDS):
        return None
    return Rejection(
        RejectReason.LINES_NOT_MATCHED,
        "the left and the right image are the same picture: the edges of the near road, which two cameras "
        "see at different places, are at the same ones in both, with a correlation of {value}",
        min(visible),
        Bound.MOST,
        _SAME,
        "",
        "give the topics of two cameras, and check their drivers",
    )


def _slopes(image: Image) -> Array:
    """Return the change of grey along the rows of the lower half, without the borders at the sides."""
    border = round(image.shape[1] * _BORDER)
    smooth = cv2.GaussianBlur(image[image.shape[0] // 2 :], (0, 0), _SMOOTHING_PX)
    return np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)[:, border : image.shape[1] - border])


def _agreement(left: Array, right: Array) -> float | None:
    """Return the correlation of two bands at their strongest edges, None where there are none."""
    strongest = np.maximum(np.abs(left), np.abs(right))
    if strongest.size == 0:
        return None
    limit = float(np.percentile(strongest, _EDGE_PERCENTILE))
    if limit < _LEAST_EDGE:
        return None
    a, b = (each[strongest >= limit].astype(np.float64) for each in (left, right))
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-9)


@dataclass(frozen=True, slots=True)
class BothImages:
    """How the right image of a frame fits the left one.

    Attributes:
        relation: How it fits best; as it is, unless it fits clearly better otherwise.
        fit: Mean correlation of the bands then.
        shifts: Shift of each band along the rows then, from above [px of the small images]; bands that do not
            fit are left out.
    """

    relation: Relation
    fit: float
    shifts: tuple[int, ...]

    @classmethod
    def of(cls, images: tuple[Image, Image]) -> BothImages:
        """Compare the images of a frame.

        Args:
            images: (H, W) uint8 image of each camera.
        """
        left, right = (_fine(image) for image in images)
        views = {relation: cls(relation, *_fit(left, relation.applied_to(right))) for relation in Relation}
        as_it_is = views[Relation.AS_IT_IS]
        best = max(views.values(), key=lambda view: view.fit)
        return best if best.fit >= max(_LEAST_FIT, as_it_is.fit + _CLEARLY_BETTER) else as_it_is

    @property
    def nearer_below(self) -> bool:
        """Whether the images surely show what is nearer below what is farther, as they do of a road."""
        if len(self.shifts) < _LEAST_SHIFTS:
            return False
        return min(map(abs, self.shifts[-2:])) > max(map(abs, self.shifts[:2]))

    @property
    def exchanged(self) -> bool:
        """Whether the images are surely exchanged: what is near has a negative disparity."""
        return self.relation is Relation.AS_IT_IS and self.nearer_below and max(self.shifts[-2:]) < 0

    def disparity_px(self, rig: StereoRig) -> float:
        """Return the mean disparity of the lower two bands that fit [px of the images]."""
        return float(np.mean(self.shifts[-2:])) * rig.width / _SMALL[0]

    def mirrored(self, side: str | None) -> Rejection:
        """Return the refusal of images of which one is mirrored or flipped.

        Args:
            side: Which one it is, None where that is not known.
        """
        how = "left to right" if self.relation is Relation.MIRRORED else "upside down"
        which = "one image is" if side is None else f"the {side} image is"
        return Rejection(
            RejectReason.IMAGES_MIRRORED,
            f"{which} mirrored {how} against the other one: mirrored back, it fits with a correlation of "
            "{value}, as it is with less than {limit}",
            self.fit,
            Bound.MOST,
            self.fit - _CLEARLY_BETTER,
            "",
            "check the mirror and flip settings of "
            + ("both cameras and their drivers" if side is None else f"the {side} camera and its driver"),
        )


def _fine(image: Image) -> Array:
    small = cv2.resize(image, _SMALL, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(small - cv2.GaussianBlur(small, (0, 0), _COARSE_PX))


def _fit(left: Array, right: Array) -> tuple[float, tuple[int, ...]]:
    """Return the mean correlation of the bands, each at its best shift, and the shifts [px]."""
    right = np.ascontiguousarray(right[:, _REACH_PX:-_REACH_PX])
    fits, shifts = [], []
    for whole, part in zip(*(np.array_split(each, _SMALL_BANDS) for each in (left, right)), strict=True):
        if min(whole.std(), part.std()) >= _LEAST_CONTRAST:
            correlations = cv2.matchTemplate(whole, part, cv2.TM_CCOEFF_NORMED)[0]
            fits.append(float(correlations.max()))
            if fits[-1] >= _LEAST_FIT:
                shifts.append(int(np.argmax(correlations)) - _REACH_PX)
    return float(np.mean(fits)) if fits else 0.0, tuple(shifts)
