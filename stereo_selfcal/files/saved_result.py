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

"""The value that a result file holds. Every field is checked when it is read."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timezone
from typing import Any

import numpy as np

from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.errors import ConfigError, RigError, shortened
from ..core.geometry.alignment import (
    ALIGNMENT_NAMES,
    ALIGNMENT_STD_NAMES,
    MOST_KNOWN_RAD,
    Alignment,
)
from ..core.geometry.pose import POSE_COMPONENTS, POSE_NAMES, STD_NAMES, Extrinsics
from ..core.geometry.travel import YAW_NAMES, YAW_STD_NAME
from ..core.reservations import Reservation, reservations_from_mapping
from ..core.results import CalibrationResult
from ..core.types import Array
from .field_checks import (
    GREATEST_WHOLE,
    REMEDY,
    ROUNDING,
    covariance_of,
    number,
    required,
    whole,
    wrong,
)
from .node_settings import NODE_NAME
from .saved_evidence import GREATEST_ANGLE_RAD, SECTIONS, SavedEvidence, evidence_from_mapping

# 1: the standard deviations are those of a moment, or of a mean: the file does not say which.
# 2: they are those of the mount; provenance says what they are made of, and how they were reached.
SCHEMA = 2
RESULT_NAMES = (*POSE_NAMES, *STD_NAMES)

# builtin_interfaces/Time counts seconds in 32 bits.
_GREATEST_STAMP_S = 2.0**31 - 1
# The node's own source: the full names of its two topics. A path of a recording does not look like it.
_TWO_TOPICS = re.compile(r"(/[\w/]+) (/[\w/]+)", re.ASCII)
# What image_transport adds to the name of a topic: the images are the same.
_COMPRESSED = "/compressed"
# Earlier stamps are times of a simulation or of a recording without a clock: September 2001.
_FIRST_CLOCK_S = 1e9

# Rectified images of the same cameras have the same numbers to the last bit, as the file holds all of
# them. Calibration tools print P with about six digits, so a hundredth of a pixel is a real difference.
_SAME_PX = 0.01
# Six digits of P[3] and of P[0] make the baseline uncertain by 2e-5 of it. The height is proportional to
# it: 1e-4 is 0.14 mm of 1.4 m, below the 0.25 mm that one frame is sure of at best.
_SAME_BASELINE = 1e-4

_UNEXPLAINED = "alignment_unexplained_rad"

_SETTINGS = {name: setting for name, _, setting in CalibratorConfig().settings()}
# No calibration lies outside the widest box that the search can be given.
_HEIGHT, _ANGLE = _SETTINGS["search.height_min_m"], _SETTINGS["search.pitch_max_rad"]
_RANGE_BY_UNIT = {"m": (_HEIGHT.low, _HEIGHT.high), "rad": (-_ANGLE.high, _ANGLE.high)}
_RANGES = {each.name: (*_RANGE_BY_UNIT[each.si_unit], each.si_unit) for each in POSE_COMPONENTS}
# A standard deviation as great as the box says nothing at all.
_STD_RANGES = {
    each.std_name: (0.0, _RANGE_BY_UNIT[each.si_unit][1], each.si_unit) for each in POSE_COMPONENTS
}


@dataclass(frozen=True, slots=True, eq=False)
class SavedResult:
    """Content of a result file.

    Attributes:
        extrinsics: The calibration.
        std: Standard deviations of the same quantities.
        rig: The rig for which the calibration is valid.
        provenance: stamp [s], source, frames, seed, version, schema, and whatever else is there.
        covariance: (3, 3) of (height_m, pitch_rad, roll_rad); of the standard deviations alone where
            the file has no other.
        reservations: What could not be checked, or is not quite as it should be.
        alignment: How the right camera was turned; None where the file does not say.
        evidence: How the calibration was reached.
    """

    extrinsics: Extrinsics
    std: Extrinsics
    rig: StereoRig
    provenance: dict[str, Any]
    covariance: Array
    reservations: tuple[Reservation, ...] = ()
    alignment: Alignment | None = None
    evidence: SavedEvidence = field(default_factory=SavedEvidence)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> SavedResult:
        """Build from the parameters of a result file, and check every one.

        Args:
            parameters: ``extrinsics``, ``provenance`` and, where it was measured, ``alignment``, each a
                mapping; what else is there is passed over.

        Raises:
            ConfigError: A field is missing or cannot be right: one sentence with the field, its value
                and the remedy.
        """
        extrinsics, provenance = _sections(parameters)
        pose = Extrinsics.from_array([_result_value(extrinsics, name) for name in POSE_NAMES])
        std = Extrinsics.from_array([_result_value(extrinsics, name) for name in STD_NAMES])
        number(provenance, "stamp", -_GREATEST_STAMP_S, _GREATEST_STAMP_S, "s")
        for name, low in (("frames", 1), ("seed", 0)):
            whole(provenance, name, low, GREATEST_WHOLE)
        for name in ("source", "version"):
            if not isinstance(required(provenance, name), str):
                raise wrong(f"provenance.{name}", provenance[name], "text is needed")
        n_frames = int(provenance["frames"])
        covariance = _covariance(provenance.pop("covariance", None), std.as_array())
        evidence = _evidence(provenance, covariance, n_frames)
        if provenance["schema"] > 1:
            _check_yaw(extrinsics, evidence)
        return cls(
            pose,
            std,
            _rig(provenance.pop("rig", None)),
            provenance,
            covariance,
            _reservations(provenance.pop("reservations", {}), n_frames),
            _alignment(parameters.get("alignment"), provenance),
            evidence,
        )

    @property
    def schema(self) -> int:
        """Number of the file's schema; with 1, what its standard deviations are those of is not known."""
        return int(self.provenance["schema"])

    @property
    def is_of_mount(self) -> bool:
        """Whether the standard deviations are surely those of the mount, and not of one moment."""
        return self.schema > 1 and self.evidence.mount is not None

    @property
    def stamp_s(self) -> float:
        """Stamp of the (last) frame [s]."""
        return float(self.provenance["stamp"])

    @property
    def stamp_ns(self) -> int:
        """Stamp of the (last) frame [ns], to the digits a stamp in seconds has: some 200 ns of today's."""
        return round(self.stamp_s * 1e9)

    @property
    def n_frames(self) -> int:
        """Number of frames behind the calibration."""
        return int(self.provenance["frames"])

    @property
    def topics(self) -> tuple[str, str] | None:
        """Topics of the left and right images; None where the file does not say (replay's, for example)."""
        return source_topics(str(self.provenance["source"]))

    def as_result(self) -> CalibrationResult:
        """Return the calibration as the calibrator would: to be published, to be compared with."""
        frames = "1 frame" if self.n_frames == 1 else f"{self.n_frames} frames"
        when = f"at {self.stamp_s:.3f} s"
        if self.stamp_s >= _FIRST_CLOCK_S:
            when = f"on {datetime.fromtimestamp(self.stamp_s, timezone.utc):%Y-%m-%d %H:%M:%S} UTC"
        pose, travel = self.extrinsics.describe(self.std), self.evidence.travel
        if travel is not None and travel.tells_yaw:
            pose += f", {travel.describe_yaw()}"
        notes = "".join(f"; {each.text(self.n_frames)}" for each in self.reservations)
        if self.schema == 1:
            notes += "; written by an earlier version, whose standard deviation may be that of one moment"
        return CalibrationResult(
            f"calibrated {when} from {frames}: {pose}{notes}",
            extrinsics=self.extrinsics,
            covariance=self.covariance.copy(),
            stamp_s=self.stamp_s,
            n_frames=self.n_frames,
            reservations=self.reservations,
            alignment=self.alignment,
            uncertainty=self.evidence.uncertainty,
            mount=self.evidence.mount,
            travel=self.evidence.travel,
            delay=self.evidence.delay,
        )


def check_fits(calibrated: StereoRig, rig: StereoRig) -> None:
    """Make sure that a calibration holds for the cameras that are there now.

    Another size, focal length, principal point or baseline is another pair of rectified images: other
    cameras, or the same ones calibrated anew, which may have turned the images by as much as is measured.

    Args:
        calibrated: The rig it was made with.
        rig: The rig that is there now.

    Raises:
        ConfigError: It does not: one sentence with the values of both and the remedy.
    """
    now = asdict(rig)
    for name, then in asdict(calibrated).items():
        greatest = 0.0 if name in ("width", "height") else _SAME_PX
        if name == "baseline_m":
            greatest = _SAME_BASELINE * then
        if not abs(now[name] - then) <= greatest:
            raise ConfigError(
                f"the calibration is of other cameras: rig.{name} was {then:.10g}, now it is "
                f"{now[name]:.10g} (a difference of at most {greatest:.2g} is allowed); calibrate anew"
            )


def topics_source(left: str, right: str) -> str:
    """Return the ``source`` of a result that comes from two topics."""
    return f"{left} {right}"


def source_topics(source: str) -> tuple[str, str] | None:
    """Return the topics that a ``source`` names, None where it is of something else."""
    found = _TWO_TOPICS.fullmatch(source)
    return None if found is None else (found[1], found[2])


def same_images(topics: tuple[str, str], others: tuple[str, str]) -> bool:
    """Whether two pairs of topics carry the same images, be they compressed or not."""
    return all(
        a.removesuffix(_COMPRESSED) == b.removesuffix(_COMPRESSED)
        for a, b in zip(topics, others, strict=True)
    )


def check_images(saved: SavedResult, topics: tuple[str, str]) -> None:
    """Make sure that a calibration is not of other images than those that the node listens to.

    Two pairs of one make have the same rig, to the last digit. One that does not say where it comes from is
    taken: whoever put it there means it.

    Args:
        saved: The calibration.
        topics: Topics of the left and right images.

    Raises:
        ConfigError: It is: one sentence with the topics of both and the remedy.
    """
    if saved.topics is not None and not same_images(saved.topics, topics):
        raise ConfigError(
            f"the calibration is of the images of {' and '.join(saved.topics)}, this node listens to "
            f"{' and '.join(topics)}; {REMEDY}, give each pair of cameras an output_path of its own, or "
            "write the new names into provenance.source where the topics were only renamed"
        )


def _sections(parameters: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return extrinsics and provenance, once it is known that this version can read them."""
    sections = [parameters.get(name) for name in ("extrinsics", "provenance")]
    if not all(isinstance(section, Mapping) for section in sections):
        raise ConfigError(
            f"no result file of {NODE_NAME}: it needs 'extrinsics:' and 'provenance:' with values in them; "
            f"{REMEDY}"
        )
    extrinsics, provenance = ({str(name): value for name, value in s.items()} for s in sections if s)
    schema = whole(provenance, "schema", 1, GREATEST_WHOLE)
    if schema > SCHEMA:
        version = provenance.get("version")
        by = f" ({shortened(version)})" if isinstance(version, str) else ""
        raise ConfigError(
            f"written by a newer version{by} of {NODE_NAME}: its schema is {schema}, this version reads "
            f"at most {SCHEMA}; update {NODE_NAME}, or {REMEDY}"
        )
    return extrinsics, provenance


def _result_value(extrinsics: Mapping[str, Any], name: str) -> float:
    low, high, unit = (_RANGES | _STD_RANGES)[name]
    value = number(extrinsics, name, low, high, unit, "extrinsics")
    if name in _STD_RANGES and value == 0.0:
        raise wrong(f"extrinsics.{name}", value, "it must be greater than 0")
    return value


def _rig(values: Any) -> StereoRig:
    if not isinstance(values, Mapping):
        raise wrong("provenance.rig", values, "the values of the rig are needed")
    try:
        return StereoRig.from_mapping(values)
    except (RigError, OverflowError) as error:
        raise ConfigError(f"provenance.{error}; {REMEDY}") from error


def _reservations(values: Any, n_frames: int) -> tuple[Reservation, ...]:
    try:
        return reservations_from_mapping(values, n_frames)
    except ConfigError as error:
        raise ConfigError(f"provenance.{error}; {REMEDY}") from error


def _alignment(section: Any, provenance: dict[str, Any]) -> Alignment | None:
    """Return the alignment of a file; an angle without a value in it is not known.

    Args:
        section: ``alignment`` of the file.
        provenance: Its provenance, from which the rest of the alignment is taken out.
    """
    covariance = provenance.pop("alignment_covariance", None)
    unexplained_rad = 0.0
    if _UNEXPLAINED in provenance:
        unexplained_rad = number(provenance, _UNEXPLAINED, 0.0, MOST_KNOWN_RAD, "rad")
        del provenance[_UNEXPLAINED]
    if section is None:
        return None
    if not isinstance(section, Mapping):
        raise wrong("alignment", section, "the angles of the right camera are needed")
    values = {}
    for name, std_name in zip(ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES, strict=True):
        if name in section or std_name in section:
            values[name] = number(section, name, -MOST_KNOWN_RAD, MOST_KNOWN_RAD, "rad", "alignment")
            values[std_name] = number(section, std_name, 0.0, MOST_KNOWN_RAD, "rad", "alignment")
            if values[std_name] == 0.0:
                raise wrong(f"alignment.{std_name}", values[std_name], "it must be greater than 0")
    if not values:
        return None
    known = Alignment.from_values(values)
    if covariance is not None:
        known = Alignment.from_values(
            values, covariance_of(covariance, "provenance.alignment_covariance", known.std)
        )
    return replace(known, unexplained_rad=unexplained_rad)


def _covariance(values: Any, deviations: Array) -> Array:
    """Return the covariance of the calibration, or that of the standard deviations alone."""
    if values is None:
        return np.diag(deviations**2)
    return covariance_of(values, "provenance.covariance", deviations)


def _check_yaw(extrinsics: Mapping[str, Any], evidence: SavedEvidence) -> None:
    """Make sure that the yaw of a file is the one that its provenance has, and is there where it is known.

    Raises:
        ConfigError: It is not.
    """
    known = {} if evidence.travel is None else evidence.travel.yaw_dict()
    for name in YAW_NAMES:
        if name not in known and name not in extrinsics:
            continue
        if name not in known:
            raise wrong(f"extrinsics.{name}", extrinsics[name], "provenance.travel does not tell it")
        value = number(extrinsics, name, -GREATEST_ANGLE_RAD, GREATEST_ANGLE_RAD, "rad", "extrinsics")
        if abs(value - known[name]) > ROUNDING * known[YAW_STD_NAME]:
            raise wrong(f"extrinsics.{name}", value, "it contradicts provenance.travel")


def _evidence(provenance: dict[str, Any], covariance: Array, n_frames: int) -> SavedEvidence:
    """Return how the calibration was reached, and take it out of the provenance; of schema 1, nothing."""
    if provenance["schema"] == 1:
        return SavedEvidence()
    sections = {name: provenance.pop(name) for name in SECTIONS if name in provenance}
    greatest = Extrinsics(*(_STD_RANGES[name][1] for name in STD_NAMES))
    return evidence_from_mapping(sections, covariance, n_frames, greatest)
