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

"""SIGKILL while results are written: is the file ever unreadable, or older than what was acknowledged?

A child process writes numbered results over one file as fast as it can, by the function the node uses,
and acknowledges each on a pipe once it is written, as the node answers its caller. It is killed at a random
moment.
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from stereo_selfcal import CalibrationResult, ConfigError, Extrinsics
from stereo_selfcal.files.result_file import load_result, restore, write_result
from stereo_selfcal.synth.scenes import PAPER_RIG

from .options import Options
from .table import Table

# From no write at all to a dozen: with its reading and formatting, one takes 3 ms or more, by the disk.
_LONGEST_LIFE_S = 0.03
_GIVE_UP_S = 60.0
_NUMBER = struct.Struct("<q")
_RESULT = CalibrationResult(
    "numbered", extrinsics=Extrinsics(1.0, 0.05, -0.01), covariance=np.diag([1e-6, 1e-10, 4e-8]), n_frames=1
)
_STEP_M = 1e-6
_TEMPORARY = re.compile(r"\..*\.tmp")


@dataclass(frozen=True, slots=True)
class KillReport:
    """What was found after the kills.

    Attributes:
        kills: Writers killed.
        acknowledged: Results acknowledged by all of them.
        unreadable: Kills after which the file could not be read.
        mixed: Kills after which the file held parts of two results.
        older: Kills after which it held an older result than the last acknowledged one.
        newer: Kills between the moment a result was in place and its acknowledgement: harmless.
        in_writing: Kills that left a temporary file, so came in the middle of a write.
        left_after_restart: Temporary files still there after the next start.
    """

    kills: int
    acknowledged: int
    unreadable: int
    mixed: int
    older: int
    newer: int
    in_writing: int
    left_after_restart: int


def numbered(number: int) -> CalibrationResult:
    """Return a result that has its number in two places of the file, the height and the frames."""
    assert _RESULT.extrinsics is not None
    extrinsics = replace(_RESULT.extrinsics, height_m=1.0 + number * _STEP_M)
    return replace(_RESULT, extrinsics=extrinsics, n_frames=number + 1)


def kill_writers(folder: Path, kills: int, seed: int = 0) -> KillReport:
    """Start and kill writers one after the other, and look at the file after each.

    To be called where no other threads run: writers are forked.

    Args:
        folder: An empty folder.
        kills: How many.
        seed: Of the moments.
    """
    rng = random.Random(seed)
    path = folder / "result.yaml"
    last = 0
    write_result(path, numbered(last), PAPER_RIG, source="kills", seed=0)
    counts = dict.fromkeys(KillReport.__slots__, 0)
    for _ in range(kills):
        acknowledged = _kill_one(path, last, rng.uniform(0.0, _LONGEST_LIFE_S))
        counts["kills"] += 1
        counts["acknowledged"] += acknowledged - last
        counts["in_writing"] += any(_TEMPORARY.fullmatch(entry.name) for entry in folder.iterdir())
        last = acknowledged
        try:
            saved = load_result(path)
        except ConfigError:
            counts["unreadable"] += 1
            continue
        number = saved.n_frames - 1
        counts["mixed"] += saved.extrinsics != numbered(number).extrinsics
        counts["older"] += number < last
        counts["newer"] += number > last
        last = max(last, number)
        restore(path)
        counts["left_after_restart"] += sum(bool(_TEMPORARY.fullmatch(e.name)) for e in folder.iterdir())
    return KillReport(**counts)


def _kill_one(path: Path, last: int, life_s: float) -> int:
    """Let a writer live for a while after its start; return the last number it acknowledged."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        _write_for_ever(path, last, writer)
    os.close(writer)
    with ExitStack() as stack:
        stack.callback(os.close, reader)
        time.sleep(life_s)
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            raise RuntimeError(f"the writer ended by itself: status {status}")
        content = b""
        while block := os.read(reader, 1 << 16):
            content += block
    whole = len(content) // _NUMBER.size * _NUMBER.size
    return _NUMBER.unpack(content[whole - _NUMBER.size : whole])[0] if whole else last


def _write_for_ever(path: Path, last: int, acknowledge: int) -> None:
    """Be the child: write until killed, but not for ever when the parent is gone."""
    with suppress(BaseException):
        end_s = time.monotonic() + _GIVE_UP_S
        while time.monotonic() < end_s:
            last += 1
            write_result(path, numbered(last), PAPER_RIG, source="kills", seed=0, keep_others=True)
            os.write(acknowledge, _NUMBER.pack(last))
    os._exit(1)


def kill_table(options: Options) -> Iterator[Table]:
    """Kills on the disk the benchmarks are on."""
    table = Table(
        "kills",
        f"SIGKILL {options.kills} times while a process writes results",
        [name.replace("_", " ") for name in KillReport.__slots__],
        "A process writes numbered results over one file as fast as it can, by the node's own function, "
        "acknowledges each on a pipe, and is killed after 0 to 30 ms. 'in writing': killed in the middle of "
        "a write (a temporary file was left); 'newer': killed after the file was in place and before the "
        "acknowledgement. 'unreadable', 'mixed' and 'older' are the faults.",
    )
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        report = kill_writers(Path(folder), options.kills)
    table.add(*(str(value) for value in asdict(report).values()))
    yield table


def main(arguments: list[str]) -> int:
    """Print the report of so many kills in a folder as JSON: ``kills FOLDER KILLS SEED``."""
    folder, kills, seed = arguments
    sys.stdout.write(json.dumps(asdict(kill_writers(Path(folder), int(kills), int(seed)))) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
