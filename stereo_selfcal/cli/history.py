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

"""``history``: compare the results of one camera from several drives, and mark what has changed."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .. import __version__
from ..core.errors import printable
from ..files.atomic_file import write_atomically
from ..fleet.history import FALSE_MARKS, History, history_of
from ..fleet.history_input import of_one_camera, read_sources
from ..fleet.history_page import change_sentence, history_page
from .console import EXIT_NOT_ACCEPTED, EXIT_OK, OTHER_STATUSES, Parser, UsageError, run
from .outputs import File, check_outputs

_DESCRIPTION = """\
Compare the results of one camera from several drives, and mark what has changed significantly.

RESULT is a folder that 'fleet' has written, or a result file of the node or of 'replay --output'.
"""
_EPILOG = f"""\
exit status: 0 no significant change; 1 something has changed; 2 bad usage, or fewer than two
calibrations of one camera; {OTHER_STATUSES}
"""
_DEFAULT_OUTPUT = Path("history.html")
_FEWEST = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status of docs/fleet.md."""
    return run("history", _history, argv)


def _history(argv: list[str]) -> int:
    arguments = _parser().parse_args(argv)
    output: Path = arguments.output
    check_outputs(
        [File("--output", output)], [File("the result", path) for path in arguments.results if path.is_file()]
    )
    sources, unusable = read_sources(arguments.results, output.absolute().parent)
    drives, others = of_one_camera(sources)
    problems = [*unusable, *others]
    for problem in problems:
        sys.stderr.write(f"history: left out: {printable(problem)}\n")
    n_known = sum(bool(drive.known) for drive in drives)
    if n_known < _FEWEST:
        raise UsageError(
            f"calibrations of one camera: {n_known}, at least {_FEWEST} are needed for a comparison; "
            "name more results"
        )
    history = history_of(drives)
    about = f"Made by stereo_selfcal {__version__}."
    write_atomically(output, history_page(history, problems, about).encode())
    sys.stdout.write(_as_json(history) if arguments.json else _as_text(history, output))
    return EXIT_NOT_ACCEPTED if history.changes else EXIT_OK


def _as_text(history: History, output: Path) -> str:
    """Return what people read."""
    n_known = sum(bool(drive.known) for drive in history.drives)
    text = f"{len(history.drives)} drives, {n_known} with a calibration; "
    text += f"{len(history.comparisons)} comparisons\n"
    lines = [change_sentence(history, each) for each in history.changes] or ["No significant change."]
    return text + "".join(f"{printable(line)}\n" for line in lines) + f"{printable(str(output))}\n"


def _as_json(history: History) -> str:
    """Return one JSON object in one line: SI units, radians."""
    drives: list[dict[str, Any]] = [
        {
            "name": drive.name,
            "stamp_s": drive.stamp_s,
            "said": drive.said,
            "values": {name: known.value for name, known in drive.known.items()},
            "std": {name: known.std for name, known in drive.known.items()},
        }
        for drive in history.drives
    ]
    comparisons = [
        {
            "quantity": each.quantity.name,
            "drive": each.later,
            "against": each.earlier,
            "difference": each.difference,
            "std": each.std,
            "p_value": each.p_value,
            "significant": each.significant,
        }
        for each in history.comparisons
    ]
    content = {"false_marks": FALSE_MARKS, "drives": drives, "comparisons": comparisons}
    content["changes"] = [change_sentence(history, each) for each in history.changes]
    return json.dumps(content, allow_nan=False) + "\n"


def _parser() -> Parser:
    parser = Parser(
        prog="history",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add(
        "results",
        metavar="RESULT",
        nargs="+",
        type=Path,
        help="a folder that fleet has written, or a result file",
    )
    add(
        "--output",
        metavar="FILE",
        type=Path,
        default=_DEFAULT_OUTPUT,
        help="the page (default: %(default)s)",
    )
    add("--json", action="store_true", help="print one JSON object instead of lines")
    return parser
