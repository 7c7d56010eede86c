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

"""The outcome of a recording: one row of the table of a fleet."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any

from ..core.alignment_verdict import report_alignment
from ..core.camera.rig import StereoRig
from ..core.errors import ConfigError, printable, shortened
from ..core.geometry.pose import POSE_NAMES, STD_NAMES, Extrinsics
from ..offline import Replay
from ..report.progress import progress_line
from ..report.uncertainty import variance_line


class Status(Enum):
    """Outcome of a recording in one word; ``str(status)`` is stable."""

    CALIBRATED = "calibrated"
    REFUSED = "refused"
    DAMAGED = "damaged"
    FAILED = "failed"
    NOT_DONE = "not_done"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class BagOutcome:
    """One row of the table. Its texts are printable lines, whatever names and messages are made of.

    Attributes:
        bag: The recording as it was named.
        status: calibrated; refused: no frame was accepted; damaged: it ended early, and the numbers are
            those of the frames before; failed: it could not be read, or killed its workers; not_done:
            the run was interrupted before.
        reason: Of a refusal the reject reason of most frames, of damage and failure one line; else empty.
        message: The sentence of ``replay``.
        frames: Number of frames.
        accepted: How many of them were accepted.
        confirmed: How many of these the road surface has confirmed.
        extrinsics: The calibration, None where there is none. Each component is a column of the table.
        std: Standard deviations of the mount, None where there is none. Each is a column as well.
        with_reservations: Whether the calibration is to be trusted less: the message says why.
        moves: How often the camera was moved; the pose is that after the last time.
        moved_at_s: When it was moved last [s]; None if it was not.
        lane_yaw_rad: Mean yaw against the lane [rad], > 0: the camera points left.
        yaw_rad: Yaw against the direction of travel [rad], > 0: the camera points left; None while not known.
        yaw_std_rad: Standard deviation of this yaw [rad].
        alignment: Verdict on how the right camera is turned, a word; empty where nothing tells.
        alignment_pitch_rad: Its pitch against where the rig has it [rad]; None where it is not known.
        alignment_roll_rad: The same of its roll [rad].
        alignment_yaw_rad: The same of its yaw [rad].
        alignment_pitch_std_rad: Standard deviation of this pitch [rad].
        alignment_roll_std_rad: The same of the roll [rad].
        alignment_yaw_std_rad: The same of the yaw [rad].
        uncertainty: The two largest causes of the standard deviations of the mount, with their shares.
        progress: Standard deviations of the mount after the first accepted frame, and after all of them.
        rig: The rig, as :func:`rig_text` writes it; empty where it is not known.
        first_stamp_s: Stamp of the first frame [s].
        last_stamp_s: Stamp of the last frame [s].
        left: Topic of the left images.
        right: Topic of the right images.
        report: Name of the report in the output folder, empty where there is none.
    """

    bag: str
    status: Status
    reason: str = ""
    message: str = ""
    frames: int = 0
    accepted: int = 0
    confirmed: int = 0
    extrinsics: Extrinsics | None = None
    std: Extrinsics | None = None
    with_reservations: bool = False
    moves: int = 0
    moved_at_s: float | None = None
    lane_yaw_rad: float | None = None
    yaw_rad: float | None = None
    yaw_std_rad: float | None = None
    alignment: str = ""
    alignment_pitch_rad: float | None = None
    alignment_roll_rad: float | None = None
    alignment_yaw_rad: float | None = None
    alignment_pitch_std_rad: float | None = None
    alignment_roll_std_rad: float | None = None
    alignment_yaw_std_rad: float | None = None
    uncertainty: str = ""
    progress: str = ""
    rig: str = ""
    first_stamp_s: float | None = None
    last_stamp_s: float | None = None
    left: str = ""
    right: str = ""
    report: str = ""

    def __post_init__(self) -> None:
        """Make the texts printable: they hold names from outside."""
        for name, kind in COLUMN_KINDS.items():
            if kind == TEXT:
                object.__setattr__(self, name, printable(getattr(self, name)))

    @classmethod
    def from_replay(cls, bag: str, replay: Replay, topics: tuple[str, str]) -> BagOutcome:
        """Return the row of a recording that was read."""
        estimate, rows, changes = replay.estimate, replay.rows, replay.drive.changes
        status, reason = Status.CALIBRATED, ""
        if replay.damage is not None:
            status, reason = Status.DAMAGED, replay.damage
        elif not estimate.accepted:
            refusals = Counter(row.reason for row in rows if row.reason is not None)
            status, reason = Status.REFUSED, str(refusals.most_common(1)[0][0])
        return cls(
            bag,
            status,
            reason=reason,
            message=estimate.message,
            frames=len(rows),
            accepted=sum(row.accepted for row in rows),
            confirmed=sum(row.confirmed for row in rows),
            extrinsics=estimate.extrinsics if estimate.accepted else None,
            std=estimate.std if estimate.accepted else None,
            with_reservations=replay.with_reservations,
            moves=len(changes),
            moved_at_s=changes[-1].at_s if changes else None,
            lane_yaw_rad=estimate.lane_yaw_rad if estimate.accepted else None,
            **_yaw_columns(replay),
            **_alignment_columns(replay),
            uncertainty=variance_line(estimate.uncertainty) if estimate.accepted else "",
            progress=progress_line(replay.progress),
            rig=rig_text(replay.rig),
            first_stamp_s=rows[0].stamp_s,
            last_stamp_s=rows[-1].stamp_s,
            left=topics[0],
            right=topics[1],
        )

    @property
    def finished(self) -> bool:
        """Whether the outcome is final. A failure is not, because its cause may be gone in the next run."""
        return self.status in (Status.CALIBRATED, Status.REFUSED, Status.DAMAGED)

    def named(self, bag: str, report: str) -> BagOutcome:
        """Return the outcome with the recording's present name and report."""
        return replace(self, bag=bag, report=report)

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values by column."""
        values = {item.name: getattr(self, item.name) for item in fields(self)} | {"status": str(self.status)}
        for names, pose in ((POSE_NAMES, self.extrinsics), (STD_NAMES, self.std)):
            numbers = [None] * len(names) if pose is None else pose.as_dict().values()
            values |= dict(zip(names, numbers, strict=True))
        return {name: values[name] for name in COLUMNS}

    @classmethod
    def from_mapping(cls, values: dict[str, Any]) -> BagOutcome:
        """Read what :meth:`to_mapping` wrote.

        Raises:
            ConfigError: It is something else.
        """
        if not isinstance(values, dict) or set(values) != set(COLUMNS):
            raise ConfigError(f"not a row of a fleet: {shortened(values)}")
        for name, kind in COLUMN_KINDS.items():
            if not _is_of(kind, values[name]):
                raise ConfigError(f"{name} is {shortened(values[name])}: not of type {kind}")
        others = {name: value for name, value in values.items() if name not in (*POSE_NAMES, *STD_NAMES)}
        try:
            others["status"] = Status(values["status"])
            row = cls(**others, extrinsics=_pose(values, POSE_NAMES), std=_pose(values, STD_NAMES))
        except (TypeError, ValueError) as error:
            raise ConfigError(f"not a row of a fleet ({error})") from error
        if row.status is Status.CALIBRATED and (row.extrinsics is None or row.std is None):
            raise ConfigError("not a row of a fleet: calibrated, without a pose")
        return row


def rig_text(rig: StereoRig) -> str:
    """Return a rig in one line, with all digits: ``width=640 height=480 fx=516.6 ...``."""
    return " ".join(f"{name}={value!r}" for name, value in rig.to_mapping().items())


def rig_of_text(text: str) -> StereoRig:
    """Read what :func:`rig_text` wrote.

    Raises:
        RigError: It is something else.
    """
    words = (word.partition("=") for word in text.split())
    return StereoRig.from_mapping({name: _number_of(value) for name, _, value in words})


def _number_of(text: str) -> float | str:
    """Return the number that a word is; a word that is none is refused by the rig."""
    try:
        return int(text) if text.isdecimal() else float(text)
    except ValueError:
        return text


def _yaw_columns(replay: Replay) -> dict[str, Any]:
    """Return the columns of the yaw of the mount, where it is known."""
    estimate = replay.estimate
    return estimate.travel.yaw_dict() if estimate.accepted and estimate.travel is not None else {}


def _alignment_columns(replay: Replay) -> dict[str, Any]:
    """Return the columns of how the right camera is turned, as far as it is known."""
    alignment = replay.estimate.alignment
    if alignment is None:
        return {}
    known = alignment.as_dict() | alignment.std_dict()
    columns: dict[str, Any] = {f"alignment_{name}": value for name, value in known.items()}
    return columns | {"alignment": str(report_alignment(alignment, replay.rig).verdict)}


def _pose(values: dict[str, Any], names: tuple[str, ...]) -> Extrinsics | None:
    """Return the pose, or the standard deviations, in some columns; None where all of them are empty.

    Raises:
        TypeError: Some columns are empty, others not.
    """
    numbers = [values[name] for name in names]
    return None if numbers == [None] * len(names) else Extrinsics(*map(float, numbers))


def _is_of(kind: str, value: Any) -> bool:
    """Whether a value out of a file is one of a column."""
    if kind == FLOAT:
        return value is None or (isinstance(value, float) and math.isfinite(value))
    if kind == INT:
        return type(value) is int and 0 <= value <= _LARGEST
    return isinstance(value, bool if kind == BOOL else str)


FLOAT, INT, BOOL, TEXT = "float | None", "int", "bool", "str"
_LARGEST = 2**63 - 1  # in a column of Parquet


def _column_kinds() -> dict[str, str]:
    """Return the columns of the table in their order, each with the type of its values.

    The numbers of a pose are columns of their own. With ``from __future__ import annotations`` the type of a
    field is its text.
    """
    kinds: dict[str, str] = {}
    for item in fields(BagOutcome):
        names = {"extrinsics": POSE_NAMES, "std": STD_NAMES}.get(item.name)
        kinds |= {item.name: str(item.type)} if names is None else dict.fromkeys(names, FLOAT)
    return kinds


COLUMN_KINDS = _column_kinds()
COLUMNS = tuple(COLUMN_KINDS)
