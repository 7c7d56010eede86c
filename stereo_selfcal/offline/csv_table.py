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

"""Rows as CSV: one line per frame, SI units and radians, every digit."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable
from typing import Any

from ..core.errors import printable
from ..core.evidence.gates import GATES
from ..core.geometry.alignment import ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES
from ..core.geometry.pose import POSE_NAMES, STD_NAMES
from ..core.geometry.travel import YAW_NAME, YAW_NAMES, YAW_STD_NAME
from .rows import FrameRow

_ALIGNMENT = "alignment_"

# What every gate measured; the units are those of docs/offline.md.
_GATE_COLUMNS = {gate.key: f"gate_{gate.key}" for gate in GATES}

# Where a spreadsheet takes the rest of a cell for a formula, signs of full width too; also behind a
# semicolon, as that ends a cell in many countries.
_FORMULA = re.compile("(^|;)(?=[=+@\uff1d\uff0b\uff20\uff0d-])")

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
    *YAW_NAMES,
    "confirmed",
    *(_ALIGNMENT + name for name in (*ALIGNMENT_NAMES, *ALIGNMENT_STD_NAMES)),
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
    for row in rows:
        writer.writerow({name: harmless(value) for name, value in _cells(row).items()})
    return text.getvalue()


def harmless(value: Any) -> Any:
    """Return the value of a cell such that no spreadsheet computes it and no terminal obeys it.

    Args:
        value: A number, which stays what it is, or a text, which may come from outside: a name, a message.
    """
    if not isinstance(value, str):
        return value
    try:
        float(value)
    except ValueError:
        return _FORMULA.sub("\\1'", printable(value))
    return value.strip()


def _cells(row: FrameRow) -> dict[str, object]:
    cells: dict[str, object] = {
        "stamp_s": row.stamp_s,
        "name": row.name,
        "recorded_ns": row.recorded_ns,
        "accepted": int(row.accepted),
        "reason": row.reason,
        "lane_yaw_rad": row.lane_yaw_rad,
        "lane_curvature_per_m": row.lane_curvature_per_m,
        YAW_NAME: row.yaw_rad,
        YAW_STD_NAME: row.yaw_std_rad,
        "confirmed": int(row.confirmed),
        "message": row.rejection.message if row.rejection else "; ".join(row.notes),
    }
    if row.extrinsics is not None:
        cells.update(row.extrinsics.as_dict())
    if row.covariance is not None:
        cells.update(zip(STD_NAMES, map(math.sqrt, row.covariance.diagonal()), strict=True))
    if row.alignment is not None:
        values = row.alignment.as_dict() | row.alignment.std_dict()
        cells.update((_ALIGNMENT + name, value) for name, value in values.items())
    cells.update((_GATE_COLUMNS[gate.name], float(gate.value)) for gate in row.gates)
    return cells
