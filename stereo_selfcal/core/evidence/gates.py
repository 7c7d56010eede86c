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

"""The gates that a calibration has to pass, as data: a reading with its limit, the reason and the remedy.

Each gate reads one number from the evidence of a frame. A new gate is one entry in :data:`GATES` and one
test. The checks before there is an estimate (of images, lines and matches) are in `core.lanes.frame_checks`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..lanes.frame_checks import FIND_LINES
from ..rejection import GateReading, NotFitted, Rejection, RejectReason
from . import line_readings, measurements, rig_measurements, surface_measurements
from .frame_evidence import Evidence
from .measurements import Reading


@dataclass(frozen=True, slots=True)
class Gate:
    """One condition of a calibration.

    Attributes:
        key: Name for programs, a snake_case word that no other gate has.
        label: Name for people, in pictures and tables.
        reason: Of a refusal.
        remedy: What the user can do.
        read: Function that returns the reading, or None where there is no evidence for it.
    """

    key: str
    label: str
    reason: RejectReason
    remedy: str
    read: Callable[[Evidence], Reading | None]


def evaluate_gates(
    evidence: Evidence, *, already: tuple[GateReading, ...] = ()
) -> tuple[tuple[GateReading, ...], Rejection | None]:
    """Read all gates for which there is evidence, in order, up to the first that refuses the frame.

    Args:
        evidence: Results of the stages so far.
        already: Readings of an earlier call; their gates are not read again.

    Returns:
        All readings, and the refusal, if any.
    """
    taken = list(already)
    done = {reading.name for reading in already}
    for gate in GATES:
        if gate.key in done:
            continue
        read = gate.read(evidence)
        if read is None:
            continue
        numbers = (read.value, read.bound, read.threshold, read.unit)
        taken.append(GateReading(gate.key, gate.label, *numbers, read.passed))
        if not read.passed:
            return tuple(taken), Rejection(gate.reason, read.what, *numbers, gate.remedy)
    return tuple(taken), None


def undetermined(why: NotFitted) -> Rejection:
    """Refuse an estimate that leaves a part of the pose open."""
    return Rejection(
        RejectReason.ESTIMATE_UNCERTAIN, why.what, why.value, why.bound, why.limit, why.unit, _SEE_MORE
    )


_SEE_MORE = "drive on, in the middle of a flat lane where more of both lines is seen"
_KERB = "one of the lines may be a kerb, or the road may not be flat: drive on, in the middle of a flat lane"
_ONE_ROAD = f"check that left and right are not swapped, and {FIND_LINES}"

GATES: tuple[Gate, ...] = (
    Gate(
        "plausible",
        "inside the search space",
        RejectReason.SEARCH_SPACE_EDGE,
        f"widen search.* if the camera is mounted like that, else {FIND_LINES}",
        measurements.read_search_edge,
    ),
    Gate(
        "fitness",
        "fitness of the lines",
        RejectReason.FITNESS_TOO_LOW,
        f"the lines may not be parallel or not lie in one plane: {FIND_LINES}",
        measurements.read_fitness,
    ),
    Gate(
        "straight",
        "straight lane",
        RejectReason.LINES_NOT_STRAIGHT,
        "calibrate on a straight road",
        measurements.read_lane_radius,
    ),
    Gate(
        "flat",
        "flat road",
        RejectReason.ROAD_NOT_FLAT,
        "calibrate where the slope does not change",
        measurements.read_vertical_radius,
    ),
    Gate(
        "nothing_below",
        "no line below the plane",
        RejectReason.LINE_BELOW_ROAD,
        f"one of the lines may be a kerb or a rail: {FIND_LINES}",
        measurements.read_depth_below_plane,
    ),
    Gate(
        "determined",
        "pose determined",
        RejectReason.LINES_NOT_MATCHED,
        FIND_LINES,
        measurements.read_independent_lines,
    ),
    Gate(
        "consistent",
        "consistent lines",
        RejectReason.LINES_INCONSISTENT,
        "check that the images are rectified: a row of one must be the same row of the other",
        measurements.read_line_misfit,
    ),
    Gate(
        "stages_agree",
        "stages agree",
        RejectReason.STAGES_DISAGREE,
        f"something else lies beside the lines: {FIND_LINES}",
        measurements.read_stage_difference,
    ),
    Gate(
        "stripe_width",
        "stripe width",
        RejectReason.LINES_NOT_MATCHED,
        _ONE_ROAD,
        measurements.read_stripe_width,
    ),
    Gate(
        "lane_width",
        "lane width",
        RejectReason.LINES_NOT_MATCHED,
        _ONE_ROAD,
        measurements.read_lane_width,
    ),
    Gate(
        "near_and_far",
        "near and far road agree",
        RejectReason.ROAD_NOT_FLAT,
        "calibrate where the slope does not change",
        measurements.read_profile_change,
    ),
    Gate(
        "sharp",
        "sharp images",
        RejectReason.IMAGE_BLURRED,
        "focus the lens, clean it, or shorten the exposure",
        measurements.read_blur,
    ),
    Gate(
        "exposed",
        "well exposed",
        RejectReason.IMAGE_EXPOSURE,
        "set the exposure so that the road is neither black nor white",
        measurements.read_clipped_part,
    ),
    Gate(
        "synchronised",
        "images of one moment",
        RejectReason.IMAGES_NOT_SYNCHRONISED,
        "trigger both cameras together, and check that the driver pairs images of the same moment",
        rig_measurements.read_lateness,
    ),
    Gate(
        "texture_sufficient",
        "enough texture",
        RejectReason.ROAD_WITHOUT_TEXTURE,
        "drive on in daylight with the lens clean, or accept what lines alone say with texture.required: 0",
        measurements.read_texture_sufficiency,
    ),
    Gate(
        "rectified",
        "rectified images",
        RejectReason.IMAGES_NOT_RECTIFIED,
        "calibrate the pair again: a row of one image must be the same row of the other",
        rig_measurements.read_row_offset,
    ),
    Gate(
        "not_turned",
        "cameras not turned",
        RejectReason.IMAGES_NOT_RECTIFIED,
        "calibrate the pair again: one camera has turned against the other",
        rig_measurements.read_camera_turn,
    ),
    Gate(
        "parallel_cameras",
        "cameras parallel",
        RejectReason.IMAGES_NOT_RECTIFIED,
        "calibrate the pair again, or correct its CameraInfo: the right camera has turned about the vertical",
        rig_measurements.read_yaw,
    ),
    Gate(
        "coplanar",
        "lines in one plane",
        RejectReason.LINES_NOT_COPLANAR,
        "the lines are those of more than one lane, or one is a kerb or a rail: drive on, in the middle of a "
        "flat lane",
        measurements.read_inner_line_height,
    ),
    Gate(
        "two_edges",
        "two edges of paint",
        RejectReason.LINE_NOT_PAINTED,
        FIND_LINES,
        measurements.read_fitted_stripes,
    ),
    Gate(
        "painted",
        "painted lines",
        RejectReason.LINE_NOT_PAINTED,
        f"it may be a kerb or a rail, or lie in a shadow's edge: {FIND_LINES}",
        measurements.read_border_step,
    ),
    Gate(
        "level_stripes",
        "level stripes",
        RejectReason.LINE_NOT_PAINTED,
        f"it may be a kerb with its face, or a rail: {FIND_LINES}",
        measurements.read_edge_heights,
    ),
    Gate(
        "narrow_stripes",
        "stripes as narrow as paint",
        RejectReason.LINE_NOT_PAINTED,
        f"it may be a guard rail: {FIND_LINES}",
        line_readings.read_widest_stripe,
    ),
    Gate(
        "stripes_in_plane",
        "stripes lie in their plane",
        RejectReason.LINE_NOT_PAINTED,
        f"the other line may be a kerb or a rail: {FIND_LINES}",
        line_readings.read_stripe_tilt,
    ),
    Gate(
        "lines_on_lane_surface",
        "lines on the lane",
        RejectReason.TEXTURE_DISAGREES,
        _KERB,
        measurements.read_height_over_lane,
    ),
    Gate(
        "halves_agree",
        "halves of the road agree",
        RejectReason.ROAD_NOT_FLAT,
        "drive on, to where the road ahead and beside the car is one plane",
        surface_measurements.read_halves_difference,
    ),
    Gate(
        "no_kerb_beside",
        "no kerb beside the lane",
        RejectReason.TEXTURE_DISAGREES,
        "the surface may be that of a pavement: drive on, to where the lane itself has texture",
        surface_measurements.read_kerb_heights,
    ),
    Gate(
        "strip_agrees",
        "strip under the car agrees",
        RejectReason.TEXTURE_DISAGREES,
        "the surface may be that of a pavement or of another lane: drive on, in the middle of a flat lane",
        surface_measurements.read_strip_difference,
    ),
    Gate(
        "dense_agrees",
        "dense disparities agree",
        RejectReason.TEXTURE_DISAGREES,
        _KERB,
        surface_measurements.read_coarse_difference,
    ),
    Gate(
        "faint_texture_agrees",
        "faintest texture agrees",
        RejectReason.TEXTURE_DISAGREES,
        _KERB,
        line_readings.read_sweep,
    ),
    Gate(
        "surface_agrees",
        "road surface agrees",
        RejectReason.TEXTURE_DISAGREES,
        _KERB,
        surface_measurements.read_surface_difference,
    ),
    Gate(
        "nothing_excludes_lines",
        "nothing excludes the lines",
        RejectReason.TEXTURE_DISAGREES,
        _KERB,
        line_readings.read_all_against_lines,
    ),
    Gate(
        "lines_on_surface",
        "lines on the surface",
        RejectReason.TEXTURE_DISAGREES,
        _KERB,
        measurements.read_height_over_surface,
    ),
    Gate(
        "certain",
        "certain enough",
        RejectReason.ESTIMATE_UNCERTAIN,
        _SEE_MORE,
        measurements.read_uncertainty,
    ),
)
