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

"""What the page shows of the drive's progress: how well the mount was known after so many frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core.drive.targets import describe_std
from ..core.geometry.pose import POSE_COMPONENTS
from ..offline import ProgressPoint, Replay
from .charts import Array, Level, time_series
from .figures import time_axis

_FEWEST = 2  # estimates: one has no course
_NO_TIMES: Array = np.zeros(0)


def progress_line(points: Sequence[ProgressPoint]) -> str:
    """Return the first and the last standard deviations of a recording, for a line; "" without any.

    Args:
        points: In order.
    """
    told = [points[0], points[-1]] if len(points) >= _FEWEST else points
    return "; ".join(f"after {_frames(each.accepted)} {describe_std(each.std)}" for each in told)


def progress_section(replay: Replay) -> dict[str, Any] | None:
    """Return what the section says; None where there are not two estimates to compare.

    Args:
        replay: The recording's outcome.
    """
    points = replay.progress
    if len(points) < _FEWEST:
        return None
    first, last = points[0], points[-1]
    started_s = replay.rows_of_rig[0].stamp_s
    sentence = (
        f"Standard deviation of the mount {progress_line(points)}, {last.stamp_s - first.stamp_s:.1f} s "
        f"later; {last.accepted} of {_frames(len(replay.rows_of_rig))} were accepted."
    )
    time, time_label = time_axis(replay.rows)
    times = np.array([time(point.stamp_s) for point in points])
    goal = replay.goal
    charts = []
    for component in POSE_COMPONENTS:
        unit = component.small_unit
        values = np.array([component.of(point.std) for point in points]) * unit.per_si
        target = 0.0 if goal is None else component.of(goal.targets.std) * unit.per_si
        levels = [Level(time(started_s), float(times[-1]), target, 0.0)] if target > 0.0 else []
        moves = [time(change.at_s) for change in replay.drive.changes]
        labels = f"Standard deviation of the {component.label} as frames were added", time_label
        svg = time_series(times, values, _NO_TIMES, levels, moves, labels, joined=True)
        charts.append(
            {"title": f"{component.label.capitalize()}: standard deviation [{unit.symbol}]", "svg": svg}
        )
    return {"sentence": sentence, "charts": charts, "asked": goal is not None}


def _frames(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"
