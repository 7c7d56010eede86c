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
