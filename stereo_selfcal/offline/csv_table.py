"""Rows as CSV: one line per frame, SI units and radians, every digit."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable

from ..core.evidence.gates import GATES
from ..core.geometry.pose import POSE_NAMES, STD_NAMES
from .rows import FrameRow

# What every gate measured; the units are those of docs/offline.md.
_GATE_COLUMNS = {gate.key: f"gate_{gate.key}" for gate in GATES}

COLUMNS = (
    "stamp_s",
    "name",
    "recorded_ns",
    "accepted",
    "reason",
    *POSE_NAMES,
    *STD_NAMES,
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
        cells.update(row.extrinsics.as_dict())
    if row.covariance is not None:
        cells.update(zip(STD_NAMES, map(math.sqrt, row.covariance.diagonal()), strict=True))
    cells.update((_GATE_COLUMNS[gate.name], float(gate.value)) for gate in row.gates)
    return cells
