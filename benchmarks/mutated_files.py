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

"""Result, parameter and rig files, mutated by their structure: each is read, or refused in one sentence.

A document is changed where it has meaning (values, keys, sections, names of nodes) and written down, and the
text is changed where YAML and JSON have meaning (tags, aliases, documents, indents, encodings). The functions
that read are called themselves: no net of a command is around them.
"""

from __future__ import annotations

import copy
import json
import random
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stereo_selfcal import CalibrationResult, CalibratorConfig, Extrinsics, SelfcalError, StereoRig
from stereo_selfcal.core.drive.targets import USUAL_TARGETS
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.mount import MountEvidence
from stereo_selfcal.core.geometry.travel import RightDelay
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm
from stereo_selfcal.files.parameter_file import load_calibrator_config, load_frames
from stereo_selfcal.files.result_file import format_result, load_result, restore
from stereo_selfcal.files.rig_file import read_rig_file
from stereo_selfcal.files.saved_result import SCHEMA, check_fits
from stereo_selfcal.synth.scenes import PAPER_RIG

from .options import Options
from .table import Table

# Far beyond the second that PyYAML takes for the largest file that is read at all.
_HANG_S = 20.0
_LONGEST_MESSAGE = 1000  # letters: one sentence, with a path and the names of all settings
_VALUES: tuple[Any, ...] = (
    *(float("nan"), float("inf"), -float("inf"), -0.0, 0, 0.0, 1, -1, 1e-320, 1e308, -1e308, 10**18, 2**63),
    *(-(2**63), 2**64, 10**400, True, False, None, [], [[]], {}, [1.0], {"a": 1}, [None], list(range(9))),
    *(
        "",
        " ",
        "nan",
        "1e3",
        "1e-05",
        "0x10",
        "1_000",
        "12:30",
        "yes",
        "\x1b[2J",
        "a\nb",
        "\u202e",
        "\ud800",
        "\0",
    ),
    *("é" * 2000, "9" * 5000, date(2026, 11, 30), b"\xff\x00", {1: 2}, {"": {}}, {None: None}, {True: 1}),
    set("ab"),
)
_KEYS = ("", " ", "rig", "Width", "width ", "fx\n", "ros__parameters", "seed", "search.height_max_m", "<<")
_NODES = ("/*", "/**", "*", "stereo_selfcal", "/a/stereo_selfcal", "/**/stereo_selfcal", "/b/**", "other")
_TAGS = (
    "!!python/object:os.system",
    *("!!binary", "!!float", "!!int", "!!bool", "!!timestamp", "!!set", "!x"),
)
_SNIPPETS = (
    *(
        "---\n",
        "...\n",
        "%YAML 1.1\n",
        "%TAG ! x\n",
        "&a ",
        "*a",
        "<<: ",
        "? ",
        "- ",
        "\t",
        "\r",
        "\0",
        "{",
        "}",
    ),
    *("[", "]", "'", '"', "|\n", ">\n", "#", ": ", "!!", "\ufeff", "\u2028", "\x85", "@", "`", "&a [*a]"),
    *("[" * 3000, "{a: " * 3000),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of mutations of one kind of file.

    Attributes:
        mutations: How many.
        read: Those in which nothing was amiss, or nothing that is looked at.
        refused: Those that were refused in one line that names the file.
        unclear: Those that were refused in several lines, without the file, or at great length.
        tracebacks: What else was raised, each as its last line with the place.
        hangs: Those that took longer than 20 s.
        longest_s: The longest time of one [s].
    """

    mutations: int
    read: int
    refused: int
    unclear: tuple[str, ...]
    tracebacks: tuple[str, ...]
    hangs: int
    longest_s: float


class _HangError(Exception):
    """It takes too long."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of file.

    Attributes:
        suffix: Of its name.
        document: What a good one holds.
        read: Reads one, and uses what is in it.
    """

    suffix: str
    document: Any
    read: Callable[[Path], object]


def _use_result(path: Path) -> None:
    saved = load_result(path)
    result = saved.as_result()
    if abs(saved.stamp_ns) > 2**31 * 10**9:
        raise AssertionError(f"a stamp of {saved.stamp_ns} ns")
    format_result(result, saved.rig, "again", 0)
    check_fits(saved.rig, saved.rig)


def _restore(path: Path) -> None:
    restored = restore(path)
    if restored.saved is None:
        raise SelfcalError(restored.problem)


def _use_parameters(path: Path) -> None:
    config = load_calibrator_config(path)
    if config != CalibratorConfig.from_mapping({name: value for name, value, _ in config.settings()}):
        raise AssertionError("settings that are not those of a mapping of them")
    frames = load_frames(path)
    for frame in (frames.vehicle_frame, frames.road_frame, frames.camera_frame):
        frame.encode()
    if not max(abs(frames.place.x_m), abs(frames.place.y_m)) <= 100.0:
        raise AssertionError(f"a place that no vehicle has: {frames.place}")


def _use_rig(path: Path) -> None:
    rig = read_rig_file(path)
    if rig != StereoRig.from_mapping(rig.to_mapping()):
        raise AssertionError("a rig that is not that of its own mapping")


def _good_result() -> Any:
    covariance, motion = np.diag([1e-6, 1e-10, 4e-8]), np.diag([9e-7, 8e-11, 3e-8])
    result = CalibrationResult(
        "",
        extrinsics=Extrinsics(1.3, 0.05, -0.01),
        covariance=covariance,
        n_frames=3,
        uncertainty=(UncertaintyTerm("noise", covariance - motion), UncertaintyTerm("motion", motion)),
        alignment=Alignment(1e-4, -2e-4, 2e-3, np.diag([4e-10, 9e-10, 3e-8])),
        mount=MountEvidence(
            30.0, 1, 2, False, Extrinsics(0.005, 0.003, 0.004), np.full(3, 1.5), np.full(3, 9.0)
        ),
        delay=RightDelay(-4e-4, 1e-5, np.diag([4e-8, 2.5e-5]), 3, (2.5, 14.0)),
    )
    targets = USUAL_TARGETS
    return yaml.safe_load(format_result(result, PAPER_RIG, "a drive", 7, targets))


def _good_result_of_schema_1() -> Any:
    pose = Extrinsics(1.3, 0.05, -0.01)
    result = CalibrationResult("", extrinsics=pose, covariance=np.diag([1e-6, 1e-10, 4e-8]), n_frames=3)
    text = format_result(result, PAPER_RIG, "a drive", 7)
    return yaml.safe_load(text.replace(f"schema: {SCHEMA}", "schema: 1"))


def _good_parameters() -> Any:
    settings: dict[str, Any] = {
        "timeout_s": 5.0,
        "road_frame": "road",
        "camera_frame": "stereo_camera",
        "mount": {"x_m": 1.7},
    }
    for name, value, _ in CalibratorConfig().settings():
        section, _, rest = name.partition(".")
        if rest:
            settings.setdefault(section, {})[rest] = value
        else:
            settings[name] = value
    return {"/**": {"ros__parameters": settings}, "other": {"ros__parameters": {"seed": 3}}}


KINDS = {
    "result files": Kind(".yaml", _good_result(), _use_result),
    "result files of schema 1": Kind(".yaml", _good_result_of_schema_1(), _use_result),
    "result files at the start of a node": Kind(".yaml", _good_result(), _restore),
    "parameter files": Kind(".yaml", _good_parameters(), _use_parameters),
    "rig files (YAML)": Kind(".yaml", PAPER_RIG.to_mapping(), _use_rig),
    "rig files (JSON)": Kind(".json", PAPER_RIG.to_mapping(), _use_rig),
}


def mutate(kind: Kind, rng: random.Random) -> bytes:
    """Return the content of a mutated file; the same generator gives the same bytes."""
    document = copy.deepcopy(kind.document)
    for _ in range(rng.choice((0, 1, 1, 1, 2, 3))):
        document = _mutated_document(document, rng)
    content = _written(document, kind.suffix, rng)
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        content = _mutated_text(content, rng)
    return content


def _mutated_document(document: Any, rng: random.Random) -> Any:
    places = list(_places(document))
    if not places:
        return rng.choice(_VALUES)
    holder, key = rng.choice(places)
    deed = rng.randrange(9)
    if deed < 3:
        holder[key] = copy.deepcopy(rng.choice(_VALUES))
    elif deed == 3:
        del holder[key]
    elif deed == 4 and isinstance(holder, dict):
        holder[rng.choice((*_KEYS, *_NODES, str(key).upper(), f"{key}.x"))] = holder.pop(key)
    elif deed == 5 and isinstance(holder, dict):
        holder[rng.choice((*_KEYS, *_NODES))] = copy.deepcopy(holder[key])
    elif deed == 6:
        other, place = rng.choice(places)
        holder[key], other[place] = copy.deepcopy(other[place]), copy.deepcopy(holder[key])
    elif deed == 7:
        holder[key] = [holder[key]] if rng.random() < 0.5 else {"value": holder[key]}
    elif isinstance(document, dict):
        return {rng.choice(_NODES): document, **(document if rng.random() < 0.5 else {})}
    return document


def _places(document: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every container of a document with each of its keys or indices."""
    if not isinstance(document, dict | list):
        return
    keys = list(document) if isinstance(document, dict) else range(len(document))
    for key in keys:
        yield document, key
        yield from _places(document[key])


def _written(document: Any, suffix: str, rng: random.Random) -> bytes:
    if suffix == ".json":
        return json.dumps(_for_json(document), ensure_ascii=rng.random() < 0.5).encode("utf-8", "replace")
    flow = rng.choice((None, False, True))
    try:
        text = yaml.safe_dump(
            document, sort_keys=False, default_flow_style=flow, allow_unicode=rng.random() < 0.5
        )
    except yaml.YAMLError:
        text = repr(document)
    return text.encode("utf-8", "replace")


def _for_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(name): _for_json(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_for_json(each) for each in value]
    return value if isinstance(value, str | int | float | None) else str(value)


def _mutated_text(content: bytes, rng: random.Random) -> bytes:
    return rng.choice(
        (_with_snippet, _with_snippet, _with_tags, _in_part, _of_other_lines, _flipped, _encoded)
    )(content, rng)


def _with_snippet(content: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(content) + 1)
    return content[:place] + rng.choice(_SNIPPETS).encode("utf-8", "replace") + content[place:]


def _with_tags(content: bytes, rng: random.Random) -> bytes:
    return content.replace(b": ", f": {rng.choice(_TAGS)} ".encode(), rng.randrange(1, 4))


def _in_part(content: bytes, rng: random.Random) -> bytes:
    """Return a part of it, or it several times, as documents of its own or not."""
    if rng.random() < 0.5:
        return content[: rng.randrange(len(content) + 1)]
    return rng.choice((b"---\n", b"\n", b"")).join([content] * rng.choice((2, 2, 50, 500)))


def _of_other_lines(content: bytes, rng: random.Random) -> bytes:
    """Return it with a line twice, without a line, or with a line further in."""
    lines = content.splitlines(keepends=True) or [b""]
    line = rng.randrange(len(lines))
    lines[line] = rng.choice((lines[line] * 2, b"", b" " * rng.randrange(1, 5) + lines[line]))
    return b"".join(lines)


def _flipped(content: bytes, rng: random.Random) -> bytes:
    flipped = bytearray(content or b"\0")
    for _ in range(rng.randrange(1, 9)):
        flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    return bytes(flipped)


def _encoded(content: bytes, rng: random.Random) -> bytes:
    return content.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-8-sig", "utf-32")))


_TEXT_MUTATIONS = (
    *(_with_snippet, _with_snippet, _with_tags),
    *(_in_part, _of_other_lines, _flipped, _encoded),
)


def mutate_files(name: str, mutations: int, seed: int = 0) -> Outcome:
    """Read mutated files of one kind, and count what becomes of them.

    Args:
        name: One of :data:`KINDS`.
        mutations: How many.
        seed: Of the mutations.
    """
    kind, rng = KINDS[name], random.Random(f"{name} {seed}")
    read = refused = hangs = 0
    longest_s = 0.0
    unclear, tracebacks = [], []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(mutations):
            path = Path(folder, f"mutated{number}{kind.suffix}")
            path.write_bytes(mutate(kind, rng))
            start_s = time.perf_counter()
            try:
                with _no_longer_than(_HANG_S):
                    kind.read(path)
                read += 1
            except _HangError:
                hangs += 1
            except SelfcalError as error:
                text = str(error)
                clear = text.isprintable() and path.stem in text and len(text) <= _LONGEST_MESSAGE
                refused += clear
                if not clear:
                    unclear.append(text)
            except Exception as error:  # noqa: BLE001 - these are what is looked for
                place = traceback.extract_tb(error.__traceback__)[-1]
                tracebacks.append(f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})")
            longest_s = max(longest_s, time.perf_counter() - start_s)
            for left in Path(folder).iterdir():
                left.unlink()
    return Outcome(mutations, read, refused, tuple(unclear), tuple(tracebacks), hangs, longest_s)


@contextmanager
def _no_longer_than(seconds: float) -> Iterator[None]:
    def end(_number: int, _frame: object) -> None:
        raise _HangError

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def mutated_files_table(options: Options) -> Iterator[Table]:
    """Mutations of every kind of file that is read besides recordings."""
    table = Table(
        "mutated_files",
        f"{options.mutations} mutations of each kind of file",
        ["files", "read", "refused", "unclear", "tracebacks", "hangs", "longest [ms]"],
        "Values, keys, sections and names of nodes are exchanged, and the text is changed where YAML and "
        "JSON have meaning: tags, aliases, documents, indents, encodings. 'read': nothing was amiss, or "
        "nothing that is looked at; 'refused': in one line that names the file. 'unclear' (several lines, no "
        "name, very long), 'tracebacks' and 'hangs' (20 s) are the faults.",
    )
    for name in KINDS:
        found = mutate_files(name, options.mutations)
        counts = (found.read, found.refused, len(found.unclear), len(found.tracebacks), found.hangs)
        table.add(name, *map(str, counts), f"{found.longest_s * 1e3:.0f}")
    yield table
