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

"""Histories of simulated drives: how often a camera that did not move is marked, and a moved one is.

The drives are those of :mod:`.mount_drives`: half a minute of the usual ride, with errors of frames as they
were measured, through the estimator of the mount. Each drive has a rig with errors of its own. Real drives of
one camera share these errors, so that marks without a change are more frequent here than on a road.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stereo_selfcal.core.geometry.pose import POSE_COMPONENTS
from stereo_selfcal.fleet.history import FALSE_MARKS, DriveResult, History, Known, history_of

from .mount_drives.frame_errors import RIG_NAMES, read_frames
from .mount_drives.judged import READABLE, Judged, draw_usual, judged
from .options import Options
from .table import Table

_DRIVES = 8  # of a history
_MOVED_AT = 4  # index of the first drive after the change
# Component of the pose and by how much it changes [mm, deg].
_CHANGES: tuple[tuple[str, float], ...] = (
    ("height", 10.0),
    ("height", 20.0),
    ("height", 40.0),
    ("pitch", 0.2),
    ("pitch", 0.4),
    ("pitch", 0.8),
    ("roll", 0.25),
    ("roll", 0.5),
    ("roll", 1.0),
)


@dataclass(frozen=True)
class _Marks:
    """What was marked in some histories: at the change, after it in the same number, and anywhere else."""

    at_once: int
    found: int
    others: int


def history_table(options: Options) -> Iterator[Table]:
    """Mark histories without a change and with one."""
    frames = read_frames()
    drives: list[Judged] = []
    for seed in range(_DRIVES * options.drives):
        drive, labels = draw_usual(seed, frames)
        drives.append(judged(drive, labels))
    of_rigs = [drives[first :: len(RIG_NAMES)] for first in range(len(RIG_NAMES))]
    histories = [
        rig[start : start + _DRIVES] for rig in of_rigs for start in range(0, len(rig) - _DRIVES + 1, _DRIVES)
    ]
    n = len(histories)
    table = Table(
        "history",
        f"Histories of {_DRIVES} simulated drives of half a minute: what is marked",
        ["change after half of the drives", "marked at once", "marked at once or later", "any other mark"],
        f"{n} histories of {len(RIG_NAMES)} rigs. Asked: any mark where nothing has changed in at most "
        f"{100 * FALSE_MARKS:.0f} % of them.",
    )
    table.add("none", "-", "-", _share(_marks(histories, "", 0.0).others, n))
    for label, size in _CHANGES:
        marks = _marks(histories, label, size)
        unit = "mm" if label == "height" else "deg"
        cells = (_share(each, n) for each in (marks.at_once, marks.found, marks.others))
        table.add(f"{label} {size:g} {unit}", *cells)
    yield table


def _marks(histories: Sequence[Sequence[Judged]], label: str, size: float) -> _Marks:
    at_once = found = others = 0
    for drives in histories:
        history = history_of([_result(drive, index, label, size) for index, drive in enumerate(drives)])
        marked = _of_change(history, label)
        at_once += _MOVED_AT in marked
        found += bool(marked)
        others += any(each.quantity.heading != label or each.later < _MOVED_AT for each in history.changes)
    return _Marks(at_once, found, others)


def _of_change(history: History, label: str) -> set[int]:
    """Return the drives after a change in which the number that has changed is marked."""
    return {
        each.later
        for each in history.changes
        if each.quantity.heading == label and each.earlier < _MOVED_AT <= each.later
    }


def _result(drive: Judged, index: int, label: str, size: float) -> DriveResult:
    """Return what a drive says of a mount at 0, or at the change."""
    known = {}
    for component, error, std, per_si in zip(POSE_COMPONENTS, drive.error, drive.std, READABLE, strict=True):
        moved = size if component.label == label and index >= _MOVED_AT else 0.0
        known[component.name] = Known((float(error) + moved) / float(per_si), float(std) / float(per_si))
    return DriveResult(str(index), None, known)


def _share(count: int, n: int) -> str:
    return f"{np.round(100.0 * count / n, 1):g} %"
