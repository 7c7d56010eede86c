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

"""The history of a camera as a page: each number over the drives, and what has changed. No network."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
from html import escape

import numpy as np

from ..core.geometry.pose import DEGREES
from ..report.charts import Level, time_series
from .history import FALSE_MARKS, QUANTITIES, Comparison, History, Quantity, least_marked
from .style import breakable, number_cell, page_of

_HALF_BAND = 0.3  # of the distance of two drives: bands do not touch
_BETWEEN = 0.5
_HEADS = ("drive", "when", "recording", *(f"{each.heading} [{each.unit.symbol}]" for each in QUANTITIES))


def history_page(history: History, problems: Sequence[str], about: str) -> str:
    """Return the page.

    Args:
        history: The drives, compared.
        problems: A sentence for each result that is left out.
        about: One line on how it was made.
    """
    shown = [quantity for quantity in QUANTITIES if history.of(quantity)]
    n_known = sum(bool(drive.known) for drive in history.drives)
    n = len(history.comparisons)
    title = f"{len(history.drives)} drives of one camera: {_verdict(history)}"
    body = f"""<h1>{escape(title)}</h1>
{_changes(history)}
{_moves(history)}
<p class="soft">{n_known} of {len(history.drives)} drives have a calibration. Each number is compared with
that of the drive before and with that of the first drive. A difference is significant where it is larger
than the root of the sum of both variances allows. The rule of Holm holds for all {n} comparisons of this
page together: a camera in which nothing changes gets any mark with a probability of at most
{100 * FALSE_MARKS:.0f} %. Height, pitch and roll are over the road: the numbers cannot tell a bumped mount
from a load or a flat tyre.</p>
<h2>Over the drives</h2>
{"".join(_chart(history, quantity) for quantity in shown)}
<p class="soft">Dot: the result of a drive. Band: its standard deviation, up and down. Large red dot: it
differs significantly from the first drive or from the one before. Dashed: a significant change between
the two drives beside it. Marks at the bottom: drives that do not tell the number.</p>
<h2>All drives</h2>
{_table(history)}
{_left_out(problems)}
<p>{escape(about)}</p>"""
    return page_of(title, body)


def _verdict(history: History) -> str:
    count = len(history.changes)
    if not count:
        return "no significant change"
    return "1 significant change" if count == 1 else f"{count} significant changes"


def _changes(history: History) -> str:
    """Return what has changed, in words and as a table."""
    if not history.changes:
        return '<p class="note calm">Nothing has changed by more than the uncertainty of the results.</p>'
    lines = "".join(f"<li>{escape(change_sentence(history, each))}</li>" for each in history.changes)
    rows = "".join(f"<tbody>{_change(history, each)}</tbody>" for each in history.changes)
    heads = "<th>when</th><th>what</th><th>against</th>"
    heads += "".join(f'<th class="n">{each}</th>' for each in _CHANGE_NUMBERS)
    return f'<div class="note"><ul>{lines}</ul></div><table><thead><tr>{heads}</tr></thead>{rows}</table>'


_CHANGE_NUMBERS = ("before", "after", "change", "std of the change", "standard deviations")


def change_sentence(history: History, change: Comparison) -> str:
    """Return one change as a sentence."""
    since = f"Between drives {change.earlier + 1} and {change.later + 1}"
    if not change.is_before:
        since = f"Since the first drive, first seen in drive {change.later + 1}"
    return f"{since} ({_when(history, change.later)}): {change.sentence}."


def _change(history: History, change: Comparison) -> str:
    quantity = change.quantity
    unit, small, sign = quantity.unit, quantity.small_unit, "+" if quantity.unit == DEGREES else ""
    known = [history.drives[index].known[quantity.name].value for index in (change.earlier, change.later)]
    before, after = known
    numbers = (
        unit.number(before, sign),
        unit.number(after, sign),
        f"{small.number(change.difference, '+')} {small.symbol}",
        f"{small.number(change.std)} {small.symbol}",
        f"{abs(change.sigmas):.1f}",
    )
    against = "the drive before" if change.is_before else "the first drive"
    cells = "".join(number_cell(*pair) for pair in zip(_CHANGE_NUMBERS, numbers, strict=True))
    return (
        f"<tr><td>drive {change.later + 1}, {_when(history, change.later)}</td>"
        f'<td class="marked">{escape(quantity.heading)}</td>'
        f'<td data-label="against">{against} ({change.earlier + 1})</td>{cells}</tr>'
    )


def _moves(history: History) -> str:
    """Return which drives have a move in them."""
    moved = [str(index + 1) for index, drive in enumerate(history.drives) if drive.moves]
    if not moved:
        return ""
    during = ", ".join(moved)
    return f'<p class="note">The camera was moved during drive {during}; its numbers are those after.</p>'


def _chart(history: History, quantity: Quantity) -> str:
    told = history.of(quantity)
    per_si = quantity.unit.per_si
    numbers = np.array([index + 1.0 for index, _ in told])
    values = np.array([known.value for _, known in told]) * per_si
    silent = sorted({index + 1.0 for index in range(len(history.drives))} - set(numbers.tolist()))
    levels = [
        Level(number - _HALF_BAND, number + _HALF_BAND, value, known.std * per_si)
        for number, value, (_, known) in zip(numbers, values, told, strict=True)
    ]
    steps = [each.later + _BETWEEN for each in history.steps if each.quantity is quantity]
    marked = [(index, quantity.name) in history.marks for index, _ in told]
    heading = f"{quantity.heading} [{quantity.unit.symbol}]"
    svg = time_series(
        numbers,
        values,
        np.array(silent),
        levels,
        steps,
        (f"{quantity.heading} of each drive", f"drive, in order of time{_span(history)}"),
        marked=marked,
        least_step=1.0,
    )
    least, small = least_marked(history, quantity), quantity.small_unit
    remark = ""
    if least is not None:
        text = f"{small.number(least)} {small.symbol}"
        remark = (
            f'<p class="soft">From one drive to the next, a change of {text} or more would be marked.</p>'
        )
    return f"<h3>{escape(heading[0].upper() + heading[1:])}</h3>{svg}{remark}"


def _table(history: History) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in _HEADS)
    rows = "\n".join(_row(history, index) for index in range(len(history.drives)))
    return f"<table><thead><tr>{heads}</tr></thead>{rows}</table>"


def _row(history: History, index: int) -> str:
    drive = history.drives[index]
    name = breakable(drive.name)
    link = f'<a href="{escape(drive.report, quote=True)}">{name}</a>' if drive.report else name
    cells = []
    for quantity in QUANTITIES:
        known = drive.known.get(quantity.name)
        text = ""
        if known is not None:
            sign = "+" if quantity.unit == DEGREES else ""
            text = (
                f"{quantity.unit.number(known.value, sign)} &plusmn; {known.std * quantity.unit.per_si:.2g}"
            )
            if (index, quantity.name) in history.marks:
                text = f'<span class="marked">{text}</span>'
        cells.append(number_cell(quantity.heading, text))
    where = f'<td class="name">{link}<br><span class="soft">{escape(drive.said)}</span></td>'
    first = f'<td data-label="drive">{index + 1}</td><td>{_when(history, index)}</td>'
    return f"<tbody><tr>{first}{where}{''.join(cells)}</tr></tbody>"


def _left_out(problems: Sequence[str]) -> str:
    if not problems:
        return ""
    lines = "".join(f"<li>{escape(problem)}</li>" for problem in problems)
    return f"<h2>Left out</h2><ul>{lines}</ul>"


def _when(history: History, index: int) -> str:
    stamp_s = history.drives[index].stamp_s
    if stamp_s is None:
        return "no date"
    return datetime.fromtimestamp(stamp_s, timezone.utc).strftime("%Y-%m-%d %H:%M")


def _span(history: History) -> str:
    """Return the first and the last day, for an axis; "" where the drives have no dates."""
    stamps = [drive.stamp_s for drive in history.drives if drive.stamp_s is not None]
    if len(stamps) < len(history.drives):
        return ""
    days = (
        datetime.fromtimestamp(each, timezone.utc).strftime("%Y-%m-%d") for each in (min(stamps), max(stamps))
    )
    return ", {} to {}".format(*days)
