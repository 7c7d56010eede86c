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

from collections import Counter
from collections.abc import Sequence
from html import escape

from ..core.geometry.pose import DEGREES, POSE_COMPONENTS, DisplayUnit, Extrinsics, PoseComponent
from .outcome import BagOutcome, Status

# Colours of Okabe and Ito, which people with any kind of colour vision tell apart; the word is there as well.
_STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif; }
body { margin: 0 auto; max-width: 82rem; padding: 1rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem; text-align: left; vertical-align: top; border-bottom: 1px solid #8884; }
th { cursor: pointer; white-space: nowrap; }
th[aria-sort=ascending]::after { content: " \\2191"; }
th[aria-sort=descending]::after { content: " \\2193"; }
td.n { text-align: right; white-space: nowrap; }
h1 { font-size: 1.4rem; }
td.why { min-width: 20rem; font-size: .85rem; }
b.status { border-left: .5rem solid var(--c); padding-left: .4rem; white-space: nowrap; }
.calibrated { --c: #009e73; } .refused { --c: #e69f00; } .damaged { --c: #cc79a7; }
.reserved { --c: #f0e442; } .failed { --c: #d55e00; } .not_done { --c: #999; }
.note { border-left: .5rem solid #d55e00; padding: .4rem .8rem; }
"""

# Sorts by the column that is clicked: by data-v where a cell has one.
_SCRIPT = """
document.querySelectorAll("th").forEach((head, column) => head.addEventListener("click", () => {
  const up = head.getAttribute("aria-sort") !== "ascending";
  document.querySelectorAll("th").forEach(other => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  const value = row => {
    const cell = row.cells[column], number = parseFloat(cell.dataset.v);
    return isNaN(number) ? cell.textContent : number;
  };
  const body = document.querySelector("tbody");
  [...body.rows].sort((a, b) => {
    const x = value(a), y = value(b);
    const order = typeof x === typeof y ? (x > y) - (x < y) : typeof x === "number" ? -1 : 1;
    return up ? order : -order;
  }).forEach(row => body.append(row));
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
    "what was said",
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
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{len(outcomes)} recordings: {escape(summary)}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{len(outcomes)} recordings: {escape(summary)}</h1>
{note}
<p><code>{_EQUATION}</code>; REP-103: pitch &gt; 0 is nose down, roll &gt; 0 is right side down.
The yaw is that against the direction of travel, &gt; 0 is left of it; it has no value while it is not known.
Confirmed are accepted frames whose road surface agrees with the lines. The whole table is in
<a href="table.csv">table.csv</a>. A click on a heading sorts.</p>
<div class="scroll">
<table>
<thead><tr>{heads}</tr></thead>
<tbody>
{rows}
</tbody>
</table>
</div>
<p>{escape(about)}</p>
<script>{_SCRIPT}</script>
</body>
</html>
"""


def _row(outcome: BagOutcome) -> str:
    name = escape(outcome.bag)
    link = f'<a href="{escape(outcome.report, quote=True)}">{name}</a>' if outcome.report else name
    if outcome.status is Status.CALIBRATED:
        said = outcome.message.partition("; ")[2]  # the numbers are in the other cells
    else:
        said = ": ".join(dict.fromkeys(filter(None, (outcome.reason, outcome.message))))
    reserved, colour = "", str(outcome.status)
    if outcome.with_reservations:
        reserved = ", with reservations"
        colour = "reserved" if outcome.status is Status.CALIBRATED else colour
    counts = (outcome.frames, outcome.accepted, outcome.confirmed, outcome.moves)
    pose, std = outcome.extrinsics, outcome.std
    cells = [
        f"<td>{link}</td>",
        f'<td><b class="status {colour}">{_words(outcome.status)}{reserved}</b></td>',
        *(_cell(count, str(count)) for count in counts),
        *(_component(component, pose, std) for component in POSE_COMPONENTS),
        _yaw(outcome),
        f'<td class="why">{escape(said)}</td>',
    ]
    return f"<tr>{''.join(cells)}</tr>"


def _component(component: PoseComponent, pose: Extrinsics | None, std: Extrinsics | None) -> str:
    """Return the cell of one component of a pose and its standard deviation; empty without a pose."""
    if pose is None:
        return '<td class="n"></td>'
    spread = None if std is None else component.of(std)
    return _number(component.of(pose), spread, component.unit, component.sign)


def _yaw(outcome: BagOutcome) -> str:
    """Return the cell of the yaw against the direction of travel; empty while it is not known."""
    if outcome.yaw_rad is None:
        return '<td class="n"></td>'
    return _number(outcome.yaw_rad, outcome.yaw_std_rad, DEGREES, "+")


def _number(value: float, std: float | None, unit: DisplayUnit, sign: str) -> str:
    """Return the cell of a number and its standard deviation, both in the SI unit."""
    spread = "" if std is None else f" &plusmn; {std * unit.per_si:.2g}"
    return _cell(value * unit.per_si, f"{unit.number(value, sign)}{spread}")


def _cell(value: float, text: str) -> str:
    """Return the cell of a number, which is sorted by its value."""
    return f'<td class="n" data-v="{value!r}">{text}</td>'


def _words(status: Status) -> str:
    return str(status).replace("_", " ")
