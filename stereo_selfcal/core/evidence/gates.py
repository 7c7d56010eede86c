"""The gates a calibration has to pass, as data: what is measured, its limit, the reason and the remedy.

Each gate reads one number from what the stages have found. A new gate is one entry in :data:`GATES` and one
test.
What stands before there is an estimate (images, lines, matches) is in `core.lanes.frame_checks`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..rejection import GateReading, Rejection, RejectReason
from . import measurements
from .frame_evidence import Evidence
from .measurements import Reading

_FIND_LINES = "drive on a straight road with painted lines on both sides of the camera, lens clean"


@dataclass(frozen=True, slots=True)
class Gate:
    """One condition of a calibration.

    Attributes:
        name: For pictures and tables.
        reason: Of a refusal.
        remedy: What the user can do.
        read: Returns the reading; None where there is nothing to read.
    """

    name: str
    reason: RejectReason
    remedy: str
    read: Callable[[Evidence], Reading | None]


def evaluate_gates(
    evidence: Evidence, *, already: tuple[GateReading, ...] = ()
) -> tuple[tuple[GateReading, ...], Rejection | None]:
    """Read all gates for which there is evidence, in order, up to the first that is closed.

    Args:
        evidence: What the stages have found.
        already: Readings of before, which are not read again.

    Returns:
        All readings, and the refusal, if any.
    """
    taken = list(already)
    done = {reading.name for reading in already}
    for gate in GATES:
        if gate.name in done:
            continue
        read = gate.read(evidence)
        if read is None:
            continue
        taken.append(GateReading(gate.name, read.value, read.threshold, read.unit, read.passed))
        if not read.passed:
            refusal = Rejection(gate.reason, read.what, read.value, read.threshold, read.unit, gate.remedy)
            return tuple(taken), refusal
    return tuple(taken), None


_KERB = "one of them may be a kerb, or slope otherwise: drive on, in the middle of a flat lane"
_ONE_ROAD = f"check that left and right are not swapped, and {_FIND_LINES}"

GATES: tuple[Gate, ...] = (
    Gate(
        "plausible",
        RejectReason.SEARCH_SPACE_EDGE,
        f"widen search.* if the camera is mounted like that, else {_FIND_LINES}",
        measurements.inside,
    ),
    Gate(
        "fitness",
        RejectReason.FITNESS_TOO_LOW,
        f"the lines may not be parallel or not lie in one plane: {_FIND_LINES}",
        measurements.fitness,
    ),
    Gate("straight", RejectReason.LINES_NOT_STRAIGHT, "calibrate on a straight road", measurements.straight),
    Gate("flat", RejectReason.ROAD_NOT_FLAT, "calibrate where the slope does not change", measurements.flat),
    Gate(
        "nothing below",
        RejectReason.LINE_BELOW_ROAD,
        f"one of the lines may be a kerb or a rail: {_FIND_LINES}",
        measurements.lines_below_plane,
    ),
    Gate("determined", RejectReason.LINES_NOT_MATCHED, _FIND_LINES, measurements.determined),
    Gate(
        "consistent",
        RejectReason.LINES_INCONSISTENT,
        "check that the images are rectified: a row of one must be the same row of the other",
        measurements.consistent,
    ),
    Gate(
        "stages agree",
        RejectReason.STAGES_DISAGREE,
        f"something else lies beside the lines: {_FIND_LINES}",
        measurements.stages,
    ),
    Gate("stripe width", RejectReason.LINES_NOT_MATCHED, _ONE_ROAD, measurements.stripe_width),
    Gate("lane width", RejectReason.LINES_NOT_MATCHED, _ONE_ROAD, measurements.lane_width),
    Gate(
        "near and far",
        RejectReason.ROAD_NOT_FLAT,
        "calibrate where the slope does not change",
        measurements.near_and_far,
    ),
    Gate(
        "sharp",
        RejectReason.IMAGE_BLURRED,
        "focus the lens, clean it, or shorten the exposure",
        measurements.blur,
    ),
    Gate(
        "exposed",
        RejectReason.IMAGE_EXPOSURE,
        "set the exposure so that the road is neither black nor white",
        measurements.exposure,
    ),
    Gate(
        "witness",
        RejectReason.ROAD_WITHOUT_TEXTURE,
        "drive on in daylight with the lens clean, or accept what lines alone say with texture.required: 0",
        measurements.witness,
    ),
    Gate(
        "rectified",
        RejectReason.IMAGES_NOT_RECTIFIED,
        "calibrate the pair again: a row of one image must be the same row of the other",
        measurements.rectified,
    ),
    Gate(
        "not turned",
        RejectReason.IMAGES_NOT_RECTIFIED,
        "calibrate the pair again: one camera has turned against the other",
        measurements.turned,
    ),
    Gate(
        "coplanar",
        RejectReason.LINES_NOT_COPLANAR,
        "the lines are those of more than one lane, or one is a kerb or a rail: drive on, in the middle of a "
        "flat lane",
        measurements.coplanar,
    ),
    Gate("two edges", RejectReason.LINE_NOT_PAINTED, _FIND_LINES, measurements.fitted),
    Gate(
        "painted",
        RejectReason.LINE_NOT_PAINTED,
        f"it may be a kerb or a rail, or lie in a shadow's edge: {_FIND_LINES}",
        measurements.painted,
    ),
    Gate(
        "level stripes",
        RejectReason.LINE_NOT_PAINTED,
        f"it may be a kerb with its face, or a rail: {_FIND_LINES}",
        measurements.level_stripes,
    ),
    Gate(
        "certain",
        RejectReason.ESTIMATE_UNCERTAIN,
        "drive on, in the middle of a flat lane where more of both lines is seen",
        measurements.certain,
    ),
    Gate("lines in lane", RejectReason.TEXTURE_DISAGREES, _KERB, measurements.own_heights),
    Gate("asphalt", RejectReason.TEXTURE_DISAGREES, _KERB, measurements.asphalt),
    Gate("lines in asphalt", RejectReason.TEXTURE_DISAGREES, _KERB, measurements.line_heights),
)
