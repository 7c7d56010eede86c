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

"""What the page shows of the right camera's turn: verdict, angles, and their course over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..core.alignment_verdict import (
    GOOD_LIMITS_RAD,
    AlignmentReport,
    AlignmentVerdict,
    report_alignment,
    seen_angles,
)
from ..core.delay_report import describe_delay
from ..core.geometry.alignment import ALIGNMENT_NAMES, Alignment
from ..offline import FrameRow, Replay
from .charts import Level, time_series
from .figures import time_axis

_PER_SI = math.degrees(1.0)
# A frame that tells an angle less well is a mark, no dot: ten times what calibrations leave.
_SHOWN_STD_RAD = math.radians(0.1)
_WORDS = {
    AlignmentVerdict.GOOD: ("Good", "good"),
    AlignmentVerdict.CORRECTABLE: ("Correctable", "warn"),
    AlignmentVerdict.CALIBRATE_AGAIN: ("Calibrate the cameras again", "bad"),
    AlignmentVerdict.NOT_SEEN: ("Not seen well enough", "warn"),
}
_MEANINGS = ("> 0: nose down, its rows lie too high", "> 0: right side down", "> 0: too far left")


def alignment_report(replay: Replay) -> AlignmentReport:
    """Return the alignment of a recording in the user's units."""
    return report_alignment(replay.estimate.alignment, replay.rig)


def alignment_section(replay: Replay) -> dict[str, Any] | None:
    """Return what the section says; None where no frame tells of the alignment.

    Args:
        replay: The recording's outcome.
    """
    rows = [row for row in replay.rows_of_rig if row.alignment is not None]
    alignment = replay.estimate.alignment
    if alignment is None and not rows:
        return None
    report = alignment_report(replay)
    word, kind = _WORDS[report.verdict]
    return {
        "word": word,
        "kind": kind,
        "sentence": sentence_of(report),
        "delay": delay_sentence(replay),
        "lines": [] if alignment is None else _lines(alignment),
        "charts": _charts(replay, rows),
    }


def sentence_of(report: AlignmentReport) -> str:
    """Return the message of an alignment as a sentence of the page."""
    message = report.message.replace("+-", "±").replace(" deg", "°")
    return f"{message[0].upper()}{message[1:]}."


def delay_sentence(replay: Replay) -> str:
    """Return when right images are taken, as a sentence of the page; "" where nothing tells it."""
    message = describe_delay(replay.estimate.delay).replace("+-", "±")
    return f"{message[0].upper()}{message[1:]}." if message else ""


def _lines(alignment: Alignment) -> list[list[str]]:
    """Return a row of the table for each angle."""
    lines = []
    values, stds = np.degrees(alignment.as_array()), np.degrees(alignment.std)
    known, seen = alignment.known(), seen_angles(alignment)
    for index, name in enumerate(ALIGNMENT_NAMES):
        value = f"{values[index]:+.3f}°" if known[index] else "–"
        std = f"{stds[index]:.3f}°" if known[index] else "–"
        limit = f"{math.degrees(GOOD_LIMITS_RAD[index]):.2f}°"
        lines.append([_label(name), _MEANINGS[index], value, std, limit, "yes" if seen[index] else "no"])
    return lines


def _charts(replay: Replay, rows: Sequence[FrameRow]) -> list[dict[str, str]]:
    """Return each angle over time, of the frames that tell it."""
    time, unit = time_axis(replay.rows)
    charts = []
    for index, name in enumerate(ALIGNMENT_NAMES):
        told = [(row.stamp_s, row.alignment) for row in rows if row.alignment is not None]
        good = [(stamp_s, each) for stamp_s, each in told if each.std[index] <= _SHOWN_STD_RAD]
        if not good:
            continue
        shown_s = {stamp_s for stamp_s, _ in good}
        others = np.array(sorted(time(row.stamp_s) for row in replay.rows if row.stamp_s not in shown_s))
        times = np.array([time(stamp_s) for stamp_s, _ in good])
        values = np.array([each.as_array()[index] for _, each in good]) * _PER_SI
        levels = []
        fused = replay.estimate.alignment
        if fused is not None and fused.std[index] <= _SHOWN_STD_RAD:
            at, by = (float(each[index]) * _PER_SI for each in (fused.as_array(), fused.std))
            # All frames of the rig together: one that starts from the frame before tells no angle anew.
            first_s, last_s = (replay.rows_of_rig[end].stamp_s for end in (0, -1))
            levels.append(Level(time(first_s), time(last_s), at, by))
        label = f"{_label(name)} of the right camera over time"
        svg = time_series(times, values, others, levels, [], (label, unit))
        charts.append({"title": f"{_label(name)} of the right camera [deg]", "svg": svg})
    return charts


def _label(name: str) -> str:
    return name.rpartition("_")[0].capitalize()
