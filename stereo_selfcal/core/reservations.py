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

"""Reservations about an accepted calibration: what could not be checked, or is not quite as it should be.

A reservation is data. Its words are in one place, here; results of single frames and of many, messages, JSON,
files and reports all have them from it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from .errors import ConfigError, shortened


class ReservationKind(Enum):
    """What a reservation is about; ``str(kind)`` is a stable snake_case word."""

    NOT_CHECKED_BY_TEXTURE = "not_checked_by_texture"
    KERB_NOT_EXCLUDED = "kerb_not_excluded"
    SLOPE_AHEAD_UNKNOWN = "slope_ahead_unknown"
    ONE_LINE_ONLY = "one_line_only"
    NO_LINE_CONFIRMS = "no_line_confirms"
    NOT_REFINED = "not_refined"
    NO_CLOSED_FORM = "no_closed_form"
    CLOSED_FORM_DIFFERS = "closed_form_differs"
    PITCH_NOT_OF_TRAVEL = "pitch_not_of_travel"
    YAW_CHANGED = "yaw_changed"

    def __str__(self) -> str:
        return self.value


# The sentence of each kind, and what stands between it and its details.
_WORDS = {
    ReservationKind.NOT_CHECKED_BY_TEXTURE: ("not checked against the texture of the road surface", ": "),
    ReservationKind.KERB_NOT_EXCLUDED: (
        "a kerb beside a line cannot be ruled out; the uncertainty allows for it",
        ": ",
    ),
    ReservationKind.SLOPE_AHEAD_UNKNOWN: (
        "the road is not seen far enough to exclude another slope of it ahead",
        ": ",
    ),
    ReservationKind.ONE_LINE_ONLY: ("from the road surface, confirmed by one line only", ": "),
    ReservationKind.NO_LINE_CONFIRMS: ("from the road surface alone, without a lane line", ": "),
    ReservationKind.NOT_REFINED: ("not refined", ": "),
    ReservationKind.NO_CLOSED_FORM: ("no closed form", ": "),
    ReservationKind.CLOSED_FORM_DIFFERS: ("the closed form differs from the genetic algorithm", " in "),
    ReservationKind.PITCH_NOT_OF_TRAVEL: (
        "the pitch over the road is not that against the direction of travel: the right camera may have "
        "turned about the vertical, or the road was hardly ever level with the way",
        ": it is ",
    ),
    ReservationKind.YAW_CHANGED: (
        "the yaw against the direction of travel has changed during the drive, as if the camera was turned",
        ": ",
    ),
}

# A calibration has reservations as a whole where one of them holds for more than this part of its frames.
_MOSTLY = 0.5


@dataclass(frozen=True, slots=True)
class Reservation:
    """One reservation about a frame, or about the fused result of several.

    Attributes:
        kind: What it is about.
        detail: The measured values or the reason; "" where there are none, or where frames differ.
        frames: Number of frames it holds for.
    """

    kind: ReservationKind
    detail: str = ""
    frames: int = 1

    @property
    def sentence(self) -> str:
        """The reservation in words, without the number of frames."""
        words, between = _WORDS[self.kind]
        return f"{words}{between}{self.detail}" if self.detail else words

    def text(self, n_frames: int) -> str:
        """Return the sentence about a result; of several frames, it says how many of them are meant.

        Args:
            n_frames: Number of frames behind the result.
        """
        return f"{self.sentence} ({self.frames} of {n_frames} frames)" if n_frames > 1 else self.sentence


def merge_reservations(frames: Iterable[Sequence[Reservation]]) -> tuple[Reservation, ...]:
    """Return the reservations about the fused result of several frames, those of most frames first.

    Args:
        frames: The reservations about each frame.

    Returns:
        One reservation of each kind, with the detail that all of its frames have in common.
    """
    counts: Counter[ReservationKind] = Counter()
    details: dict[ReservationKind, set[str]] = {}
    for reservations in frames:
        counts.update({each.kind for each in reservations})
        for each in reservations:
            details.setdefault(each.kind, set()).add(each.detail)
    # Those of equally many frames are in the order of their definition, whatever the order of the frames.
    kinds = sorted(counts, key=lambda kind: (-counts[kind], list(ReservationKind).index(kind)))
    return tuple(
        Reservation(kind, details[kind].pop() if len(details[kind]) == 1 else "", counts[kind])
        for kind in kinds
    )


def reservations_to_mapping(reservations: Sequence[Reservation]) -> dict[str, dict[str, str | int]]:
    """Return reservations as plain values by kind, for files; details of one kind are joined."""
    mapping: dict[str, dict[str, str | int]] = {}
    for each in reservations:
        details = [one.detail for one in reservations if one.kind is each.kind and one.detail]
        values: dict[str, str | int] = {"frames": each.frames}
        mapping[str(each.kind)] = values | ({"detail": " and ".join(details)} if details else {})
    return mapping


def reservations_from_mapping(values: Any, n_frames: int) -> tuple[Reservation, ...]:
    """Read what :func:`reservations_to_mapping` returned.

    Args:
        values: The mapping.
        n_frames: Number of frames behind the result.

    Raises:
        ConfigError: It is something else.
    """
    if not isinstance(values, Mapping):
        raise ConfigError(f"reservations are {shortened(values)}: a mapping by kind is needed")
    found = []
    kinds = {str(kind): kind for kind in ReservationKind}
    for name, value in values.items():
        kind, given = kinds.get(name), value if isinstance(value, Mapping) else {}
        detail, frames = given.get("detail", ""), given.get("frames")
        if kind is None or not isinstance(detail, str):
            raise ConfigError(
                f"reservations: {shortened(name)} with {shortened(value)} is none that is known"
            )
        if not isinstance(frames, int) or isinstance(frames, bool) or not 1 <= frames <= n_frames:
            raise ConfigError(
                f"reservations.{kind}.frames is {shortened(frames)}: it must lie in 1 ... {n_frames}"
            )
        found.append(Reservation(kind, detail, frames))
    return tuple(found)


def mostly_reserved(reservations: Sequence[Reservation], n_frames: int) -> bool:
    """Whether a reservation holds for most of the frames behind a result."""
    return any(each.frames > _MOSTLY * n_frames for each in reservations)
