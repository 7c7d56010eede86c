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

"""What is no file is refused at once, wherever a file is expected: nothing waits for a pipe or a device."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_making import cameras, make_bag

from stereo_selfcal.bags import BagError, StereoBag, open_regular

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes and devices of POSIX")


def fifo(path):
    os.mkfifo(path)
    return path


def link_to(target):
    def make(path):
        path.symlink_to(target)
        return path

    return make


def a_socket(path):
    listener = socket.socket(socket.AF_UNIX)
    here = Path.cwd()
    os.chdir(path.parent)  # a socket's name may have 108 bytes
    try:
        listener.bind(path.name)
    finally:
        os.chdir(here)
    listener.close()
    return path


NO_FILES = {
    "fifo": (fifo, "a pipe"),
    "zero": (link_to("/dev/zero"), "a device"),
    "null": (link_to("/dev/null"), "a device"),
    "socket": (a_socket, "a socket"),
    "loop": (lambda path: link_to(path.name)(path), "no such file|symbolic links"),
}


def images(tmp_path, make):
    """A folder of image pairs whose right image is no file."""
    folder = tmp_path / "images"
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    cv2.imwrite(str(folder / "left" / "1.png"), np.zeros((48, 64), np.uint8))
    make(folder / "right" / "1.png")
    rig = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5, "baseline_m": 0.15}
    (folder / "rig.json").write_text(json.dumps(rig))
    return folder


def places(tmp_path, make):
    """Yield recordings in which something that is no file stands in each place of a file."""
    for suffix in (".mcap", ".db3", ".bag"):
        yield make(tmp_path / f"alone{suffix}")
        folder = tmp_path / f"folder{suffix}"
        folder.mkdir()
        make(folder / f"bag{suffix}")
        yield folder
    for kind in ("mcap", "sqlite3", "mcap-file"):
        bag = make_bag(tmp_path / kind, cameras(), 1, kind)
        file = next(path for path in bag.iterdir() if path.name != "metadata.yaml")
        file.unlink()
        make(file)
        yield bag
    bag = make_bag(tmp_path / "metadata", cameras(), 1)
    (bag / "metadata.yaml").unlink()
    make(bag / "metadata.yaml")
    yield bag


@pytest.mark.parametrize("kind", NO_FILES)
def test_what_is_no_file_is_refused_at_once(tmp_path, kind):
    make, words = NO_FILES[kind]
    paths = [str(path) for path in (*places(tmp_path, make), images(tmp_path, make))]
    code = "import sys; from stereo_selfcal.cli.replay import main; print([main([p]) for p in sys.argv[1:]])"
    command = [sys.executable, "-c", code, *paths]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    lines = done.stderr.splitlines()
    # A link that leads nowhere in place of metadata.yaml is as if there was none.
    expected = len(paths) - (kind == "loop")
    assert len(lines) == expected, done.stderr
    named = sum(any(word in line for word in words.split("|")) for line in lines)
    assert named >= (expected if kind != "loop" else 3), done.stderr


@pytest.mark.parametrize("side", ["-wal", "-journal"])
def test_pipe_beside_an_sqlite_file_is_refused(tmp_path, side):
    bag = make_bag(tmp_path / "bag", cameras(), 1, "sqlite3")
    fifo(bag / f"bag.db3{side}")
    with pytest.raises(BagError, match="a pipe"), StereoBag(bag):
        pass


@pytest.mark.parametrize("path", ["x" * 5000, "a\0b", "a" * 300 + "/b", "metadata.yaml/x"])
def test_path_that_no_file_can_have_is_refused_in_one_line(path):
    with pytest.raises(BagError) as error, StereoBag(path):
        pass
    assert "\n" not in str(error.value)


def test_regular_files_are_opened_through_links(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to("file")
    with open_regular(tmp_path / "link") as file:
        assert file.read() == b"content"
    with pytest.raises(BagError, match="a folder"):
        open_regular(tmp_path)
