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

"""The output of replay: a table for people and a JSON object for programs."""

from __future__ import annotations

import json
import math
import statistics
from collections import Counter
from collections.abc import Sequence
from typing import Any

from ..core.alignment_verdict import report_alignment
from ..core.camera.rig import StereoRig
from ..core.delay_report import describe_delay
from ..core.drive.camera_changes import CameraChange
from ..core.drive.drive import Drive, DriveSegment, clock
from ..core.errors import printable
from ..core.geometry.alignment import ALIGNMENT_NAMES, Alignment
from ..core.geometry.mount import MountEvidence
from ..core.geometry.pose import POSE_COMPONENTS, POSE_NAMES, STD_NAMES, Extrinsics
from ..core.geometry.travel import RightDelay, Travel
from ..core.geometry.uncertainty import UncertaintyTerm
from ..core.reservations import Reservation
from ..offline import AttemptSummary, FrameRow, Goal, Replay
from ..report.mount import how_reached
from ..report.travel import travel_sentence
from ..report.uncertainty import std_of, variance_line

_STAMP_WIDTH = 17  # seconds since 1970 with microseconds
_VERDICT_WIDTH = 24  # the longest reject reason and a space
_LABEL_WIDTH = _STAMP_WIDTH + 2 + _VERDICT_WIDTH
# Components of a pose with the widths of their columns: two spaces and the heading.
_POSE_COLUMNS = tuple((component, len(component.heading) + 2) for component in POSE_COMPONENTS)
_HEADINGS = f"  {'verdict':<{_VERDICT_WIDTH}}" + "".join(
    f"{component.heading:>{width}}" for component, width in _POSE_COLUMNS
)
_RULE = f"{'-' * (_STAMP_WIDTH + len(_HEADINGS))}\n"


def table_header(counted: bool = False) -> str:
    """Return the two lines over the table.

    Args:
        counted: Whether the frames have names and no stamps.
    """
    return f"{'image' if counted else 'stamp [s]':>{_STAMP_WIDTH}}{_HEADINGS}\n{_RULE}"


def table_row(row: FrameRow, counted: bool = False) -> str:
    """Return the line of one frame: its stamp, or the end of its name.

    Args:
        row: The frame.
        counted: Whether it has a name and no stamp.
    """
    name = printable(row.name)
    if len(name) > _STAMP_WIDTH:
        name = f"...{name[3 - _STAMP_WIDTH :]}"
    label = name if counted else f"{row.stamp_s:.6f}"
    return _line(f"{label:>{_STAMP_WIDTH}}  {row.reason or 'accepted':<{_VERDICT_WIDTH}}", row.extrinsics)


def table_summary(replay: Replay) -> str:
    """Return the lines under the table: mean and scatter of the accepted frames, and the mount."""
    rows, estimate, drive = replay.rows, replay.estimate, replay.drive
    accepted = [row.extrinsics for row in replay.rows_of_rig if row.extrinsics is not None]
    text = f"{_RULE}{sum(row.accepted for row in rows)} of {len(rows)} frames accepted\n"
    refused = Counter(row.reason for row in rows if row.reason is not None)
    for reason, count in refused.most_common():
        text += f"  {count} x {reason}\n"
    moved = bool(drive.changes)
    if accepted and not moved:
        text += _line("mean of the frames", _over(accepted, statistics.fmean))
    if len(accepted) > 1 and not moved:
        text += _line("scatter of the frames", _over(accepted, statistics.stdev), spread=True)
    if estimate.accepted and estimate.extrinsics is not None:
        text += _line("mount", estimate.extrinsics)
        if estimate.std is not None:
            text += _line("standard deviation of the mount", estimate.std, spread=True)
        if estimate.uncertainty:
            text += f"its variance: {variance_line(estimate.uncertainty)}\n"
        reached = how_reached(estimate.mount, estimate.n_frames)
        text += "".join(f"{sentence}\n" for sentence in (*reached, travel_sentence(estimate.travel)))
    text += f"{_moves(drive)}{printable(estimate.message)}\n"
    if replay.goal is not None:
        text += f"{printable(replay.goal.message)}\n"
    if estimate.alignment is not None:
        text += f"alignment: {report_alignment(estimate.alignment, replay.rig).message}\n"
    if estimate.delay is not None:
        text += f"synchronisation: {describe_delay(estimate.delay)}\n"
    text += "".join(f"{printable(remark)}\n" for remark in replay.remarks)
    if replay.damage is not None:
        text += f"THE RECORDING IS DAMAGED AND ENDED EARLY, after {len(rows)} frames\n"
    return text


def _moves(drive: Drive) -> str:
    """Return a line for every move of the mount, and for every segment if there is more than one."""
    if not drive.changes:
        return ""
    text = ""
    for number, segment in enumerate(drive.segments):
        if number:
            change = drive.changes[number - 1]
            text += _line(f"moved {clock(change.at_s)} (within {change.within_s:.1f} s) by", change.shift)
        if segment.estimate.extrinsics is not None:
            times = f"{clock(segment.start_s)} to {clock(segment.end_s)}"
            text += _line(times, segment.estimate.extrinsics)
    return text


def as_json(replay: Replay) -> str:
    """Return one JSON object in one line: SI units, radians, floats with all their digits."""
    return json.dumps(as_dict(replay), allow_nan=False) + "\n"


def as_dict(replay: Replay) -> dict[str, Any]:
    """Return what :func:`as_json` writes.

    A damaged recording has one key more, ``ended_early``, and one with images in no frame ``remarks``;
    one whose CameraInfo changes has ``camera_changes``.
    """
    estimate, drive = replay.estimate, replay.drive
    extrinsics = estimate.extrinsics if estimate.accepted else None
    content: dict[str, Any] = {
        "accepted": estimate.accepted,
        "reason": None if estimate.reason is None else str(estimate.reason),
        "message": estimate.message,
        "extrinsics": None if extrinsics is None else _pose(extrinsics),
        "std": None if extrinsics is None or estimate.std is None else _pose(estimate.std),
        "lane_yaw_rad": estimate.lane_yaw_rad if estimate.accepted else None,
        "frames": [
            {"stamp_s": row.stamp_s}
            | ({"name": row.name} if row.name else {})
            | {"accepted": row.accepted, "reason": row.reason}
            | _pose(row.extrinsics)
            | {"std": None if row.covariance is None else _pose(std_of(row.covariance))}
            | {"known_start": row.known_start, "stood": row.stood}
            | {"reservations": _reservations(row.reservations, 1)}
            | {"alignment": _alignment(row.alignment, replay.rig_of(row))}
            | {"attempts": [_attempt(attempt) for attempt in row.attempts]}
            for row in replay.rows
        ],
        "segments": [_segment(segment) for segment in drive.segments],
        "changes": [
            {"at_s": change.at_s, "within_s": change.within_s, "shift": _pose(change.shift)}
            for change in drive.changes
        ],
        "uncertainty": None if extrinsics is None else _uncertainty(estimate.uncertainty),
        "alignment": _alignment(estimate.alignment, replay.rig),
        "travel": _travel(estimate.travel),
        "delay": _delay(estimate.delay),
        "with_reservations": replay.with_reservations,
        "reservations": _reservations(estimate.reservations, estimate.n_frames),
        "mount": _mount(estimate.mount),
        "targets_reached": None if replay.goal is None else replay.goal.reached,
        "targets": _goal(replay.goal),
    }
    if replay.camera_changes:
        content["camera_changes"] = [_camera_change(change) for change in replay.camera_changes]
    if replay.damage is not None:
        content["ended_early"] = replay.damage
    if replay.remarks:
        content["remarks"] = list(replay.remarks)
    return content


def _camera_change(change: CameraChange) -> dict[str, Any]:
    return {
        "at_s": change.at_s,
        "message": change.message,
        "before": change.before.to_mapping(),
        "after": change.after.to_mapping(),
    }


def _segment(segment: DriveSegment) -> dict[str, Any]:
    return {
        "start_s": segment.start_s,
        "end_s": segment.end_s,
        "frames": segment.estimate.n_frames,
        "extrinsics": _pose(segment.estimate.extrinsics),
        "std": _pose(segment.estimate.std),
        "spread": _pose(segment.spread),
        "standard_error": None if segment.standard_error is None else _pose(segment.standard_error),
        "uncertainty": _uncertainty(segment.estimate.uncertainty),
        "mount": _mount(segment.estimate.mount),
        "travel": _travel(segment.estimate.travel),
        "reservations": _reservations(segment.estimate.reservations, segment.estimate.n_frames),
    }


def _uncertainty(terms: Sequence[UncertaintyTerm]) -> dict[str, Any]:
    """Return the standard deviations that each term alone leaves, by its name."""
    return {term.name: _pose(std_of(term.covariance)) for term in terms}


def _mount(mount: MountEvidence | None) -> dict[str, Any] | None:
    """Return how an estimate of the mount was reached; a number that is not known is None."""
    if mount is None:
        return None
    of_motion = {"memory_s": mount.memory_s, "looks": mount.looks}
    return {
        "duration_s": mount.duration_s,
        "outliers": mount.n_outliers,
        "known_starts": mount.n_known,
        "stood": mount.stood,
        "motion": _pose(mount.motion),
        **{
            name: {
                component.label: float(value) if math.isfinite(value) else None
                for component, value in zip(POSE_COMPONENTS, values, strict=True)
            }
            for name, values in of_motion.items()
        },
    }


def _goal(goal: Goal | None) -> dict[str, Any] | None:
    """Return what was asked of a recording, and what became of it."""
    if goal is None:
        return None
    return {
        "reached": goal.reached,
        **dict(zip(STD_NAMES, map(float, goal.targets.std.as_array()), strict=True)),
        "min_frames": goal.targets.frames,
        "frames": goal.frames,
        "duration_s": goal.duration_s,
        "message": goal.message,
    }


def _alignment(alignment: Alignment | None, rig: StereoRig) -> dict[str, Any] | None:
    """Return an alignment with its verdict; an angle that is not known is None, and so is its deviation."""
    if alignment is None:
        return None
    unknown, report = dict.fromkeys(ALIGNMENT_NAMES), report_alignment(alignment, rig)
    named = zip(ALIGNMENT_NAMES, alignment.std, alignment.known(), strict=True)
    std = {name: float(value) for name, value, known in named if known}
    content: dict[str, Any] = {**unknown, **alignment.as_dict(), "std": {**unknown, **std}}
    return content | {"verdict": str(report.verdict), "message": report.message}


def _travel(travel: Travel | None) -> dict[str, Any] | None:
    """Return the camera against the direction of travel, whether it tells the yaw or not."""
    if travel is None:
        return None
    yaw_std_rad, pitch_std_rad = map(float, travel.std)
    return {
        "yaw_known": travel.tells_yaw,
        "yaw_rad": travel.yaw_rad,
        "yaw_std_rad": yaw_std_rad,
        "pitch_rad": travel.pitch_rad,
        "pitch_std_rad": pitch_std_rad,
        "n_steps": travel.n_steps,
        "lever_m": travel.lever_m,
        "driven_s": travel.driven_s,
    }


def _delay(delay: RightDelay | None) -> dict[str, Any] | None:
    """Return when right images are taken, with how much farther ahead the right camera sits."""
    if delay is None:
        return None
    names = "delay_s", "offset_m"
    std = dict(zip(names, map(float, delay.std), strict=True))
    values: dict[str, Any] = {"delay_s": delay.delay_s, "offset_m": delay.offset_m, "std": std}
    return values | {"frames": delay.n_frames, "message": describe_delay(delay)}


def _reservations(reservations: Sequence[Reservation], n_frames: int) -> list[dict[str, Any]]:
    return [
        {"kind": str(each.kind), "frames": each.frames, "message": each.text(n_frames)}
        for each in reservations
    ]


def _attempt(attempt: AttemptSummary) -> dict[str, Any]:
    return {
        "found_by": str(attempt.found_by),
        "verdict": str(attempt.verdict),
        "reason": attempt.reason,
        "message": attempt.message,
    }


def _pose(extrinsics: Extrinsics | None) -> dict[str, Any]:
    """Return the components by name, each None without a pose."""
    return dict.fromkeys(POSE_NAMES) if extrinsics is None else extrinsics.as_dict()


def _over(poses: Sequence[Extrinsics], statistic: Any) -> Extrinsics:
    """Apply ``statistic`` to each component of the poses."""
    return Extrinsics(
        *(float(statistic(values)) for values in zip(*(p.as_array() for p in poses), strict=True))
    )


def _line(label: str, pose: Extrinsics | None, spread: bool = False) -> str:
    """Return a table line; a spread (standard deviation) has no sign and one digit more."""
    cells = ""
    for component, width in _POSE_COLUMNS:
        text = "-"
        if pose is not None:
            sign, more = ("", 1) if spread else (component.sign, 0)
            text = component.unit.number(component.of(pose), sign, more=more)
        cells += f"{text:>{width}}"
    return f"{label:<{_LABEL_WIDTH}}{cells}\n"
