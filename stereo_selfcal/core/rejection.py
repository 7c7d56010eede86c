"""Why there is no calibration: the reasons, and the value of a gate beside its limit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TypeVar


class RejectReason(Enum):
    """Why a frame gave no calibration; ``str(reason)`` is a stable snake_case word."""

    IMAGE_EMPTY = "image_empty"
    IMAGE_TYPE = "image_type"
    IMAGE_UNREADABLE = "image_unreadable"
    IMAGE_SIZES_DIFFER = "image_sizes_differ"
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
    IMAGE_BLURRED = "image_blurred"
    IMAGE_EXPOSURE = "image_exposure"
    IMAGES_NOT_RECTIFIED = "images_not_rectified"
    FITNESS_TOO_LOW = "fitness_too_low"
    SEARCH_SPACE_EDGE = "search_space_edge"
    NO_FRAMES = "no_frames"

    def __str__(self) -> str:
        return self.value


class Bound(Enum):
    """Which side of a limit is good; ``str(bound)`` are the words before the limit."""

    LEAST = "at least"
    MOST = "at most"
    EXACTLY = "exactly"  # of what has one right value, such as the bits of a pixel

    def __str__(self) -> str:
        return self.value


_VERBS = {Bound.LEAST: "needed", Bound.MOST: "allowed", Bound.EXACTLY: "needed"}
# Where a sentence about a measurement has its numbers.
_VALUE, _LIMIT = "{value}", "{limit}"


@dataclass(frozen=True, slots=True)
class Rejection:
    """One reason for a refusal, with everything needed to understand and mend it.

    Attributes:
        reason: The kind of refusal.
        what: What was measured: a name, or a sentence with ``{value}`` where the value belongs. A sentence
            that says what is needed as well has ``{limit}`` where the limit belongs.
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
        """What was measured, and the value."""
        text = self.what if _VALUE in self.what else f"{self.what}: {_VALUE}"
        return text.replace(_VALUE, _with_unit(self.value, self.unit)).replace(
            _LIMIT, _with_unit(self.threshold, self.unit)
        )

    @property
    def limit(self) -> str:
        """The limit and which side of it is good."""
        return f"{self.bound} {_with_unit(self.threshold, self.unit)}"

    @property
    def finding(self) -> str:
        """What was measured, the value and the limit."""
        if _LIMIT in self.what:
            return self.measured
        return f"{self.measured}, {self.limit} {_VERBS[self.bound]}"

    @property
    def message(self) -> str:
        """One sentence: what, the measured value, the limit, the remedy."""
        return f"{self.finding}; {self.remedy}"


@dataclass(frozen=True, slots=True)
class NotFitted:
    """Why an estimator gives up.

    Attributes:
        what: What was measured.
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
        """What was measured, the value and the limit."""
        value, limit = _with_unit(self.value, self.unit), _with_unit(self.limit, self.unit)
        return f"{self.what}: {value}, {self.bound} {limit} {_VERBS[self.bound]}"


Outcome = TypeVar("Outcome")


def fitted(outcome: Outcome | NotFitted) -> Outcome | None:
    """Return what an estimator has found, None where it has given up."""
    return None if isinstance(outcome, NotFitted) else outcome


def _with_unit(number: float, unit: str) -> str:
    return f"{number:.4g} {unit}".rstrip()


@dataclass(frozen=True, slots=True)
class GateReading:
    """One gate of a frame: what it measured beside its limit.

    Attributes:
        name: Key of the gate (`core.evidence.gates`), a snake_case word.
        label: What people read in its place.
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
