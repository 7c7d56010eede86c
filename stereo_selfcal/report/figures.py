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

"""What the page shows of all frames together: course, deviations, use of the gates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..core.drive.drive import Drive, clock
from ..core.geometry.pose import POSE_COMPONENTS
from ..core.rejection import Bound, GateReading
from ..offline import FrameRow
from .charts import Array, Level, histogram, time_series
from .choice import segment_of

_PER_SI = np.array([component.unit.per_si for component in POSE_COMPONENTS])
MINUTE_S = 60.0
_LONG_S = 300.0  # from here on a drive is counted in minutes
_FEWEST_FOR_HISTOGRAM = 3


def time_axis(rows: Sequence[FrameRow]) -> tuple[Callable[[float], float], str]:
    """Return the place of a stamp [s] on the axis of a drive, and the words below that axis.

    Args:
        rows: All frames, at least one.
    """
    start_s = min(row.stamp_s for row in rows)
    long = max(row.stamp_s for row in rows) - start_s > _LONG_S
    unit_s, unit = (MINUTE_S, "min") if long else (1.0, "s")
    return lambda stamp_s: (stamp_s - start_s) / unit_s, f"{unit} since {clock(start_s)}"


def charts(rows: Sequence[FrameRow], drive: Drive) -> list[dict[str, str]]:
    """Return each component of the pose over time."""
    accepted = [row for row in rows if row.extrinsics is not None]
    if not accepted:
        return []
    time, time_label = time_axis(rows)
    times = np.array([time(row.stamp_s) for row in accepted])
    refused = np.array(sorted(time(row.stamp_s) for row in rows if not row.accepted))
    values = np.array([row.extrinsics.as_array() for row in accepted if row.extrinsics is not None]) * _PER_SI
    charts = []
    for index, component in enumerate(POSE_COMPONENTS):
        levels = []
        for segment in drive.segments:
            pose, std = segment.estimate.extrinsics, segment.estimate.std
            if pose is not None and std is not None:
                at, by = (float(each.as_array()[index] * _PER_SI[index]) for each in (pose, std))
                levels.append(Level(time(segment.start_s), time(segment.end_s), at, by))
        moves = [time(change.at_s) for change in drive.changes]
        label, title = component.label.capitalize(), component.heading.capitalize()
        labels = f"{label} of every accepted frame over time", time_label
        svg = time_series(times, values[:, index], refused, levels, moves, labels)
        charts.append({"title": title, "svg": svg})
    return charts


def _deviations(rows: Sequence[FrameRow], drive: Drive) -> Array:
    """Return how far each accepted frame is from its segment, in its own standard deviations, (N, 3)."""
    found = []
    for row in rows:
        if row.extrinsics is not None and row.covariance is not None:
            pose = segment_of(row, drive).estimate.extrinsics
            if pose is not None:
                std = np.sqrt(np.diag(row.covariance))
                found.append((row.extrinsics.as_array() - pose.as_array()) / std)
    return np.array(found).reshape(-1, len(POSE_COMPONENTS))


def residuals(rows: Sequence[FrameRow], drive: Drive) -> list[dict[str, str]]:
    """Return histograms of how the frames deviate, where there are enough for one."""
    deviations = _deviations(rows, drive)
    if len(deviations) < _FEWEST_FOR_HISTOGRAM:
        return []
    charts = []
    for index, component in enumerate(POSE_COMPONENTS):
        label, values = component.label.capitalize(), deviations[:, index]
        rms = float(np.sqrt(np.mean(values**2)))
        svg = histogram(
            values, f"{label}: deviations of the frames", "reported standard deviations of a frame"
        )
        charts.append({"title": f"{label}: RMS {rms:.2f}", "svg": svg})
    return charts


def gates(rows: Sequence[FrameRow]) -> list[dict[str, Any]]:
    """Return, for every gate, how much of its limit the frames used, and how many it refused."""
    used: dict[str, list[float]] = {}
    refused: dict[str, int] = {}
    labels: dict[str, str] = {}
    for row in rows:
        for gate in row.gates:
            if gate.passed and gate.value == gate.threshold:
                continue  # a count that has to be reached is all or nothing
            used.setdefault(gate.name, []).append(_use(gate))
            refused[gate.name] = refused.get(gate.name, 0) + (not gate.passed)
            labels[gate.name] = gate.label
    found = []
    for name, ratios in used.items():
        median, most = (float(np.quantile(ratios, q)) for q in (0.5, 0.9))
        found.append(
            {
                "label": labels[name],
                "median": f"{100 * median:.0f} %",
                "most": f"{100 * most:.0f} %",
                "bar": f"{min(100 * median, 100):.0f}",
                "reach": f"{min(100 * most, 100):.0f}",
                "refused": refused[name],
                "frames": len(ratios),
            }
        )
    return found


def _use(gate: GateReading) -> float:
    """Return how much of its limit a gate used: 0 none, 1 all of it, more beyond."""
    value, threshold = gate.value, gate.threshold
    if value * threshold < 0 or 0.0 in (value, threshold):
        return 0.0 if gate.passed else 2.0
    # Towards a greatest limit a value grows; towards a least limit below zero, its magnitude does.
    grows = (gate.bound is Bound.MOST) == (threshold > 0)
    return abs(value / threshold) if grows else abs(threshold / value)
