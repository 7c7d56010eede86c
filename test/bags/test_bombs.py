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

"""Small files that state gigabytes are refused with what they state, and the memory is not taken."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bag_making import cameras, make_bag
from bomb_making import IMAGES, RECORDINGS, jpeg, pgm, png, tiff_of

from stereo_selfcal.bags import BagError, StereoBag
from stereo_selfcal.core.camera.image_header import MOST_PIXELS, most_pixels, read_image_header
from stereo_selfcal.core.camera.image_messages import decode_compressed
from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import ImageError

ROOT = Path(__file__).resolve().parents[2]
MOST_PEAK_MB = 1_000
# Without DDS, and by the file of the process itself: what the tests have taken does not count.
REPLAY_ALL = """
import json, sys
from stereo_selfcal.cli.replay import main
for path in sys.argv[1:]:
    print(f"status {main([path, '--jobs', '1'])}", file=sys.stderr)
with open("/proc/self/status") as file:
    peak = [line.split()[1] for line in file if line.startswith("VmHWM")]
print("peak", int(peak[0]) / 1e3, file=sys.stderr)
"""
ONLY_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="the peak of the memory is in /proc")


def replay(*paths, timeout_s=120):
    """Return what replaying recordings in a process of its own says, and its peak memory [MB]."""
    command = [sys.executable, "-c", REPLAY_ALL, *map(str, paths)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=timeout_s, errors="replace"
    )
    assert done.returncode == 0, done.stderr
    said, _, peak = done.stderr.rpartition("peak ")
    return said, float(peak)


@pytest.mark.parametrize("kind", IMAGES)
def test_image_that_states_gigabytes_is_refused_with_its_size(kind):
    content, words = IMAGES[kind]
    for rig_size in (None, (1280, 720)):
        with pytest.raises(ImageError, match=words) as refusal:
            decode_compressed(content, "jpeg", rig_size)
        if "states" in words:
            assert ("1280 x 720" if rig_size else "67 million") in str(refusal.value)


@pytest.mark.parametrize("kind", IMAGES)
def test_any_cut_of_a_bomb_is_refused(kind):
    content, _ = IMAGES[kind]
    for end in range(0, min(len(content), 400), 3):
        with pytest.raises(ImageError):
            decode_compressed(content[:end], "jpeg", (64, 48))


def test_images_of_the_rig_and_up_to_four_times_its_sides_are_decoded():
    assert most_pixels((320, 240)) == 2**22  # whatever the rig, four megapixels do no harm
    assert most_pixels((1280, 720)) == 16 * 1280 * 720
    assert most_pixels((8000, 6000)) == MOST_PIXELS
    assert most_pixels((2**31, 2**31)) == MOST_PIXELS  # the rig may come from the same recording
    for content in (png(3000, 2000), jpeg(3000, 2000), pgm(3000, 2000), tiff_of(3000, 2000)):
        header = read_image_header(content)
        assert (header.width, header.height) == (3000, 2000)
        with pytest.raises(ImageError, match="states 3000 x 2000 pixels, the rig has 640 x 480"):
            decode_compressed(content, "png", (640, 480))


@ONLY_LINUX
def test_images_that_state_gigabytes_in_bags_and_folders_take_no_memory(tmp_path):
    paths, words = [], []
    for kind, (content, stated) in IMAGES.items():
        bag = make_bag(tmp_path / kind, cameras(compressed=content), n_frames=1)
        folder = tmp_path / f"{kind}-folder"
        for side in ("left", "right"):
            (folder / side).mkdir(parents=True)
            (folder / side / "1.png").write_bytes(content)
        rig = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5, "baseline_m": 0.15}
        (folder / "rig.json").write_text(json.dumps(rig))
        paths += [bag, folder]
        words += [stated, stated]
    said, peak = replay(*paths)
    assert peak < MOST_PEAK_MB
    lines = [line for line in said.splitlines() if line.startswith("replay: ")]
    assert len(lines) == len(paths)
    for line, stated in zip(lines, words, strict=True):
        assert stated in line
    assert said.count("status 2") == len(paths)


@ONLY_LINUX
@pytest.mark.slow
@pytest.mark.parametrize("kind", RECORDINGS)
def test_recording_that_unpacks_to_gigabytes_is_refused_with_what_it_states(tmp_path, kind):
    make, words = RECORDINGS[kind]
    said, peak = replay(make(tmp_path))
    assert peak < MOST_PEAK_MB
    assert "status 2" in said
    lines = [line for line in said.splitlines() if line.startswith("replay: ")]
    assert len(lines) == 1
    assert re.search(words, lines[0]), lines[0]


QUICK = (
    "zstd-chunk-lies",
    "metadata-lines",
    "metadata-merges",
    "metadata-depth",
    "metadata-values",
    "mcap-index",
    "mcap-holes",
    "sqlite-holes",
    "ros1-holes",
)


@pytest.mark.parametrize("kind", QUICK)
def test_recording_that_unpacks_to_gigabytes_is_refused_soon(tmp_path, kind):
    make, words = RECORDINGS[kind]
    with pytest.raises(BagError, match=words), StereoBag(make(tmp_path)) as bag:
        list(bag.frames())


def test_large_images_of_real_cameras_are_read(tmp_path):
    """Nothing of this is in the way of a camera of 20 megapixels in colour."""
    rig = StereoRig(5000, 4000, 4000.0, 4000.0, 2500.0, 2000.0, 0.15)
    for kind in ("mcap-chunks", "sqlite3-messages"):
        path = make_bag(tmp_path / kind, cameras(encoding="bgr8"), 1, kind, rig)
        with StereoBag(path) as bag:
            (frame,) = bag.frames()
        assert frame.left.shape == (4000, 5000)
        assert frame.left.dtype == np.uint8
