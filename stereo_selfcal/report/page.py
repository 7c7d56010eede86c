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

"""The page: what is said, in words and numbers, and the template it is put into."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from datetime import datetime, timezone
from importlib.resources import files
from typing import Any

import cv2
import jinja2
import numpy as np

from .. import __version__
from ..core.config import CalibratorConfig
from ..core.delay_report import is_late
from ..core.drive.drive import FIRST_CLOCK_S, DriveSegment, clock
from ..core.errors import printable
from ..core.geometry.pose import DEGREES, POSE_COMPONENTS, Extrinsics, PoseComponent
from ..core.geometry.travel import Travel
from ..offline import FrameRow, FrameSource, Replay
from .alignment import alignment_report, alignment_section, delay_sentence, sentence_of
from .charts import PHONE_LETTERS
from .choice import refusals
from .figures import MINUTE_S, charts, gates, residuals
from .mount import how_reached
from .pictures import digits, pictures
from .progress import progress_section
from .remedies import remedy_of
from .travel import travel_sentence
from .tried import tried
from .uncertainty import uncertainty_table, unit_symbol
from .vehicle import vehicle_section, yaw_chart

_TEMPLATE = "report.html.j2"
_MOST_CAUSES = 3  # named in the verdict
_HOUR_S = 3600.0
_NOT_KNOWN = "–"
_VERY_MANY = 100  # standard errors: more of them say nothing more


def render_report(source: FrameSource, replay: Replay) -> str:
    """Return the report of a recording as HTML that needs no other file and no network.

    The same recording, settings and versions give the same text.

    Args:
        source: The recording, open: the frames that are shown are read again.
        replay: What was made of it.
    """
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=_shown)
    template = (files(__package__) / "templates" / _TEMPLATE).read_text(encoding="utf-8")
    rows, drive = replay.rows, replay.drive
    page = environment.from_string(template).render(
        title=source.name,
        phone_letters=PHONE_LETTERS,
        verdict=_verdict(replay),
        estimates=[_estimate(segment, rows) for segment in drive.segments],
        changes=[_change(change) for change in drive.changes],
        judged=drive.judged,
        counts=_counts(rows),
        pictures=pictures(source, replay),
        charts=[*charts(rows, drive), *yaw_chart(replay)],
        progress=progress_section(replay),
        vehicle=vehicle_section(replay.estimate),
        alignment=alignment_section(replay),
        residuals=residuals(rows, drive),
        gates=gates(rows),
        refusals=_refusals(rows),
        tried=tried(rows),
        provenance=_provenance(source, replay),
        settings=_settings(replay.config),
    )
    return str(page)


def _shown(value: Any) -> Any:
    """Return a value of the page: names may hold what turns the text around them about, or is no UTF-8."""
    return printable(value) if type(value) is str else value  # not of Markup, which is ours


def _verdict(replay: Replay) -> dict[str, Any]:
    """Return the verdict: a word, a sentence, and what stands against it."""
    rows, drive, estimate = replay.rows, replay.drive, replay.estimate
    doubts = [] if replay.damage is None else [f"The recording is damaged: {replay.damage}."]
    doubts += [f"{remark[0].upper()}{remark[1:]}" for remark in replay.remarks]
    if estimate.extrinsics is None or not estimate.accepted:
        why = refusals(rows)
        causes = ", ".join(f"{reason} ({count})" for reason, count, _ in why[:_MOST_CAUSES])
        text = f"None of {_number(len(rows), 'frame')} could be used: {causes}."
        doubts += [f"What to do: {remedy_of(why[0][2])}."] if why else []
        return {"word": "Not calibrated", "kind": "bad", "sentence": text, "doubts": doubts}
    pose = _in_words(estimate.extrinsics)
    if drive.changes:
        change = drive.changes[-1]
        times = "once, at" if len(drive.changes) == 1 else f"{len(drive.changes)} times, last at"
        text = f"The camera was moved {times} {clock(change.at_s)}. Since then it is {pose}; "
        text += f"before it was {_in_words(change.before)}."
    else:
        text = f"The camera is {pose}"
        span = _duration(rows[-1].stamp_s - rows[0].stamp_s)
        text += f", and did not move during {span}." if drive.judged else "."
        if not drive.judged:
            doubts.append("The recording is too short to tell a move of the camera: that takes four minutes.")
    doubts += [_sentence(note) for note in estimate.notes]
    turned = alignment_report(replay)
    if turned.verdict.is_fault:
        doubts.append(sentence_of(turned))
    if replay.goal is not None and not replay.goal.reached:
        doubts.append(_sentence(replay.goal.message))
    if is_late(estimate.delay):
        doubts.append(delay_sentence(replay))
    moved = ", and moved" if drive.changes else ""
    word = f"Calibrated{moved}{', with reservations' if replay.with_reservations else ''}"
    kind = "warn" if drive.changes or replay.with_reservations else "good"
    return {"word": word, "kind": kind, "sentence": text, "doubts": doubts}


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _in_words(pose: Extrinsics) -> str:
    pitch, roll = math.degrees(pose.pitch_rad), math.degrees(pose.roll_rad)
    nose, side = "down" if pitch >= 0 else "up", "right" if roll >= 0 else "left"
    return (
        f"{pose.height_m:.3f} m above the road, pitched {abs(pitch):.2f}° nose {nose} "
        f"and rolled {abs(roll):.2f}° {side} side down"
    )


def _estimate(segment: DriveSegment, rows: Sequence[FrameRow]) -> dict[str, Any]:
    """Return the table of one segment."""
    estimate = segment.estimate
    if estimate.extrinsics is None or estimate.std is None:
        raise ValueError("a segment is made of accepted frames")
    lines = []
    inside = [row for row in rows if row.accepted and segment.start_s <= row.stamp_s <= segment.end_s]
    spread = segment.spread if estimate.n_frames > 1 else None
    spreads = [estimate.std, _std_of_a_frame(inside), spread, segment.standard_error]
    for component in POSE_COMPONENTS:
        value = component.of(estimate.extrinsics)
        shown = component.unit.number(value, component.sign, fine=True) + unit_symbol(component.unit)
        lines.append([component.label.capitalize(), shown, *(_small(each, component) for each in spreads)])
    if estimate.travel is not None and estimate.travel.tells_yaw:
        lines.append(_yaw_line(estimate.travel))
    reached = how_reached(estimate.mount, estimate.n_frames)
    span = f"{clock(segment.start_s)} to {clock(segment.end_s)}"
    return {
        "span": span,
        "frames": len(inside),
        "used": estimate.n_frames,
        "lines": lines,
        "reached": [*reached, travel_sentence(estimate.travel)],
        "uncertainty": uncertainty_table(estimate.uncertainty),
    }


def _yaw_line(travel: Travel) -> list[str]:
    """Return the row of the yaw: no frame alone tells it, so only the mount has it."""
    shown = DEGREES.number(travel.yaw_rad, "+", fine=True) + unit_symbol(DEGREES)
    std = digits(float(travel.std[0]) * DEGREES.per_si) + unit_symbol(DEGREES)
    return ["Yaw against travel", shown, std, *[_NOT_KNOWN] * 3]


def _std_of_a_frame(rows: Sequence[FrameRow]) -> Extrinsics | None:
    """Return the median of the standard deviations that frames report of their own moment."""
    variances = [np.diagonal(row.covariance) for row in rows if row.covariance is not None]
    return Extrinsics.from_array(np.sqrt(np.median(variances, axis=0))) if variances else None


def _small(pose: Extrinsics | None, component: PoseComponent) -> str:
    """Return one component of a standard deviation or a spread, a dash if it is not known."""
    if pose is None:
        return _NOT_KNOWN
    unit = component.small_unit
    return digits(component.of(pose) * unit.per_si) + unit_symbol(unit)


def _change(change: Any) -> dict[str, Any]:
    """Return the row of one move; its shifts are labels and texts, one for each component of the pose."""
    sigmas = change.sigmas
    parts = [(each.label, each.of(change.shift), each.small_unit) for each in POSE_COMPONENTS]
    return {
        "at": clock(change.at_s),
        "within": f"{change.within_s:.1f} s" if change.within_s < MINUTE_S else _duration(change.within_s),
        "shifts": [
            (label.capitalize(), _signed(value * unit.per_si, unit.decimals) + unit_symbol(unit))
            for label, value, unit in parts
        ],
        "sigmas": f"{most:.0f}" if (most := float(np.max(sigmas))) < _VERY_MANY else f"over {_VERY_MANY}",
    }


def _signed(value: float, digits: int) -> str:
    """Return a number with its sign; what is rounded to zero has none."""
    return f"{value:+.{digits}f}" if round(value, digits) else f"{0:.{digits}f}"


def _counts(rows: Sequence[FrameRow]) -> dict[str, int]:
    accepted = [row for row in rows if row.accepted]
    confirmed = sum(row.confirmed for row in accepted)
    return {"frames": len(rows), "accepted": len(accepted), "confirmed": confirmed}


def _refusals(rows: Sequence[FrameRow]) -> list[dict[str, Any]]:
    """Return every reason with its share, its remedy and an example."""
    all_refused = refusals(rows)
    most = max((count for _, count, _ in all_refused), default=1)
    return [
        {
            "reason": reason,
            "count": count,
            "share": f"{100 * count / len(rows):.0f} %",
            "bar": f"{100 * count / most:.0f}",
            "remedy": (remedy := remedy_of(row))[:1].upper() + remedy[1:],
            "example": "" if row.rejection is None else row.rejection.finding,
        }
        for reason, count, row in all_refused
    ]


def _provenance(source: FrameSource, replay: Replay) -> list[tuple[str, str]]:
    rig, rows, selection = replay.rig, replay.rows, source.selection
    first, last = rows[0], rows[-1]
    chosen = [
        text
        for text, given in (
            (f"from {selection.start_s:g} s", selection.start_s),
            (f"to {selection.end_s or 0:g} s", selection.end_s is not None),
            (f"every {selection.every}th frame", selection.every > 1),
            (f"at most {selection.max_frames} frames", selection.max_frames is not None),
        )
        if given
    ]
    entries = [
        ("Recording", source.name),
        ("Left images", f"{source.left_name} ({source.n_images[0]})"),
        ("Right images", f"{source.right_name} ({source.n_images[1]})"),
        ("Frames", f"{len(rows)}; {', '.join(chosen) or 'all of them'}"),
        ("First and last", f"{_date(first.stamp_s)} to {_date(last.stamp_s)}"),
        ("Image size", f"{rig.width} x {rig.height} px"),
        ("Focal length", f"{rig.fx:.6g}, {rig.fy:.6g} px"),
        ("Principal point", f"{rig.cx:.6g}, {rig.cy:.6g} px"),
        ("Baseline", f"{rig.baseline_m * 1e3:.4g} mm"),
        ("Seed", f"{replay.config.seed}"),
        (
            "Versions",
            f"stereo_selfcal {__version__}, OpenCV {cv2.__version__}, numpy {np.__version__}, "
            f"Python {platform.python_version()}",
        ),
    ]
    if replay.goal is not None:
        entries.append(("Asked", replay.goal.message))
    return entries + ([("Damage", replay.damage)] if replay.damage else [])


def _settings(config: CalibratorConfig) -> list[tuple[str, str]]:
    """Return the settings that are not the defaults."""
    defaults = {name: value for name, value, _ in CalibratorConfig().settings()}
    return [(name, str(value)) for name, value, _ in config.settings() if value != defaults[name]]


def _date(stamp_s: float) -> str:
    if stamp_s < FIRST_CLOCK_S:
        return clock(stamp_s)
    return datetime.fromtimestamp(stamp_s, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")


def _duration(seconds: float) -> str:
    if seconds < 2 * MINUTE_S:
        return f"{seconds:.0f} s"
    return f"{seconds / MINUTE_S:.0f} min" if seconds < 2 * _HOUR_S else f"{seconds / _HOUR_S:.1f} h"


def _number(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
