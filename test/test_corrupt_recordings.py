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

"""300 mutations of good recordings: an error with status 2, or refused frames with reasons; nothing else."""

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from bag_making import cameras, make_bag, make_split_bag

from stereo_selfcal.cli.replay import main
from stereo_selfcal.core.camera.rig import StereoRig

ROOT = Path(__file__).resolve().parent.parent
# Larger than the least image, so that frames are looked into; without lines, so that none is accepted.
RIG = StereoRig(80, 64, 50.0, 50.0, 39.5, 31.5, 0.15)
N_FRAMES = 4
KINDS = (
    "mcap",
    "mcap-chunks",
    "mcap-lz4",
    "mcap-messages",
    "mcap-file",
    "sqlite3",
    "sqlite3-messages",
    "ros1",
)
N_MUTATIONS = 300


def truncated(rng, content):
    return content[: rng.randrange(len(content))]


def flipped(rng, content):
    content = bytearray(content)
    for _ in range(rng.choice((1, 1, 3, 20))):
        content[rng.randrange(len(content))] ^= rng.randrange(1, 256)
    return bytes(content)


def zeroed(rng, content):
    start = rng.randrange(len(content))
    length = min(rng.choice((8, 64, 512)), len(content) - start)
    return content[:start] + bytes(length) + content[start + length :]


def cut_out(rng, content):
    start = rng.randrange(len(content))
    return content[:start] + content[start + rng.choice((1, 8, 100, 1000)) :]


def doubled(rng, content):
    start = rng.randrange(len(content))
    return content[:start] + content[start - min(start, 300) :]


def other_schema(rng, content):
    """Fields of the messages have other names, types or sizes than in the data, of the same length."""
    old, new = rng.choice(
        (
            (b"uint32 height", b"uint16 height"),
            (b"uint32 width", b"string width"),
            (b"uint8[] data", b"int64[] data"),
            (b"string encoding", b"string encodinG"),
            (b"float64[12] p", b"float64[11] p"),
            (b"float64[9] k", b"float64[8] k"),
            (b"sensor_msgs/msg/Image", b"sensor_msgs/msg/Imagf"),
            (b"sensor_msgs/msg/CameraInfo", b"sensor_msgs/msg/CameraInfp"),
            (b"std_msgs/msg/Header", b"std_msgs/msg/Heaper"),
            (b"ros2msg", b"ros2idl"),
            (b"image_rect", b"image_recu"),
        )
    )
    return content.replace(old, new)


BYTES = (truncated, flipped, flipped, flipped, zeroed, cut_out, doubled, other_schema)


def mutate(rng, folder):
    """Damage a recording; return what to open, and what was done."""
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    storages = [file for file in files if file.name != "metadata.yaml"]
    metadata = [file for file in files if file.name == "metadata.yaml"]
    kind = rng.random()
    if kind < 0.7 or not metadata:
        file, change = rng.choice(storages), rng.choice(BYTES)
    elif kind < 0.85:
        file, change = metadata[0], rng.choice((truncated, flipped, zeroed, cut_out, other_value))
    else:
        file, change = (
            rng.choice(storages),
            rng.choice((renamed, of_another, emptied, replaced_by_folder, gone)),
        )
    what = f"{change.__name__} {file.name}"
    if change in (*BYTES, other_value):
        file.write_bytes(change(rng, file.read_bytes()))
    else:
        change(rng, file)
    return what


def other_value(rng, content):
    """A value of metadata.yaml is another one, or of another type."""
    data = yaml.safe_load(content)
    bag = data["rosbag2_bagfile_information"]
    key = rng.choice(sorted(bag))
    if rng.random() < 0.3:
        del bag[key]
    else:
        bag[key] = rng.choice(
            (None, -1, 0, 10**30, "x", [], ["x"], {}, {"nanoseconds": "x"}, float("nan"), True)
        )
    return yaml.safe_dump(data).encode()


def renamed(rng, file):
    suffix = rng.choice((".mcap", ".db3", ".bag", ".zstd", ".txt", ""))
    file.rename(file.with_name(f"other{suffix}"))


def of_another(rng, file):
    """The content of a file of another kind."""
    file.write_bytes(
        rng.choice((b"SQLite format 3\x00" + bytes(100), b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"{}"))
    )


def emptied(rng, file):
    file.write_bytes(b"")


def replaced_by_folder(rng, file):
    file.unlink()
    file.mkdir()


def gone(rng, file):
    file.unlink()


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Return the folder of each good recording, and what is opened in it."""
    top = tmp_path_factory.mktemp("good")
    recordings = []
    for kind in KINDS:
        options = {"compressed": "png"} if kind.endswith("chunks") else {}
        (top / kind).mkdir()
        path = make_bag(top / kind / "bag", cameras(**options), N_FRAMES, kind, RIG)
        recordings.append((top / kind, path.name))
    (top / "split").mkdir()
    make_split_bag(top / "split" / "bag", cameras(), "mcap", 2, N_FRAMES // 2, RIG)
    recordings.append((top / "split", "bag"))
    return recordings


def mutation(good, number, folder):
    rng = random.Random(number)
    origin, name = good[number % len(good)]
    shutil.copytree(origin, folder)
    what = mutate(rng, folder)
    return folder / name, f"mutation {number}: {origin.name}, {what}"


def check(status, out, err, what):
    assert "Traceback" not in out + err, what
    assert status in (1, 2), what
    if status == 2:
        assert err.startswith("replay: "), what
        assert err.count("\n") == 1, what
    if status == 2 and not out:
        return "refused"
    content = json.loads(out)
    assert content["frames"], what
    assert all(frame["reason"] for frame in content["frames"]), what
    assert (status == 2) == ("ended_early" in content), what
    if len(content["frames"]) != N_FRAMES:
        assert status == 2 or content["remarks"], f"{what}: frames are missing and nobody said so"
        return "in part"
    return "read"


def test_good_recordings_are_read(good, capsys):
    for folder, name in good:
        status = main([str(folder / name), "--json", "--jobs", "1"])
        out, err = capsys.readouterr()
        assert (status, err) == (1, ""), folder
        assert check(status, out, err, folder.name) == "read"
        assert "remarks" not in json.loads(out)


@pytest.mark.slow
def test_mutations_are_refused_or_said(good, tmp_path, capsys):
    found = []
    for number in range(N_MUTATIONS):
        folder = tmp_path / str(number)
        path, what = mutation(good, number, folder)
        try:
            status = main([str(path), "--json", "--jobs", "1"])
        except Exception as error:
            raise AssertionError(what) from error
        found.append(check(status, *capsys.readouterr(), what))
        shutil.rmtree(folder)
    counts = {kind: found.count(kind) for kind in sorted(set(found))}
    assert counts["refused"] > N_MUTATIONS / 4, counts
    assert counts["read"] > N_MUTATIONS / 20, counts


@pytest.mark.slow
def test_mutations_as_processes(good, tmp_path):
    for number in range(N_MUTATIONS, N_MUTATIONS + len(good), 2):
        path, what = mutation(good, number, tmp_path / str(number))
        command = [sys.executable, "-m", "stereo_selfcal", "replay", str(path), "--json"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120)
        check(done.returncode, done.stdout, done.stderr, what)


def test_mutations_are_the_same_every_time(good, tmp_path):
    for number in (0, 5, 11):
        contents = []
        for again in range(2):
            path, what = mutation(good, number, tmp_path / f"{number}_{again}")
            files = sorted(file for file in path.parent.rglob("*") if file.is_file())
            contents.append((what, [(file.name, file.read_bytes()) for file in files]))
        assert contents[0] == contents[1]
