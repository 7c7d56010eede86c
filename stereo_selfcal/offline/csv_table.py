"""Rows as CSV: one line per frame, SI units and radians, every digit."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable

from ..core.evidence.gates import GATES
from .rows import FrameRow

_POSE = ("height_m", "pitch_rad", "roll_rad")
_STD = ("height_std_m", "pitch_std_rad", "roll_std_rad")
# What every gate measured; the units are those of docs/offline.md.
_GATE_COLUMNS = {gate.key: f"gate_{gate.key}" for gate in GATES}

COLUMNS = (
    "stamp_s",
    "name",
    "recorded_ns",
    "accepted",
    "reason",
    *_POSE,
    *_STD,
    "lane_yaw_rad",
    "lane_curvature_per_m",
    "confirmed",
    *_GATE_COLUMNS.values(),
    "message",
)


def as_csv(rows: Iterable[FrameRow]) -> str:
    """Return a table with a line of column names; what a frame does not have is empty.

    Args:
        rows: One per frame, in order.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows(map(_cells, rows))
    return text.getvalue()


def _cells(row: FrameRow) -> dict[str, object]:
    cells: dict[str, object] = {
        "stamp_s": row.stamp_s,
        "name": row.name,
        "recorded_ns": row.recorded_ns,
        "accepted": int(row.accepted),
        "reason": row.reason,
        "lane_yaw_rad": row.lane_yaw_rad,
        "lane_curvature_per_m": row.lane_curvature_per_m,
        "confirmed": int(row.confirmed),
        "message": row.rejection.message if row.rejection else "; ".join(row.notes),
    }
    if row.extrinsics is not None:
        cells.update(zip(_POSE, map(float, row.extrinsics.as_array()), strict=True))
    if row.covariance is not None:
        cells.update((name, math.sqrt(row.covariance[i, i])) for i, name in enumerate(_STD))
    cells.update((_GATE_COLUMNS[gate.name], float(gate.value)) for gate in row.gates)
    return cells
