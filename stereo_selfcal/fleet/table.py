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

"""The table of a fleet: one row a recording, as CSV or as Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..core.errors import OutputError
from ..files.atomic_file import write_atomically
from ..offline.csv_table import harmless
from .outcome import BOOL, COLUMN_KINDS, COLUMNS, FLOAT, INT, BagOutcome

CSV, PARQUET = ".csv", ".parquet"


def check_table(path: Path) -> None:
    """Refuse a table that cannot be written, before any work is done for it.

    Raises:
        OutputError: The kind is unknown, or what writes it is not installed.
    """
    if path.suffix not in (CSV, PARQUET):
        raise OutputError(f"{path}: tables are written as CSV or Parquet; end the name in {CSV} or {PARQUET}")
    if path.suffix == PARQUET and find_spec("pyarrow") is None:
        raise OutputError(
            f"{path}: Parquet is written by pyarrow, which is not installed; "
            f"pip install pyarrow, or end the name in {CSV}"
        )


def write_table(path: Path, outcomes: Sequence[BagOutcome]) -> None:
    """Write the table, in the order given, whole or not at all; numbers with all their digits.

    Raises:
        OutputError: It cannot be written.
    """
    check_table(path)
    content = _parquet(outcomes) if path.suffix == PARQUET else csv_of(outcomes).encode()
    write_atomically(path, content)


def csv_of(outcomes: Sequence[BagOutcome]) -> str:
    """Return the table as comma-separated values with a header; unknown values are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for outcome in outcomes:
        values = outcome.to_mapping()
        writer.writerow([_cell(values[name]) for name in COLUMNS])
    return text.getvalue()


def _cell(value: Any) -> Any:
    """Return the cell of a value: empty for none, 1 and 0 for yes and no, a text that is no formula."""
    return "" if value is None else int(value) if isinstance(value, bool) else harmless(value)


def _parquet(outcomes: Sequence[BagOutcome]) -> bytes:
    pyarrow: Any = import_module("pyarrow")
    parquet: Any = import_module("pyarrow.parquet")
    kinds = {INT: pyarrow.int64(), BOOL: pyarrow.bool_(), FLOAT: pyarrow.float64()}
    # A status is a word.
    schema = pyarrow.schema(
        [(name, kinds.get(kind, pyarrow.string())) for name, kind in COLUMN_KINDS.items()]
    )
    table = pyarrow.Table.from_pylist([outcome.to_mapping() for outcome in outcomes], schema=schema)
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(table, sink)
    content: bytes = sink.getvalue().to_pybytes()
    return content
