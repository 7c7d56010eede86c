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

"""`replay --mcap`: the file read back, its messages against the result and the images of the recording."""

import json
import math
import os
import struct
import tracemalloc
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from independent_camera import turn
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader

from stereo_selfcal import Extrinsics, StereoRig
from stereo_selfcal.cli import replay
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.geometry.vehicle import CameraAxes, RigidTransform
from stereo_selfcal.core.results import CalibrationResult
from stereo_selfcal.files.frames import FrameNames, InfoFrames, place_camera
from stereo_selfcal.offline import open_source
from stereo_selfcal.published.transforms import camera_transforms, optical_transforms
from stereo_selfcal.recording import content, messages, topics
from stereo_selfcal.recording.mcap_file import new_mcap_file
from stereo_selfcal.recording.topics import DEBUG_IMAGE, TOPICS

BAG = Path(__file__).resolve().parents[2] / "bags" / "straight_road"
BODY_FROM_OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
N_FRAMES = 4


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the folder of `replay --mcap out.mcap --output out.yaml --json`, with its output beside."""
    folder = tmp_path_factory.mktemp("mcap")
    out = folder / "out.mcap"
    options = ["--max-frames", str(N_FRAMES), "--jobs", "1", "--mcap", str(out)]
    assert replay.main([str(BAG), *options, "--output", str(folder / "out.yaml")]) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["out.mcap", "out.yaml"]
    return out


@pytest.fixture(scope="module")
def read(written):
    """Return {topic: [(recorded_ns, message), ...]} of the file, in the order of the file."""
    found = {}
    with AnyReader([written]) as reader:
        for connection, recorded_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((recorded_ns, message))
    return found


def only(read, topic):
    ((_, message),) = read[topic.name]
    return message


def matrix(q):
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def xyz(point):
    return np.array([point.x, point.y, point.z])


def result_of(written):
    document = yaml.safe_load(written.with_suffix(".yaml").read_text(encoding="utf-8"))
    return document["/**"]["ros__parameters"]


def test_topics_types_and_latched_qos(written):
    with Reader(written) as reader:
        found = {connection.topic: connection for connection in reader.connections}
    assert {name: each.msgtype for name, each in found.items()} == {t.name: t.kind for t in TOPICS}
    for topic in TOPICS:
        (qos,) = found[topic.name].ext.offered_qos_profiles
        latched = qos.durability == QosDurability.TRANSIENT_LOCAL
        assert latched == topic.latched, topic.name
        assert (qos.depth == 1) == latched


def test_every_frame_is_there_with_its_stamp(read):
    per_frame = [topic for topic in TOPICS if not topic.latched]
    assert {len(read[topic.name]) for topic in per_frame} == {N_FRAMES}
    with open_source([BAG]) as source:
        frames = [frame for frame, _ in zip(source.frames(), range(N_FRAMES), strict=False)]
    for topic in per_frame:
        for (recorded_ns, message), frame in zip(read[topic.name], frames, strict=True):
            assert recorded_ns == frame.recorded_ns
            stamp_s = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            assert stamp_s == pytest.approx(frame.stamp_s, abs=1e-6)
    for topic, side in ((topics.LEFT_IMAGE, "left"), (topics.RIGHT_IMAGE, "right")):
        for (_, message), frame in zip(read[topic.name], frames, strict=True):
            image = cv2.imdecode(message.data, cv2.IMREAD_UNCHANGED)
            assert image.shape == frame.left.shape and "jpeg" in message.format
            assert np.abs(image.astype(int) - getattr(frame, side)).mean() < 2.0
            assert message.header.frame_id == f"stereo_{side}_optical"


def test_what_is_latched_comes_first(read):
    first_ns = min(recorded_ns for found in read.values() for recorded_ns, _ in found)
    for topic in TOPICS:
        if topic.latched:
            assert [recorded_ns for recorded_ns, _ in read[topic.name]] == [first_ns]


def test_transforms_equal_the_result(read, written):
    """A point on the road by the chain of transforms, and by the numbers of the result file."""
    extrinsics, rig = result_of(written)["extrinsics"], result_of(written)["provenance"]["rig"]
    by_child = {each.child_frame_id: each for each in only(read, topics.TF_STATIC).transforms}
    assert {child: each.header.frame_id for child, each in by_child.items()} == {
        "stereo_camera": "road",
        "stereo_left_optical": "stereo_camera",
        "stereo_right_optical": "stereo_camera",
    }
    camera = by_child["stereo_camera"].transform
    expected = turn("y", extrinsics["pitch_rad"]) @ turn("x", extrinsics["roll_rad"])
    np.testing.assert_allclose(matrix(camera.rotation), expected, atol=1e-12)
    np.testing.assert_allclose(xyz(camera.translation), [0.0, 0.0, extrinsics["height_m"]], atol=1e-15)
    for side, y_m in (("left", rig["baseline_m"] / 2), ("right", -rig["baseline_m"] / 2)):
        optical = by_child[f"stereo_{side}_optical"].transform
        np.testing.assert_allclose(matrix(optical.rotation), BODY_FROM_OPTICAL, atol=1e-15)
        np.testing.assert_allclose(xyz(optical.translation), [0.0, y_m, 0.0], atol=1e-15)
    pose = only(read, topics.POSE)
    assert pose.header.frame_id == "road"
    np.testing.assert_array_equal(xyz(pose.pose.pose.position), xyz(camera.translation))
    np.testing.assert_array_equal(matrix(pose.pose.pose.orientation), matrix(camera.rotation))
    variances = pose.pose.covariance.reshape(6, 6)
    assert math.sqrt(variances[2, 2]) == pytest.approx(extrinsics["height_std_m"], rel=1e-9)


def test_markers_extrinsics_and_alignment_equal_the_result(read, written):
    result = result_of(written)
    event = only(read, topics.EXTRINSICS)
    values = {parameter.name: parameter.value.double_value for parameter in event.changed_parameters}
    assert event.node == "/stereo_selfcal"
    for name, value in result["extrinsics"].items():
        assert values[f"extrinsics.{name}"] == value
    for name, value in result["alignment"].items():
        assert values[f"alignment.{name}"] == value
    shown = [each for each in only(read, topics.MARKERS).markers if each.action == 0]
    assert {each.header.frame_id for each in shown} == {"road"}
    assert [each.ns for each in shown] == ["road", "camera", "camera", "lane_lines", "lane_lines"]
    assert len(shown[3].points) > 2 and shown[2].text.startswith("1.40")
    alignment = only(read, topics.ALIGNMENT)
    assert alignment.header.frame_id == "stereo_camera"
    told = result["alignment"]
    expected = turn("z", told["yaw_rad"]) @ turn("y", told["pitch_rad"]) @ turn("x", told["roll_rad"])
    np.testing.assert_allclose(matrix(alignment.pose.pose.orientation), expected, atol=1e-12)
    std = np.sqrt(np.diag(alignment.pose.covariance.reshape(6, 6)))[3:]
    assert std == pytest.approx([told["roll_std_rad"], told["pitch_std_rad"], told["yaw_std_rad"]])


def test_road_pose_and_diagnostics_are_of_the_frame(read, capsys, written):
    assert replay.main([str(BAG), "--max-frames", str(N_FRAMES), "--jobs", "1", "--json"]) == 0
    frames = json.loads(capsys.readouterr().out)["frames"]
    for (_, pose), (_, report), frame in zip(
        read[topics.ROAD_POSE.name], read[topics.DIAGNOSTICS.name], frames, strict=True
    ):
        assert pose.pose.pose.position.z == frame["height_m"]
        parts = {each.name: each for each in report.status}
        assert set(parts) == {f"/stereo_selfcal: {each}" for each in ("calibration", "camera info", "frame")}
        values = {pair.key: pair.value for pair in parts["/stereo_selfcal: frame"].values}
        assert float(values["pitch_rad"]) == frame["pitch_rad"]
        assert float(values["roll_std_rad"]) == frame["std"]["roll_rad"]
        values = {pair.key: pair.value for pair in parts["/stereo_selfcal: calibration"].values}
        assert float(values["height_m"]) == result_of(written)["extrinsics"]["height_m"]
        assert {each.hardware_id for each in report.status} == {"stereo_camera"}
        assert {each.level for each in report.status} == {0}


def test_the_file_can_be_calibrated_again(written, capsys):
    """Its images have lost little: the pose is the same within a tenth of its standard deviation."""
    assert replay.main([str(written), "--jobs", "1", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    before = result_of(written)["extrinsics"]
    for name in again["extrinsics"]:
        std = before[f"{name.rpartition('_')[0]}_std_{name.rpartition('_')[2]}"]
        assert again["extrinsics"][name] == pytest.approx(before[name], abs=0.1 * std)


def test_the_mcap_package_reads_it(written):
    reader = pytest.importorskip("mcap.reader")
    with written.open("rb") as file:
        summary = reader.make_reader(file, validate_crcs=True).get_summary()
        n_messages = sum(1 for _ in reader.make_reader(file).iter_messages())
    assert {each.topic for each in summary.channels.values()} == {topic.name for topic in TOPICS}
    assert n_messages == summary.statistics.message_count == 7 * N_FRAMES + 5


def test_magic_and_profile(written):
    """What Foxglove and rosbag2 look at first."""
    data = written.read_bytes()
    assert data[:8] == data[-8:] == b"\x89MCAP0\r\n"
    assert struct.unpack("<I", data[17:21])[0] == 4 and data[21:25] == b"ros2"


def test_nothing_is_overwritten(written, capsys):
    before = written.read_bytes()
    assert replay.main([str(BAG), "--max-frames", "1", "--jobs", "1", "--mcap", str(written)]) == 2
    assert "exists already and is not overwritten" in capsys.readouterr().err
    assert written.read_bytes() == before


def test_a_file_within_the_recording_is_refused(capsys):
    """A folder without metadata.yaml would have it for one of its parts."""
    assert replay.main([str(BAG), "--mcap", str(BAG / "out.mcap")]) == 2
    assert "would be a part of the recording" in capsys.readouterr().err
    assert not (BAG / "out.mcap").exists()


def test_all_pairs_have_a_file_each(tmp_path):
    options = ["--all", "--max-frames", "1", "--jobs", "1", "--mcap", str(tmp_path / "out.mcap")]
    assert replay.main([str(BAG), *options]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["out.stereo.mcap"]


@pytest.mark.parametrize(
    ("name", "words"), [("out.bag", "end the name in .mcap"), ("no/out.mcap", "cannot be written")]
)
def test_bad_names_are_refused_before_any_work(tmp_path, capsys, name, words):
    assert replay.main([str(BAG), "--mcap", str(tmp_path / name)]) == 2
    captured = capsys.readouterr()
    assert words in captured.err and not captured.out
    assert not list(tmp_path.iterdir())


def test_a_file_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError), new_mcap_file(tmp_path / "out.mcap", TOPICS):
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_told_and_leaves_nothing(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    refused = pytest.raises(OutputError, match="no space left on device; make room")
    with refused, new_mcap_file(tmp_path / "out.mcap", TOPICS):
        pass
    assert not list(tmp_path.iterdir())


def test_memory_does_not_grow_with_the_file(tmp_path):
    """Of ten times the images, the most that is held at a time is no more than a tenth greater."""
    image, peaks = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8), []
    message = messages.jpeg_message(image, 95, "left", 0)
    for n_images in (20, 200):
        tracemalloc.start()
        with new_mcap_file(tmp_path / f"{n_images}.mcap", TOPICS) as file:
            for number in range(n_images):
                file.add(DEBUG_IMAGE, message, number)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert all(after < 1.1 * before for before, after in pairwise(peaks))


def test_a_refused_recording_has_images_and_reasons_and_no_result(tmp_path):
    out = tmp_path / "out.mcap"
    options = ["--max-frames", "2", "--jobs", "1", "--mcap", str(out)]
    assert replay.main([str(BAG.parent / "no_lines"), *options]) == 1
    with AnyReader([out]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        (connection,) = [each for each in reader.connections if each.topic == "/diagnostics"]
        _, _, data = next(reader.messages([connection]))
        report = reader.deserialize(data, connection.msgtype)
    assert {counts[topic.name] for topic in TOPICS if topic.latched or topic is topics.ROAD_POSE} == {0}
    assert counts[topics.LEFT_IMAGE.name] == 2
    frame = report.status[-1]
    assert frame.level == 1 and frame.message.startswith("refused: ")
    assert {"last_rejection", "last_rejection_measured"} <= {pair.key for pair in frame.values}
    assert not any(pair.key == "height_m" for status in report.status for pair in status.values)


RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
TURN = Alignment(2e-3, 3e-3, 4e-3, np.diag([1e-10, 4e-10, 9e-10]))


def placed(infos, camera_frame="stereo_camera"):
    """Return a camera whose yaw is known, in the vehicle."""
    result = CalibrationResult(
        "calibrated",
        extrinsics=Extrinsics(1.4, 0.05, 0.01),
        covariance=np.eye(3) * 1e-6,
        n_frames=4,
        travel=Travel(0.02, 0.05, np.eye(2) * 1e-6, 50, 1.3, 30.0),
    )
    return place_camera(result, RIG, FrameNames(camera_frame=camera_frame), infos)


def test_optical_frames_of_either_frame_of_the_camera_are_the_same():
    """Camera body or left optical frame: both chains put the right camera at the same place."""
    chains = []
    for name in ("stereo_camera", "l"):
        camera = placed(InfoFrames("l", "r"), name)
        transforms = [*camera_transforms(camera), *optical_transforms(camera, RIG, ("l", "r"))]
        by_child = {each.child: each for each in transforms}
        assert by_child["road"].parent == "base_footprint"
        whole = RigidTransform(np.eye(3), np.zeros(3))
        child = "r"
        while child != "base_footprint":
            whole, child = by_child[child].transform.after(whole), by_child[child].parent
        chains.append(whole)
    np.testing.assert_allclose(chains[0].rotation, chains[1].rotation, atol=1e-12)
    np.testing.assert_allclose(chains[0].translation_m, chains[1].translation_m, atol=1e-12)


def test_right_camera_is_at_its_place_and_turned():
    body = content.right_in_camera(TURN, placed(InfoFrames()), RIG)
    np.testing.assert_allclose(body.translation_m, [0.0, -RIG.baseline_m / 2, 0.0])
    np.testing.assert_allclose(body.rotation, turn("z", 4e-3) @ turn("y", 2e-3) @ turn("x", 3e-3))
    optical = placed(InfoFrames("l", "r"), "l")
    assert optical.camera.axes is CameraAxes.OPTICAL
    of_left = content.right_in_camera(TURN, optical, RIG)
    np.testing.assert_allclose(of_left.translation_m, [RIG.baseline_m, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(BODY_FROM_OPTICAL @ of_left.rotation, body.rotation, atol=1e-12)
