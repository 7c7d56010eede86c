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

"""A table that prints as Markdown and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field


class NothingToMeasureError(Exception):
    """What a section measures is not there."""


@dataclass
class Table:
    """Rows of text under a title.

    Attributes:
        name: Name of its CSV file, without the ending.
        title: Heading.
        header: Names of the columns.
        note: What a reader must know to read it: conditions, settings, what is missing.
        rows: The cells.
        shown: Whether it is on the page of its section; its CSV file is written in any case.
    """

    name: str
    title: str
    header: list[str]
    note: str = ""
    rows: list[tuple[str, ...]] = field(default_factory=list)
    shown: bool = True

    def add(self, *cells: str) -> None:
        """Append a row; it has as many cells as the header."""
        if len(cells) != len(self.header):
            raise ValueError(f"{len(cells)} cells for {len(self.header)} columns in {self.title!r}")
        self.rows.append(cells)

    def markdown(self) -> str:
        """Return the table as Markdown."""
        lines = [f"### {self.title}", ""]
        if self.note:
            lines += [self.note, ""]
        lines += [_row(self.header), _row(["---"] * len(self.header))]
        return "\n".join(lines + [_row(row) for row in self.rows]) + "\n"

    def csv(self) -> str:
        """Return header and rows as comma-separated values."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.header, *self.rows])
        return text.getvalue()


def _row(cells: list[str] | tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def number(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent where that is short."""
    return f"{value:.{digits}g}" if 0 < abs(value) < 1e-4 else f"{float(f'{value:.{digits}g}'):g}"


def numbers(values: Iterable[float], digits: int = 3, separator: str = " / ") -> str:
    """Return several numbers in one cell."""
    return separator.join(number(float(value), digits) for value in values)
