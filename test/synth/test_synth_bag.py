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

"""Synthetic bags: their bytes, their messages, and the committed ones."""

import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader

from stereo_selfcal.bags import StereoBag
from stereo_selfcal.synth.bag import BagWriteError, write_bag, write_named_bags
from stereo_selfcal.synth.scenes import FIRST_STAMP_S, NAMED_SCENES, custom_scene

ROOT = Path(__file__).resolve().parents[2]
SCENE = custom_scene(n_frames=2)


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_same_scene_same_bytes(tmp_path, storage):
    (tmp_path / "other").mkdir()
    write_bag(tmp_path / "bag", SCENE, storage)
    write_bag(tmp_path / "other" / "bag", SCENE, storage)
    first = content(tmp_path / "bag")
    assert first == content(tmp_path / "other" / "bag")
    assert len(first) == 3
    assert not [name for name, data in first.items() if str(tmp_path).encode() in data]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_frames_come_back(tmp_path, storage):
    done = []
    write_bag(tmp_path / "bag", SCENE, storage, done.append)
    assert done == [1, 2]
    with StereoBag(tmp_path / "bag") as bag:
        assert bag.read_rig() == SCENE.scene.rig
        frames = list(bag.frames())
    for frame, rendered in zip(frames, SCENE.frames(), strict=True):
        assert frame.stamp_s == pytest.approx(rendered.stamp_s, abs=1e-9)
        np.testing.assert_array_equal(frame.left, rendered.left)
        np.testing.assert_array_equal(frame.right, rendered.right)


def test_messages_are_those_of_a_rectified_camera(tmp_path):
    write_bag(tmp_path / "bag", SCENE)
    with AnyReader([tmp_path / "bag"]) as reader:
        messages = [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]
    assert {topic for topic, _, _ in messages} == {
        f"/stereo/{side}/{name}" for side in ("left", "right") for name in ("image_rect", "camera_info")
    }
    for topic, time_ns, message in messages:
        side = topic.split("/")[2]
        assert message.header.frame_id == f"stereo_{side}_optical"
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time_ns
        if topic.endswith("camera_info"):
            rig = SCENE.scene.rig
            assert message.p[3] == (-rig.fx * rig.baseline_m if side == "right" else 0)
            assert message.k[0] == message.p[0] == rig.fx
            assert not message.d.any()
        else:
            assert (message.encoding, message.step) == ("mono8", message.width)
    assert messages[0][1] == FIRST_STAMP_S * 1e9


def test_truth_is_written_with_its_equation(tmp_path):
    write_bag(tmp_path / "bag", SCENE)
    text = (tmp_path / "bag" / "truth.yaml").read_text()
    assert "# p_road = R_z(0) R_y(pitch) R_x(roll) p_camera" in text
    assert yaml.safe_load(text) == SCENE.truth()


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("bag", "link"):
        with pytest.raises(BagWriteError, match="exists already"):
            write_bag(tmp_path / name, SCENE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "link"]


def test_named_bags_are_replaced_by_the_same_bytes(tmp_path):
    scenes = [scene for scene in NAMED_SCENES if scene.n_frames <= 2]
    first = {path.name: content(path) for path in write_named_bags(tmp_path, scenes)}
    (tmp_path / scenes[0].name / "metadata.yaml").write_text("damaged")
    again = {path.name: content(path) for path in write_named_bags(tmp_path, scenes)}
    assert first == again
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(scene.name for scene in scenes)


@pytest.mark.parametrize("scene", NAMED_SCENES, ids=lambda scene: scene.name)
def test_committed_bag_is_what_its_scene_gives(tmp_path, scene):
    committed = ROOT / "bags" / scene.name
    if not committed.exists():
        pytest.skip(f"{committed} is not there: make bags")
    made = next(iter(write_named_bags(tmp_path, [scene])))
    assert (made / "truth.yaml").read_text() == (committed / "truth.yaml").read_text()
    with StereoBag(committed) as one, StereoBag(made) as other:
        for expected, frame in zip(one.frames(), other.frames(), strict=True):
            np.testing.assert_array_equal(frame.left, expected.left)
            np.testing.assert_array_equal(frame.right, expected.right)
    storage = f"{scene.name}.mcap"
    writer = re.search(rb"rosbags-[\d.]+", (committed / storage).read_bytes()[:200])
    if writer and writer.group().decode() == f"rosbags-{version('rosbags')}":
        assert content(made) == content(committed)


def ros2_bag_is_there():
    if shutil.which("ros2") is None:
        return False
    return subprocess.run(["ros2", "bag", "--help"], capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not ros2_bag_is_there(), reason="needs the command `ros2 bag`")
def test_ros2_bag_info_reads_it(tmp_path):
    write_bag(tmp_path / "bag", SCENE)
    done = subprocess.run(
        ["ros2", "bag", "info", tmp_path / "bag"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "/stereo/left/image_rect" in done.stdout


def test_writing_needs_no_ros():
    code = "import stereo_selfcal.synth.bag, sys; assert 'rclpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
