"""What the table has of a recording."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass, fields, replace
from enum import Enum
from typing import Any

from ..core.errors import ConfigError
from ..offline import Replay


class Status(Enum):
    """What became of a recording; ``str(status)`` is a stable word."""

    CALIBRATED = "calibrated"
    REFUSED = "refused"
    DAMAGED = "damaged"
    FAILED = "failed"
    NOT_DONE = "not_done"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class BagOutcome:
    """One row of the table.

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
        height_m: Height [m]; None where it was not calibrated, as all that follow.
        pitch_rad: Pitch [rad].
        roll_rad: Roll [rad].
        height_std_m: Standard deviation of the height [m].
        pitch_std_rad: Standard deviation of the pitch [rad].
        roll_std_rad: Standard deviation of the roll [rad].
        moves: How often the camera was moved; the pose is that after the last time.
        moved_at_s: When it was moved last [s]; None if it was not.
        lane_yaw_rad: Mean yaw against the lane [rad], > 0: the camera points left.
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
    height_m: float | None = None
    pitch_rad: float | None = None
    roll_rad: float | None = None
    height_std_m: float | None = None
    pitch_std_rad: float | None = None
    roll_std_rad: float | None = None
    moves: int = 0
    moved_at_s: float | None = None
    lane_yaw_rad: float | None = None
    first_stamp_s: float | None = None
    last_stamp_s: float | None = None
    left: str = ""
    right: str = ""
    report: str = ""

    @classmethod
    def from_replay(cls, bag: str, replay: Replay, topics: tuple[str, str]) -> BagOutcome:
        """Return the row of a recording that was read."""
        estimate, rows, changes = replay.estimate, replay.rows, replay.drive.changes
        numbers: dict[str, float | None] = {}
        if estimate.accepted and estimate.extrinsics is not None and estimate.std is not None:
            for name in ("height_m", "pitch_rad", "roll_rad"):
                stem, unit = name.rsplit("_", 1)
                numbers[name] = float(getattr(estimate.extrinsics, name))
                numbers[f"{stem}_std_{unit}"] = float(getattr(estimate.std, name))
            numbers["lane_yaw_rad"] = estimate.lane_yaw_rad
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
            moves=len(changes),
            moved_at_s=changes[-1].at_s if changes else None,
            first_stamp_s=rows[0].stamp_s,
            last_stamp_s=rows[-1].stamp_s,
            left=topics[0],
            right=topics[1],
            **numbers,  # type: ignore[arg-type]
        )

    @property
    def finished(self) -> bool:
        """Whether there is no need to do it again; a failure may have passed by the next run."""
        return self.status in (Status.CALIBRATED, Status.REFUSED, Status.DAMAGED)

    def named(self, bag: str, report: str) -> BagOutcome:
        """Return it under the name the recording has this time, with its report."""
        return replace(self, bag=bag, report=report)

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values by column."""
        return asdict(self) | {"status": str(self.status)}

    @classmethod
    def from_mapping(cls, values: dict[str, Any]) -> BagOutcome:
        """Read what :meth:`to_mapping` wrote.

        Raises:
            ConfigError: It is something else.
        """
        try:
            outcome = cls(**{**values, "status": Status(values["status"])})
        except (TypeError, KeyError, ValueError) as error:
            raise ConfigError(f"not a row of a fleet ({error})") from error
        for item in fields(outcome):
            value = getattr(outcome, item.name)
            # With `from __future__ import annotations` the type of a field is its text.
            if item.type == "float | None" and not (
                value is None or (isinstance(value, float) and math.isfinite(value))
            ):
                raise ConfigError(f"{item.name} is {value!r}: not a number")
        return outcome


COLUMNS = tuple(item.name for item in fields(BagOutcome))
