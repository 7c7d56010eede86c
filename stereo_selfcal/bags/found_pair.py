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

"""Pairs of images of a recording, before they are converted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from ..core.camera.pairing import StampedPair
from .errors import BagError
from .part import Message


class FoundPair(NamedTuple):
    """A pair of images, and the CameraInfo of both where it is followed."""

    pair: StampedPair[Message]
    infos: tuple[Any, Any] | None


def first_judged(pairs: Iterator[FoundPair]) -> Iterator[FoundPair]:
    """Yield pairs; an image that the second one repeats is a repeated one in the first too: it may be old."""
    first = next(pairs, None)
    if first is None:
        return
    try:
        second = next(pairs, None)
    except BagError:
        yield first
        raise
    yield first if second is None else first._replace(pair=replace(first.pair, frozen=second.pair.frozen))
    if second is not None:
        yield second
    yield from pairs
