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

"""Recordings, mutated by their structure: each is read, in part or as a whole, or refused in one sentence.

What is changed has a meaning in its format: lengths, kinds, offsets and counts of records, types and names of
topics, message definitions, sizes of chunks, values of metadata.yaml, pages and rows of SQLite, and in
messages the lengths of strings and arrays. The functions that read are called themselves: no net of a command
is around them. Other kinds of files: ``mutated_files``.
"""

from __future__ import annotations

import json
import random
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from stereo_selfcal import SelfcalError, StereoRig
from stereo_selfcal.offline.opening import open_source

from .options import Options
from .table import Table

KINDS = (
    *("mcap", "mcap-chunks", "mcap-messages", "mcap-file", "mcap-loose"),
    *("sqlite3", "sqlite3-messages", "ros1", "ros1-lz4", "ros1-bz2"),
)
_RIG = StereoRig(80, 64, 50.0, 50.0, 39.5, 31.5, 0.15)
_N_FRAMES = 3
_HANG_S = 20.0
_BATCH = 50
_LONGEST_MESSAGE = 2000  # letters: one sentence, with a path or two and the names of all topics
_NUMBERS = (0, 1, 2, 3, 7, 8, 22, 40, 255, 256, 2**15, 2**16 - 1, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
_LONG_NUMBERS = (*_NUMBERS, 2**32, 2**33, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
_VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 10**6, 2**31, 2**63 - 1, 10**30, -(10**30), 0.5, float("nan"), float("inf")),
    *(
        "",
        "x",
        "\0",
        "a\nb",
        "\x1b[2J",
        "é" * 3000,
        "../x",
        "/dev/zero",
        "null",
        "2026-11-30",
        "- [history: 3",
    ),
    *([], [None], [[]], ["x"], [1, 2], {}, {"a": 1}, {"nanoseconds": "x"}, {"name": []}),
)
_SQL_VALUES = (
    "NULL",
    "-1",
    "0",
    "1.5",
    "9223372036854775807",
    "'x'",
    "''",
    "zeroblob(3)",
    "zeroblob(900000)",
    "rowid",
)
_DEFINITIONS = (
    *(
        (b"uint32 height", b"uint16 height"),
        (b"uint32 width", b"string width"),
        (b"uint8[] data", b"int64[] data"),
    ),
    *(
        (b"string encoding", b"string encodinG"),
        (b"float64[12] p", b"float64[11] p"),
        (b"float64[9] k", b"float64[8] k"),
    ),
    *((b"sensor_msgs/msg/Image", b"sensor_msgs/msg/Imagf"), (b"std_msgs/msg/Header", b"std_msgs/msg/Heaper")),
    *(
        (b"ros2msg", b"ros2idl"),
        (b"cdr", b"xml"),
        (b"image_rect", b"image_recu"),
        (b"uint32", b"wint32"),
        (b"zstd", b"lz4\0"),
    ),
)


@dataclass(slots=True)
class MutationCounts:
    """What became of mutations.

    Attributes:
        mutations: How many.
        read: Read as a whole.
        in_part: Read to a damage, or with frames or images lost.
        refused: Refused with a reason.
        tracebacks: Ended in an exception that is no refusal, or in a refusal of several lines.
        hangs: Did not end in time.
        longest_s: The longest of all [s].
        peak_mb: Peak memory of the process that read them [MB].
        faults: The first of what went wrong.
    """

    mutations: int = 0
    read: int = 0
    in_part: int = 0
    refused: int = 0
    tracebacks: int = 0
    hangs: int = 0
    longest_s: float = 0.0
    peak_mb: float = 0.0
    faults: tuple[str, ...] = ()


def make_recording(folder: Path, kind: str) -> Path:
    """Write a small good recording and return what to open.

    Args:
        folder: Where; it exists.
        kind: One of :data:`KINDS`.
    """
    ros1 = kind.startswith("ros1")
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    path = folder / ("bag.bag" if ros1 else "bag")
    writer: Any = Writer1(path) if ros1 else _writer(path, kind)
    if ros1 and kind != "ros1":
        writer.set_compression(Writer1.CompressionFormat[kind[5:].upper()])
    packed = kind in ("mcap-chunks", "sqlite3")
    with writer:
        for topic, msgtype, stamp_ns, message in _messages(types, ros1, packed):
            known = {c.topic: c for c in writer.connections}
            connection = known.get(topic) or writer.add_connection(topic, msgtype, typestore=types)
            data = (types.serialize_ros1 if ros1 else types.serialize_cdr)(message, msgtype)
            writer.write(connection, stamp_ns, data)
    if kind == "mcap-loose":  # no summary and no metadata, as a recorder without chunks leaves it
        (path / "metadata.yaml").unlink()
        file = path / "bag.mcap"
        content = bytearray(file.read_bytes())
        content[-28:-12] = bytes(16)
        file.write_bytes(content)
    return path


def _writer(path: Path, kind: str) -> Writer2:
    storage, _, mode = kind.partition("-")
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer2(path, version=9, storage_plugin=plugin)
    modes = {
        "chunks": CompressionMode.STORAGE,
        "messages": CompressionMode.MESSAGE,
        "file": CompressionMode.FILE,
    }
    if mode in modes:
        writer.set_compression(modes[mode], CompressionFormat.ZSTD)
    return writer


def _messages(types: Any, ros1: bool, packed: bool) -> Iterator[tuple[str, str, int, Any]]:
    rig, make = _RIG, types.types
    for index in range(_N_FRAMES):
        stamp = make["builtin_interfaces/msg/Time"](sec=100, nanosec=index * 100_000_000)
        for side in ("left", "right"):
            seq = {"seq": index} if ros1 else {}
            header = make["std_msgs/msg/Header"](stamp=stamp, frame_id=side, **seq)
            shift = -rig.fx * rig.baseline_m if side == "right" else 0.0
            matrices = {
                "d": np.zeros(5),
                "k": np.array([rig.fx, 0, rig.cx, 0, rig.fy, rig.cy, 0, 0, 1.0]),
                "r": np.eye(3).reshape(-1),
                "p": np.array([rig.fx, 0, rig.cx, shift, 0, rig.fy, rig.cy, 0, 0, 0, 1.0, 0]),
            }
            roi = make["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            info = make["sensor_msgs/msg/CameraInfo"](
                header=header, height=rig.height, width=rig.width, distortion_model="plumb_bob",
                binning_x=0, binning_y=0, roi=roi,
                **{(name.upper() if ros1 else name): value for name, value in matrices.items()},
            )  # fmt: skip
            pixels = np.tile(np.arange(rig.width, dtype=np.uint8) + 40 * index, (rig.height, 1))
            stamp_ns = 100_000_000_000 + index * 100_000_000
            yield f"/{side}/camera_info", "sensor_msgs/msg/CameraInfo", stamp_ns, info
            if packed:
                data = cv2.imencode(".png", pixels)[1].reshape(-1)
                image = make["sensor_msgs/msg/CompressedImage"](header=header, format="png", data=data)
                yield f"/{side}/image_rect/compressed", "sensor_msgs/msg/CompressedImage", stamp_ns, image
            else:
                image = make["sensor_msgs/msg/Image"](
                    header=header, height=rig.height, width=rig.width, encoding="mono8", is_bigendian=0,
                    step=rig.width, data=pixels.reshape(-1),
                )  # fmt: skip
                yield f"/{side}/image_rect", "sensor_msgs/msg/Image", stamp_ns, image


# Mutations: each gets the content of a storage file and returns another one


def _mcap_records(content: bytes) -> list[tuple[int, int, int]]:
    """Return kind, start and end of the records of an MCAP file, their heads included."""
    records, position = [], 8
    while position + 9 <= len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, position)
        records.append((kind, position, position + 9 + length))
        position += 9 + length
    return records


def _mcap_length(rng: random.Random, content: bytes) -> bytes:
    _, start, end = rng.choice(_mcap_records(content))
    length = rng.choice((*_LONG_NUMBERS, end - start - 8, end - start - 10))
    return content[: start + 1] + struct.pack("<Q", length) + content[start + 9 :]


def _mcap_kind(rng: random.Random, content: bytes) -> bytes:
    _, start, _ = rng.choice(_mcap_records(content))
    return content[:start] + bytes([rng.randrange(256)]) + content[start + 1 :]


def _mcap_order(rng: random.Random, content: bytes) -> bytes:
    """Records are left out, doubled or exchanged."""
    parts = [content[start:end] for _, start, end in _mcap_records(content)]
    for _ in range(rng.choice((1, 1, 3))):
        first, second = rng.randrange(len(parts)), rng.randrange(len(parts))
        change = rng.randrange(3)
        if change == 0:
            parts[first] = b""
        elif change == 1:
            parts.insert(second, parts[first] * rng.choice((1, 2, 50)))
        else:
            parts[first], parts[second] = parts[second], parts[first]
    return content[:8] + b"".join(parts) + content[-8:]


def _mcap_field(rng: random.Random, content: bytes) -> bytes:
    """A number within a record that describes something is another one."""
    described = [record for record in _mcap_records(content) if record[0] not in (5, 15)]
    _, start, end = rng.choice(described)
    return _number_at(rng, content, start + 9, min(end, start + 9 + 80))


def _ros1_header(rng: random.Random, content: bytes) -> bytes:
    """A value, or a length, of the header of a record is another one."""
    names = (b"op=", b"conn=", b"size=", b"ver=", b"count=", b"chunk_pos=", b"index_pos=", b"conn_count=")
    names += (
        b"chunk_count=",
        b"start_time=",
        b"end_time=",
        b"time=",
        b"compression=",
        b"topic=",
        b"type=",
        b"md5sum=",
    )
    places = [at for name in names for at in _places(content, name)]
    at = rng.choice(places)
    equal = content.index(b"=", at) + 1
    if rng.random() < 0.4:
        return _number_at(rng, content, max(0, at - 8), at)
    return _number_at(rng, content, equal, equal + 8)


def _places(content: bytes, name: bytes) -> list[int]:
    found, at = [], content.find(name)
    while at >= 0:
        found.append(at)
        at = content.find(name, at + 1)
    return found


def _number_at(rng: random.Random, content: bytes, start: int, end: int) -> bytes:
    form, values = rng.choice((("<H", _NUMBERS), ("<I", _NUMBERS), ("<Q", _LONG_NUMBERS)))
    size = struct.calcsize(form)
    position = rng.randrange(start, max(start + 1, end - size + 1))
    value = rng.choice(values) % 2 ** (8 * size)
    return content[:position] + struct.pack(form, value) + content[position + size :]


def _anywhere(rng: random.Random, content: bytes) -> bytes:
    """A number anywhere: in a message, the length of a string or of an array."""
    return _number_at(rng, content, 0, len(content))


def _in_message(rng: random.Random, content: bytes) -> bytes:
    """A number at the beginning of a message, where its lengths are."""
    places = _places(content, b"left\0") + _places(content, b"right\0") + _places(content, b"mono8\0")
    at = rng.choice(places) if places else rng.randrange(len(content))
    return _number_at(rng, content, max(0, at - 20), at + 60)


def _definition(rng: random.Random, content: bytes) -> bytes:
    old, new = rng.choice(_DEFINITIONS)
    return content.replace(old, new)


def _cut(rng: random.Random, content: bytes) -> bytes:
    start = rng.randrange(len(content))
    return rng.choice(
        (content[:start], content[start:], content + content[start:], content[:start] + bytes(4096))
    )


def _sqlite_head(rng: random.Random, content: bytes) -> bytes:
    """A number of the head of the file or of a page is another one."""
    page = rng.choice((0, 0, *range(0, len(content), 4096)))
    return _number_at(rng, content, page, page + (112 if page == 0 else 24))


_BYTE_CHANGES: dict[str, tuple[Callable[[random.Random, bytes], bytes], ...]] = {
    "mcap": (_mcap_length, _mcap_kind, _mcap_order, _mcap_field, _mcap_field, _in_message, _definition, _cut),
    "sqlite3": (_sqlite_head, _sqlite_head, _in_message, _definition, _anywhere, _cut),
    "ros1": (_ros1_header, _ros1_header, _ros1_header, _in_message, _definition, _anywhere, _cut),
}


def _sql(rng: random.Random, path: Path) -> str:
    """Change rows, columns or tables of an SQLite file; return how."""
    columns = {
        "topics": (
            "id",
            "name",
            "type",
            "serialization_format",
            "offered_qos_profiles",
            "type_description_hash",
        ),
        "messages": ("topic_id", "timestamp", "data"),
        "message_definitions": (
            "topic_type",
            "encoding",
            "encoded_message_definition",
            "type_description_hash",
        ),
        "schema": ("schema_version",),
    }
    table = rng.choice(list(columns))
    column = rng.choice(columns[table])
    loose = f"CREATE TABLE x AS SELECT * FROM {table}; DROP TABLE {table}; ALTER TABLE x RENAME TO {table}; "
    view = f"ALTER TABLE {table} RENAME TO x; CREATE VIEW {table} AS SELECT * FROM x"
    where = rng.choice(("", " WHERE rowid = 1", " WHERE rowid % 2"))
    change = rng.choice(
        (
            f"{loose}UPDATE {table} SET {column} = {rng.choice(_SQL_VALUES)}{where}",
            f"{loose}UPDATE {table} SET {column} = {rng.choice(_SQL_VALUES)}{where}",
            f"DELETE FROM {table}{where}",
            f"DROP TABLE {table}",
            f"ALTER TABLE {table} RENAME COLUMN {column} TO y",
            view,
            f"{loose}INSERT INTO {table} SELECT * FROM {table}",
            "PRAGMA journal_mode = WAL",
            "PRAGMA encoding = 'UTF-16'; VACUUM",
            "PRAGMA page_size = 512; VACUUM",
        )
    )
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(f"PRAGMA synchronous = OFF; {change}")
        connection.commit()
    return change


def _metadata(rng: random.Random, file: Path) -> str:
    """Set a value of metadata.yaml, at any depth, to another one."""
    document = yaml.safe_load(file.read_text())
    at, path = document, []
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        key = rng.choice(keys)
        path.append(str(key))
        if not isinstance(at[key], dict | list) or not at[key] or rng.random() < 0.15:
            break
        at = at[key]
    value = rng.choice(_VALUES)
    if rng.random() < 0.15:
        del at[key]
    else:
        at[key] = value
    file.write_text(yaml.safe_dump(document))
    return f"metadata {'.'.join(path)} = {value!r:.40}"


def mutate(rng: random.Random, path: Path, kind: str) -> str:
    """Change a recording; return how.

    Args:
        rng: Decides what.
        path: The recording.
        kind: One of :data:`KINDS`.
    """
    files = [path] if path.is_file() else [file for file in path.iterdir() if file.name != "metadata.yaml"]
    metadata = path / "metadata.yaml"
    if path.is_dir() and metadata.exists() and rng.random() < 0.2:
        return _metadata(rng, metadata)
    storage = kind.partition("-")[0]
    if storage == "sqlite3" and rng.random() < 0.5:
        return _sql(rng, files[0])
    changes = _BYTE_CHANGES[storage] if kind != "mcap-file" else (_anywhere, _cut, _in_message)
    change = rng.choice(changes)
    files[0].write_bytes(change(rng, files[0].read_bytes()))
    if path.is_dir() and metadata.exists() and rng.random() < 0.3:
        metadata.unlink()
        return f"{change.__name__}, no metadata"
    return change.__name__


def read_mutations(numbers: range, folder: Path) -> MutationCounts:
    """Make recordings, mutate and read them; return what became of them.

    To be called in the main thread of a process: a signal ends what hangs.

    Args:
        numbers: Of the mutations; the same number is the same mutation.
        folder: For the recordings.
    """
    good = {kind: make_recording(_made(folder / "good" / kind), kind) for kind in KINDS}
    counts = MutationCounts()
    faults = []
    previous = signal.signal(signal.SIGALRM, _ring)
    for number in numbers:
        rng, kind = random.Random(number), KINDS[number % len(KINDS)]
        copy = folder / str(number)
        shutil.copytree(good[kind].parent, copy)
        path = copy / good[kind].name
        what = f"{number} ({kind}): {mutate(rng, path, kind)}"
        counts.mutations += 1
        start_s = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, _HANG_S)
        try:
            became = _read(path)
        except _HangError:
            became = "hangs"
            faults.append(f"{what}: no end in {_HANG_S:g} s")
        except Exception:  # noqa: BLE001  (whatever it is, it is counted and told)
            became = "tracebacks"
            faults.append(f"{what}: {traceback.format_exc()}")
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        setattr(counts, became, getattr(counts, became) + 1)
        counts.longest_s = max(counts.longest_s, time.perf_counter() - start_s)
        shutil.rmtree(copy)
    signal.signal(signal.SIGALRM, previous)
    counts.peak_mb, counts.faults = _peak_mb(), tuple(faults)
    return counts


class _HangError(BaseException):
    """The time is over; nothing that catches exceptions catches it."""


def _ring(*_: Any) -> None:
    raise _HangError


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder


def _read(path: Path) -> str:
    """Read a recording and return what became of it, by the names of :class:`MutationCounts`."""
    n_frames = 0
    whole = True
    try:
        with open_source([path]) as source:
            for frame in source.frames():
                n_frames += 1
                whole = whole and not frame.problem
            whole = whole and n_frames == _N_FRAMES and not source.remarks
    except SelfcalError as error:
        text = str(error)
        if not text.isprintable() or len(text) > _LONGEST_MESSAGE:
            raise ValueError(f"a refusal that is not one printable line: {text[:300]!r}") from error
        return "in_part" if n_frames else "refused"
    return "read" if whole else "in_part"


def _peak_mb() -> float:
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return float("nan")
    return float(status.partition("VmHWM:")[2].split()[0]) / 1e3


def mutations_table(options: Options) -> Iterator[Table]:
    """Yield what became of the mutated recordings, in processes of their own."""
    table = Table(
        "mutations",
        f"{options.bag_mutations} recordings mutated by their structure",
        ["mutations", "read", "in part", "refused", "tracebacks", "hangs", "longest", "peak memory"],
        f"Small recordings of {len(KINDS)} kinds ({', '.join(KINDS)}), each changed in one place that has a "
        "meaning in its format, and read as `replay` does, without the net of the command around it. 'In "
        "part': an image or more is lost, and it is said. The peak is that of a process that reads 50.",
    )
    total = MutationCounts()
    for start in range(0, options.bag_mutations, _BATCH):
        stop = min(start + _BATCH, options.bag_mutations)
        command = [sys.executable, "-m", "benchmarks.mutations", str(start), str(stop)]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        found = MutationCounts(**json.loads(run.stdout))
        for name in ("mutations", "read", "in_part", "refused", "tracebacks", "hangs"):
            setattr(total, name, getattr(total, name) + getattr(found, name))
        total.longest_s = max(total.longest_s, found.longest_s)
        total.peak_mb = max(total.peak_mb, found.peak_mb)
        for fault in found.faults:
            sys.stderr.write(f"{fault}\n")
    counts = (total.mutations, total.read, total.in_part, total.refused, total.tracebacks, total.hangs)
    table.add(*map(str, counts), f"{total.longest_s:.1f} s", f"{total.peak_mb:.0f} MB")
    yield table


def main(arguments: list[str]) -> int:
    """Print the counts of the mutations from START to before STOP as JSON: ``mutations START STOP``."""
    start, stop = map(int, arguments)
    with tempfile.TemporaryDirectory() as folder:
        counts = read_mutations(range(start, stop), Path(folder))
    sys.stdout.write(json.dumps(asdict(counts)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
