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

"""Tells a camera that repeats its last image while the other one goes on.

A camera hangs, and its driver sends the last image again, with new stamps. Such a pair shows two places of
the road at once, and a pose from it is wrong. Two images of a sensor are never equal byte for byte, because
of their noise; where both images are those of the pair before, the scene stands still or is a rendered one.
"""

from __future__ import annotations

import zlib
from typing import Any, NamedTuple

from ..rejection import Bound, Rejection, RejectReason
from ..types import Image

_SIDES = "left", "right"


class FrozenImage(NamedTuple):
    """A camera that repeats its last image.

    Attributes:
        side: Which one, "left" or "right".
        since_ns: Stamp of the first pair that has this image [ns].
    """

    side: str
    since_ns: int


class FrozenImages:
    """Follows the pairs of a stream in their order; its state is the checksums of the last one."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None
        self._since_ns = [0, 0]
        self._frozen: int | None = None

    def follow(self, checksums: tuple[int, int], stamp_ns: int) -> FrozenImage | None:
        """Take a pair and return which of its images is a repeated one, None where both are new.

        Args:
            checksums: Of the left and of the right image, by :func:`checksum`.
            stamp_ns: Stamp of the pair [ns].
        """
        last, self._last = self._last or (None, None), checksums
        same = [one == other for one, other in zip(last, checksums, strict=True)]
        for camera in (0, 1):
            if not same[camera]:
                self._since_ns[camera] = stamp_ns
        if not all(same):  # where both are as before, so is what is known of them
            self._frozen = same.index(True) if any(same) else None
        if self._frozen is None:
            return None
        return FrozenImage(_SIDES[self._frozen], self._since_ns[self._frozen])


def checksum(message: Any) -> int:
    """Return a checksum of the bytes of an image message; they are not decoded."""
    return zlib.crc32(message.data)


def refuse_frozen(
    frozen: FrozenImage | None, left: Image, right: Image, since: bool = False
) -> Rejection | None:
    """Return the refusal of a pair of which one image is a repeated one; None where there is none.

    An image of a single grey value is no refusal: a camera that is covered repeats itself too, and the other
    checks say what is wrong with it.

    Args:
        frozen: Which one.
        left: (H, W) image of the left camera.
        right: The same of the right camera.
        since: Whether to say since when.
    """
    if frozen is None:
        return None
    image = left if frozen.side == _SIDES[0] else right
    if image.size == 0 or image.min() == image.max():
        return None
    other = _SIDES[1 - _SIDES.index(frozen.side)]
    when = f" since {frozen.since_ns * 1e-9:.3f} s" if since else ""
    return Rejection(
        RejectReason.IMAGE_FROZEN,
        f"the {frozen.side} camera repeats its last image{when}, while the {other} one goes on: {{value}} "
        f"bytes of the {frozen.side} image differ from those of the frame next to it",
        0,
        Bound.LEAST,
        1,
        "",
        f"restart the {frozen.side} camera and its driver",
    )
