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

"""Mutations of what a fleet has left in its folder: is one taken for a result, or the end of the next run?

Most leave the hash in a result file as it was, as a disk does, or an editor; for the others it is made anew,
so that what is read behind it is tried as well.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stereo_selfcal.cli.fleet import _Outcomes
from stereo_selfcal.core.config import CalibratorConfig
from stereo_selfcal.core.errors import SelfcalError
from stereo_selfcal.fleet import store as store_module
from stereo_selfcal.fleet.outcome import BagOutcome
from stereo_selfcal.fleet.scheduling import Done
from stereo_selfcal.fleet.store import Bag, Store
from stereo_selfcal.fleet.work import Calibrated, FleetSettings, calibrate_bag
from stereo_selfcal.synth.bag import write_bag
from stereo_selfcal.synth.scenes import custom_scene

from .options import Options
from .table import Table

_HANGS_S = 60  # no mutation takes a second
_DEEP = 100_000  # levels of nesting: a thousand are the end of Python's stack
_LARGE = 20_000_000  # bytes
_STRANGE: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    10**30,
    -0.0,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "calibrated",
    "../../etc/passwd",
    "\x1b[2J\n=1+1",
    "\udcff",
    "x" * 100_000,
    [],
    [[]],
    {},
    {"a": {}},
)


@dataclass(frozen=True, slots=True)
class StateReport:
    """What was found after the mutations.

    Attributes:
        mutations: How many.
        recomputed: The recording was done again.
        told: The run was ended by a sentence.
        same: Its row was the one it had: what was changed means nothing.
        other: Its row was another one, of a file with a hash that fits.
        wrong: Its row was another one, of a file with a hash that does not fit.
        tracebacks: Something unforeseen was raised.
        hangs: It did not end in a minute.
        slowest_s: Longest time of one [s].
    """

    mutations: int
    recomputed: int
    told: int
    same: int
    other: int
    wrong: int
    tracebacks: int
    hangs: int
    slowest_s: float


class _HangsError(BaseException):
    """It takes too long; nothing catches this."""


def mutate_states(folder: Path, mutations: int, seed: int = 0) -> StateReport:
    """Leave a state, mutate it, and go on from it as the command does, again and again.

    Args:
        folder: An empty folder.
        mutations: How many.
        seed: Of them.
    """
    rng = random.Random(seed)
    bag, done = _a_recording(folder)
    counts = dict.fromkeys(StateReport.__slots__[:-1], 0)
    slowest_s = 0.0
    before = signal.signal(signal.SIGALRM, _hang)
    try:
        for index in range(mutations):
            output = folder / f"out{index}"
            good = _Outcomes([bag], Store(output, reports=True), None)
            row = good.take(done)
            good.write()
            resealed = _mutate(output, rng)
            start_s = time.monotonic()
            signal.alarm(_HANGS_S)
            try:
                counts[_go_on(output, bag, done, row, resealed)] += 1
            except (SelfcalError, OSError):
                counts["told"] += 1
            except _HangsError:
                counts["hangs"] += 1
            except Exception as error:  # noqa: BLE001 (to be counted)
                counts["tracebacks"] += 1
                sys.stderr.write(f"mutation {index} of seed {seed}: {type(error).__name__}: {error!s:.200}\n")
            signal.alarm(0)
            slowest_s = max(slowest_s, time.monotonic() - start_s)
            counts["mutations"] += 1
            with suppress(OSError):
                output.chmod(0o700)
            shutil.rmtree(output, ignore_errors=True)
    finally:
        signal.signal(signal.SIGALRM, before)
    return StateReport(**counts, slowest_s=round(slowest_s, 1))


def _hang(*_: object) -> None:
    raise _HangsError


def _a_recording(folder: Path) -> tuple[Bag, Done]:
    settings = FleetSettings(CalibratorConfig())
    path = folder / "road"
    write_bag(path, custom_scene(name="road", n_frames=2))
    calibrated = calibrate_bag(str(path), settings)
    if not isinstance(calibrated, Calibrated):
        raise RuntimeError(f"the recording is of no use: {calibrated}")
    bag = Bag.of(path, settings)
    outcome = BagOutcome.from_replay(bag.name, calibrated.replay, calibrated.topics)
    return bag, Done(bag, outcome, calibrated, b"<p>report")


def _go_on(output: Path, bag: Bag, done: Done, row: BagOutcome, resealed: bool) -> str:
    """Do what the command does with a folder, and return what became of the recording."""
    outcomes = _Outcomes([bag], Store(output, reports=True), None)
    waiting = outcomes.resume()
    found = "recomputed"
    if not waiting:
        taken = outcomes._rows[bag.path]
        found = "same" if taken == row else "other" if resealed else "wrong"
    for _ in waiting:
        outcomes.take(done)
    outcomes.write()
    outcomes.summary()
    return found


def _mutate(output: Path, rng: random.Random) -> bool:
    """Mutate one file of a folder; return whether its hash was made anew."""
    (result,) = (output / "results").glob("*.json")
    kind = rng.random()
    if kind < 0.6:
        content = json.loads(result.read_text(encoding="utf-8"))
        for _ in range(rng.randint(1, 3)):
            _change_value(content, rng)
        resealed = rng.random() < 0.5
        if resealed:
            with suppress(KeyError, TypeError):
                content["check"] = store_module._check(content)
        result.write_text(json.dumps(content), encoding="ascii")
        return resealed
    if kind < 0.85:
        result.write_bytes(_change_bytes(result.read_bytes(), rng))
        return False
    report = next((output / "reports").iterdir())
    _change_file(rng.choice((result, result, report, output / "table.csv", output / "index.html")), rng)
    return False


def _change_value(content: Any, rng: random.Random) -> None:
    """Change a value of a tree, at any depth."""
    places: list[tuple[Any, Any]] = []
    row = content.get("outcome")
    # The row is what is read; the rest is many times as much.
    trees = [row] if isinstance(row, dict) and rng.random() < 0.7 else [content]
    while trees:
        tree = trees.pop()
        keys: Any = tree if isinstance(tree, dict) else range(len(tree))
        places += [(tree, key) for key in keys]
        trees += [tree[key] for key in keys if isinstance(tree[key], dict | list)]
    if not places:
        return
    tree, key = rng.choice(places)
    act = rng.choice(("replace", "replace", "replace", "delete", "add", "number", "text"))
    value = tree[key]
    if act == "delete":
        del tree[key]
    elif act == "add" and isinstance(tree, dict):
        tree[rng.choice(("more", "", "key", "outcome", "\udcff"))] = rng.choice(_STRANGE)
    elif act == "number" and isinstance(value, float):
        tree[key] = rng.choice((-value, value * 1.001, value * 1e300, int(value), str(value)))
    elif act == "text" and isinstance(value, str):
        tree[key] = rng.choice((value.upper(), value + "\n", value[1:], [value], {value: value}))
    else:
        tree[key] = rng.choice(_STRANGE)


def _change_bytes(content: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(content))
    changes: list[Callable[[], bytes]] = [
        lambda: content[:place],
        lambda: content[place:],
        lambda: content[:place] + bytes([content[place] ^ (1 << rng.randrange(8))]) + content[place + 1 :],
        lambda: content[:place] + bytes(4096) + content[place + 4096 :],
        lambda: content[:place] + rng.randbytes(64) + content[place:],
        lambda: b"\xef\xbb\xbf" + content,
        lambda: content + content,
        lambda: b"",
        lambda: b"[" * _DEEP,
        lambda: b'{"key":' * _DEEP,
        lambda: b'{"outcome": ' + b"[" * _DEEP + b"]" * _DEEP + b"}",
        lambda: b"9" * _LARGE,
        lambda: b" " * _LARGE + content,
        lambda: rng.choice((b"null", b"1", b'"x"', b"[]", b"{}", b"NaN", b"\xff\xfe")),
    ]
    return rng.choice(changes)()


def _change_file(path: Path, rng: random.Random) -> None:
    """Put something else in the place of a file."""
    path.unlink()
    act = rng.choice(("nothing", "folder", "pipe", "circle", "device", "nowhere"))
    if act == "folder":
        path.mkdir()
    elif act == "pipe":
        os.mkfifo(path)
    elif act != "nothing":
        path.symlink_to({"circle": path.name, "device": "/dev/zero", "nowhere": "nowhere/at/all"}[act])


def state_table(options: Options) -> Iterator[Table]:
    """Mutations of the folder of one recording."""
    table = Table(
        "fleet_state",
        f"{options.states} mutations of the folder of a fleet",
        [name.removesuffix("_s").replace("_", " ") for name in StateReport.__slots__],
        "Values of a result file changed at any depth, in half of these cases with a hash that fits "
        "('other': the row that is then there); its bytes cut, flipped, overwritten, doubled, nested 100 000 "
        "deep, 20 MB long; files replaced by folders, pipes, devices and links in circles. Then the same "
        "command goes on. 'told': it ends with a sentence, as a folder or a pipe is where a file is to be. "
        "'wrong', 'tracebacks' and 'hangs' are the faults. 'slowest' in seconds.",
    )
    with tempfile.TemporaryDirectory(prefix="fleet_state.") as folder:
        report = mutate_states(Path(folder), options.states)
    table.add(*(str(value) for value in asdict(report).values()))
    yield table


def main(arguments: list[str]) -> int:
    """Print the report of so many mutations in a folder as JSON: ``fleet_state FOLDER MUTATIONS SEED``."""
    folder, mutations, seed = arguments
    sys.stdout.write(json.dumps(asdict(mutate_states(Path(folder), int(mutations), int(seed)))) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
