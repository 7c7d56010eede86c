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

"""Judge a part of a series: ``python -m benchmarks.travel_drives --seed 1 --count 10``."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import cv2

from ..revision import estimator_revision
from .judged import EACH, read, run, tables
from .kinds import plans


def main(arguments: list[str]) -> int:
    """Judge drives, add each to a file at once, and print what the file says."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.travel_drives", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="seed of the series")
    parser.add_argument("--first", type=int, default=0, help="number of the first drive")
    parser.add_argument("--count", type=int, default=0, help="how many drives; 0: only print the file")
    parser.add_argument("--full", action="store_true", help="images of the rigs' own size, not small ones")
    parser.add_argument("--budget-s", type=float, default=math.inf, help="begin no drive after so long")
    parser.add_argument("--each", type=Path, default=EACH, help="file of the single drives")
    parser.add_argument("--revision", help="what is judged; the commit of the estimator by default")
    chosen = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    revision = chosen.revision or estimator_revision()
    wanted = plans(chosen.seed, chosen.first, chosen.count, small=not chosen.full)
    run(wanted, chosen.each, revision, say, chosen.budget_s)
    for table in tables(read(chosen.each)):
        if table.shown:
            say(f"\n{table.markdown()}")
    return 0


def say(text: str) -> None:
    """Print a text at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
