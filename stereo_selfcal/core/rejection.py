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

"""Why there is no calibration: the reasons, and the measured values with their limits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TypeVar


class RejectReason(Enum):
    """Why a frame gave no calibration; ``str(reason)`` is a stable snake_case word."""

    IMAGE_EMPTY = "image_empty"
    IMAGE_TYPE = "image_type"
    IMAGE_UNREADABLE = "image_unreadable"
    IMAGE_FROZEN = "image_frozen"
    IMAGE_SIZES_DIFFER = "image_sizes_differ"
    CAMERA_INFO_UNUSABLE = "camera_info_unusable"
    RIG_SIZE_MISMATCH = "rig_size_mismatch"
    NO_LINES_FOUND = "no_lines_found"
    LINES_NOT_MATCHED = "lines_not_matched"
    CAMERAS_SWAPPED = "cameras_swapped"
    LINES_NOT_STRAIGHT = "lines_not_straight"
    LINE_BELOW_ROAD = "line_below_road"
    LINE_NOT_PAINTED = "line_not_painted"
    LINES_NOT_COPLANAR = "lines_not_coplanar"
    ROAD_NOT_FLAT = "road_not_flat"
    LINES_NOT_CONVERGING = "lines_not_converging"
    LINES_INCONSISTENT = "lines_inconsistent"
    STAGES_DISAGREE = "stages_disagree"
    ESTIMATE_UNCERTAIN = "estimate_uncertain"
    TEXTURE_DISAGREES = "texture_disagrees"
    ROAD_WITHOUT_TEXTURE = "road_without_texture"
    ROAD_NOT_SEEN = "road_not_seen"
    IMAGE_BLURRED = "image_blurred"
    IMAGE_EXPOSURE = "image_exposure"
    IMAGES_UPSIDE_DOWN = "images_upside_down"
    IMAGES_MIRRORED = "images_mirrored"
    IMAGES_NOT_RECTIFIED = "images_not_rectified"
    IMAGES_NOT_SYNCHRONISED = "images_not_synchronised"
    FITNESS_TOO_LOW = "fitness_too_low"
    SEARCH_SPACE_EDGE = "search_space_edge"
    NO_FRAMES = "no_frames"
    INTERNAL_ERROR = "internal_error"

    def __str__(self) -> str:
        return self.value


class Bound(Enum):
    """Which side of a limit is good; ``str(bound)`` gives the words before the limit."""

    LEAST = "at least"
    MOST = "at most"
    EXACTLY = "exactly"  # for quantities with one right value, such as the bits of a pixel

    def __str__(self) -> str:
        return self.value


_VERBS = {Bound.LEAST: "needed", Bound.MOST: "allowed", Bound.EXACTLY: "needed"}
# Placeholders of the numbers in a sentence about a measurement.
_VALUE, _LIMIT = "{value}", "{limit}"


@dataclass(frozen=True, slots=True)
class Rejection:
    """One reason for a refusal, with the measured value, the limit and the remedy.

    Attributes:
        reason: The kind of refusal.
        what: What was measured: a name, or a sentence with ``{value}`` in place of the value. A sentence that
            also gives the limit has ``{limit}`` in its place.
        value: The measured value.
        bound: Whether the limit is the least or the most that is good.
        threshold: The limit it missed.
        unit: Unit of both ("" for counts).
        remedy: What the user can do.
    """

    reason: RejectReason
    what: str
    value: float
    bound: Bound
    threshold: float
    unit: str
    remedy: str

    @property
    def measured(self) -> str:
        """The measured quantity and its value."""
        text = self.what if _VALUE in self.what else f"{self.what}: {_VALUE}"
        return text.replace(_VALUE, _with_unit(self.value, self.unit)).replace(
            _LIMIT, _with_unit(self.threshold, self.unit)
        )

    @property
    def limit(self) -> str:
        """The limit, as a least or a most."""
        return f"{self.bound} {_with_unit(self.threshold, self.unit)}"

    @property
    def finding(self) -> str:
        """The measured quantity, its value and the limit."""
        if _LIMIT in self.what:
            return self.measured
        return f"{self.measured}, {self.limit} {_VERBS[self.bound]}"

    @property
    def message(self) -> str:
        """One sentence: what, the measured value, the limit, the remedy."""
        return f"{self.finding}; {self.remedy}"

    def followed_by(self, more: str, remedy: str) -> Rejection:
        """Return the refusal with a further finding after its own.

        Args:
            more: What else was missing, with its value and its limit.
            remedy: What the user can do about either.
        """
        what = self.what if _VALUE in self.what else f"{self.what}: {_VALUE}"
        if _LIMIT not in what:
            what = f"{what}, {self.bound} {_LIMIT} {_VERBS[self.bound]}"
        return replace(self, what=f"{what}; and {more}", remedy=remedy)


@dataclass(frozen=True, slots=True)
class NotFitted:
    """Why an estimator has given up.

    Attributes:
        what: The measured quantity.
        value: The measured value.
        bound: Whether the limit is the least or the most that is good.
        limit: The limit.
        unit: Unit of both ("" for counts and ratios).
    """

    what: str
    value: float
    bound: Bound
    limit: float
    unit: str = ""

    @property
    def reason(self) -> str:
        """The measured quantity, its value and the limit."""
        value, limit = _with_unit(self.value, self.unit), _with_unit(self.limit, self.unit)
        return f"{self.what}: {value}, {self.bound} {limit} {_VERBS[self.bound]}"


Outcome = TypeVar("Outcome")


def fitted(outcome: Outcome | NotFitted) -> Outcome | None:
    """Return the result of an estimator, None where it has given up."""
    return None if isinstance(outcome, NotFitted) else outcome


def _with_unit(number: float, unit: str) -> str:
    return f"{number:.4g} {unit}".rstrip()


@dataclass(frozen=True, slots=True)
class GateReading:
    """Reading of one gate for a frame: the measured value and its limit.

    Attributes:
        name: Key of the gate (`core.evidence.gates`), a snake_case word.
        label: Name for people.
        value: Measured value.
        bound: Whether the limit is the least or the most that is good.
        threshold: The limit.
        unit: Unit of both ("" for counts and ratios).
        passed: Whether the value is good.
    """

    name: str
    label: str
    value: float
    bound: Bound
    threshold: float
    unit: str
    passed: bool
