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

"""The index page of a fleet: one row a recording, each with a link to its report. One file, no network."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from html import escape

from ..core.geometry.alignment import ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES
from ..core.geometry.pose import DEGREES, POSE_COMPONENTS, DisplayUnit, Extrinsics, PoseComponent
from .outcome import BagOutcome, Status
from .style import breakable, number_cell, page_of

# Sorts recordings, each a tbody, by the column that is clicked: by data-v where a cell has one.
_SCRIPT = """
document.querySelectorAll("th").forEach((head, column) => head.addEventListener("click", () => {
  const up = head.getAttribute("aria-sort") !== "ascending";
  document.querySelectorAll("th").forEach(other => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  const value = recording => {
    const cell = recording.rows[0].cells[column], number = parseFloat(cell.dataset.v);
    return isNaN(number) ? cell.textContent : number;
  };
  const table = document.querySelector("table");
  [...table.tBodies].sort((a, b) => {
    const x = value(a), y = value(b);
    const order = typeof x === typeof y ? (x > y) - (x < y) : typeof x === "number" ? -1 : 1;
    return up ? order : -order;
  }).forEach(recording => table.append(recording));
}));
"""

_HEADS = (
    "recording",
    "verdict",
    "frames",
    "accepted",
    "confirmed",
    "moves",
    *(component.heading for component in POSE_COMPONENTS),
    "yaw [deg]",
    "alignment",
)
_EQUATION = "p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height]"


def index_page(outcomes: Sequence[BagOutcome], about: str) -> str:
    """Return the page.

    Args:
        outcomes: All recordings, in order.
        about: One line on how they were made: versions, settings.
    """
    counts = Counter(outcome.status for outcome in outcomes)
    reserved = sum(outcome.with_reservations for outcome in outcomes)
    summary = ", ".join(f"{counts[status]} {_words(status)}" for status in Status if counts[status])
    summary += f"; {reserved} with reservations" if reserved else ""
    left = counts[Status.NOT_DONE]
    note = f'<p class="note">Interrupted: {left} recordings are not done yet.</p>' if left else ""
    heads = "".join(f"<th>{escape(head)}</th>" for head in _HEADS)
    rows = "\n".join(_row(outcome) for outcome in outcomes)
    title = f"{len(outcomes)} recordings: {summary}"
    body = f"""<h1>{escape(title)}</h1>
{note}
<p><code>{_EQUATION}</code>; REP-103: pitch &gt; 0 is nose down, roll &gt; 0 is right side down.
The yaw is that against the direction of travel, &gt; 0 is left of it; it has no value while it is not known.
Confirmed are accepted frames whose road surface agrees with the lines. Alignment is how the right camera is
turned against its calibration. The whole table is in <a href="table.csv">table.csv</a>.
On a wide screen, a click on a heading sorts.</p>
<table class="sort">
<thead><tr>{heads}</tr></thead>
{rows}
</table>
<p>{escape(about)}</p>
<script>{_SCRIPT}</script>"""
    return page_of(title, body)


def _row(outcome: BagOutcome) -> str:
    name = breakable(outcome.bag)
    link = f'<a href="{escape(outcome.report, quote=True)}">{name}</a>' if outcome.report else name
    reserved, colour = "", str(outcome.status)
    if outcome.with_reservations:
        reserved = ", with reservations"
        colour = "reserved" if outcome.status is Status.CALIBRATED else colour
    accepted = outcome.accepted
    share = f"{100 * accepted / outcome.frames:.0f}" if outcome.frames else "0"
    counts = (("confirmed", outcome.confirmed), ("moves", outcome.moves))
    pose, std = outcome.extrinsics, outcome.std
    verdict = escape(outcome.alignment.replace("_", " "))
    cells = [
        f'<td class="name">{link}</td>',
        f'<td class="verdict"><b class="status {colour}">{_words(outcome.status)}{reserved}</b></td>',
        number_cell("frames", str(outcome.frames), outcome.frames),
        number_cell(
            "accepted", str(accepted), accepted, f'<span class="meter"><i style="width:{share}%"></i></span>'
        ),
        *(number_cell(label, str(count), count) for label, count in counts),
        *(_component(component, pose, std) for component in POSE_COMPONENTS),
        _number("yaw [deg]", outcome.yaw_rad, outcome.yaw_std_rad, DEGREES, "+"),
        f'<td data-label="alignment">{verdict}</td>' if verdict else "<td></td>",
    ]
    facts = "".join(
        f'<span><b class="k">{label}:</b> {escape(text)}</span>' for label, text in _facts(outcome) if text
    )
    below = f'<tr><td class="why" colspan="{len(_HEADS)}">{facts}</td></tr>'
    return f"<tbody><tr>{''.join(cells)}</tr>{below}</tbody>"


def _facts(outcome: BagOutcome) -> list[tuple[str, str]]:
    """Return what stands below the numbers of a recording, each with its name; "" where there is nothing."""
    if outcome.status is Status.CALIBRATED:
        said = outcome.message.partition("; ")[2]  # the numbers are in the other cells
    else:
        said = ": ".join(dict.fromkeys(filter(None, (outcome.reason, outcome.message))))
    return [
        ("What was said", said),
        ("Uncertainty", outcome.uncertainty),
        ("Progress", outcome.progress),
        ("Right camera turned by", _turned(outcome)),
    ]


def _turned(outcome: BagOutcome) -> str:
    """Return the angles of the right camera that are known, in words."""
    told = []
    for name, std_name in zip(ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES, strict=True):
        value, std = (getattr(outcome, f"alignment_{each}") for each in (name, std_name))
        if value is not None and std is not None:
            told.append(f"{name.rpartition('_')[0]} {math.degrees(value):+.3f} ± {math.degrees(std):.2g}°")
    return ", ".join(told)


def _component(component: PoseComponent, pose: Extrinsics | None, std: Extrinsics | None) -> str:
    """Return the cell of one component of a pose and its standard deviation; empty without a pose."""
    value, spread = (None if each is None else component.of(each) for each in (pose, std))
    return _number(component.heading, value, spread, component.unit, component.sign)


def _number(label: str, value: float | None, std: float | None, unit: DisplayUnit, sign: str) -> str:
    """Return the cell of a number and its standard deviation, both in the SI unit; empty without a number."""
    if value is None:
        return number_cell(label, "")
    spread = "" if std is None else f" &plusmn; {std * unit.per_si:.2g}"
    return number_cell(label, f"{unit.number(value, sign)}{spread}", value * unit.per_si)


def _words(status: Status) -> str:
    return str(status).replace("_", " ")
