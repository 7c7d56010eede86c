"""Why there is no calibration: the reasons, and what a gate read beside its limit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


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


@dataclass(frozen=True, slots=True)
class Rejection:
    """One reason for a refusal, with everything needed to understand and mend it.

    Attributes:
        reason: The kind of refusal.
        what: What was measured, in words.
        value: The measured value.
        threshold: The limit it missed.
        unit: Unit of both ("" for counts).
        remedy: What the user can do.
    """

    reason: RejectReason
    what: str
    value: float
    threshold: float
    unit: str
    remedy: str

    @property
    def finding(self) -> str:
        """What was measured, the value and the threshold."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.what}: {self.value:.4g}{unit}, limit {self.threshold:.4g}{unit}"

    @property
    def message(self) -> str:
        """One sentence: what, the measured value, the threshold, the remedy."""
        return f"{self.finding}; {self.remedy}"


@dataclass(frozen=True, slots=True)
class GateReading:
    """One gate of a frame: what it measured beside its limit.

    Attributes:
        name: Name of the gate (`core.evidence.gates`).
        value: Measured value.
        threshold: Its limit.
        unit: Unit of both ("" for counts and ratios).
        passed: Whether the value is good.
    """

    name: str
    value: float
    threshold: float
    unit: str
    passed: bool
