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

"""Reading stereo frames from recordings of every kind, and refusing damaged ones in one line."""

import os

import numpy as np
import pytest
import yaml
from bag_making import FIRST_NS, KINDS, PERIOD_NS, RIG, Camera, cameras, make_bag, make_split_bag, picture
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stereo_selfcal.bags import BagError, Selection, StereoBag
from stereo_selfcal.bags import reader as reader_module
from stereo_selfcal.core.camera.rig import StereoRig
from stereo_selfcal.core.errors import ImageError


def read(path, **options):
    with StereoBag(path, **options) as bag:
        return list(bag.frames())


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_recording(tmp_path, kind):
    path = make_bag(tmp_path / "bag", cameras(), kind=kind)
    with StereoBag(path) as bag:
        assert bag.read_rig() == RIG
        assert bag.n_frames == 3
        frames = list(bag.frames())
    assert [frame.stamp_s for frame in frames] == pytest.approx([100.0, 100.1, 100.2])
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.left, picture("left", index))
        np.testing.assert_array_equal(frame.right, picture("right", index))


@pytest.mark.parametrize(("kind", "suffix"), [("mcap", ".mcap"), ("sqlite3", ".db3")])
def test_storage_file_alone(tmp_path, kind, suffix):
    folder = make_bag(tmp_path / "bag", cameras(), kind=kind)
    assert len(read(folder / f"bag{suffix}")) == 3
    (folder / "metadata.yaml").unlink()  # what a killed recorder leaves
    assert len(read(folder)) == 3


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind[:4] != "ros1" and kind != "mcap-lz4"])
def test_split_recordings(tmp_path, kind):
    path = make_split_bag(tmp_path / "bag", cameras(), kind)
    frames = read(path)
    assert [round(f.left.mean() - frames[0].left.mean()) for f in frames] == [0, 10, 20, 30, 40, 50]


def test_split_recording_without_metadata(tmp_path):
    path = make_split_bag(tmp_path / "bag", cameras())
    (path / "metadata.yaml").unlink()
    assert len(read(path)) == 6


@pytest.mark.parametrize(("first", "second"), [("mcap", "mcap"), ("sqlite3", "mcap"), ("ros1", "ros1-lz4")])
def test_several_bags_are_one_drive_in_the_order_of_time(tmp_path, first, second):
    late = make_bag(tmp_path / "a", cameras(), kind=first, first=3)
    early = make_bag(tmp_path / "b", cameras(), kind=second)
    with StereoBag([late, early]) as bag:
        assert bag.n_frames == 6
        assert bag.read_rig() == RIG
        stamps = [frame.stamp_s for frame in bag.frames()]
    assert stamps == pytest.approx([100.0, 100.1, 100.2, 100.3, 100.4, 100.5])


def test_cameras_recorded_into_bags_of_their_own_are_paired(tmp_path):
    left = make_bag(tmp_path / "left", [Camera("left")])
    right = make_bag(tmp_path / "right", [Camera("right")], kind="ros1")
    assert len(read([right, left])) == 3


def test_a_bag_given_twice_is_refused(tmp_path):
    path = make_bag(tmp_path / "bag", cameras())
    with pytest.raises(BagError, match="given twice"):
        read([path, path / ".." / "bag"])


@pytest.mark.parametrize("kind", ["mcap", "mcap-lz4", "sqlite3", "ros1"])
@pytest.mark.parametrize(
    ("selection", "numbers"),
    [
        (Selection(), range(20)),
        (Selection(start_s=0.5), range(5, 20)),
        (Selection(end_s=0.5), range(5)),
        (Selection(start_s=0.3, end_s=1.2, every=3), [3, 6, 9]),
        (Selection(max_frames=4), range(4)),
        (Selection(every=6, max_frames=3), [0, 6, 12]),
        (Selection(start_s=1.95), []),
    ],
)
def test_selections(tmp_path, kind, selection, numbers):
    small = StereoRig(64, 4, 50.0, 50.0, 31.5, 1.5, 0.15)
    path = make_bag(tmp_path / "bag", cameras(), n_frames=20, kind=kind, rig=small)
    with StereoBag(path) as bag:
        if not numbers:
            with pytest.raises(BagError, match=r"no frame between 1\.95 s and its end.*1\.9 s long"):
                list(bag.frames(selection))
            return
        frames = list(bag.frames(selection))
        assert [f.stamp_s for f in frames] == pytest.approx([100 + number / 10 for number in numbers])
        again = bag.frame_at(frames[-1].recorded_ns)
        assert again.stamp_s == frames[-1].stamp_s
        np.testing.assert_array_equal(again.left, frames[-1].left)


def test_a_stretch_is_read_without_the_rest(tmp_path, monkeypatch):
    """Segments of a long recording cost what they are long."""
    monkeypatch.setattr(reader_module, "_MARGIN_NS", 200_000_000)
    path = make_bag(tmp_path / "bag", cameras(), n_frames=40)
    with StereoBag(path) as bag:
        read_ns = []
        for part in bag._parts:
            inner = part.messages
            part.messages = lambda *a, inner=inner: (read_ns.append(m.recorded_ns) or m for m in inner(*a))
        assert len(list(bag.frames(Selection(start_s=2.0, end_s=3.0)))) == 10
    assert (min(read_ns) - FIRST_NS, max(read_ns) - FIRST_NS) == (1_800_000_000, 3_100_000_000)


def test_selections_that_select_nothing_are_refused():
    for wrong in ({"start_s": 2.0, "end_s": 2.0}, {"every": 0}, {"max_frames": 0}):
        with pytest.raises(BagError):
            Selection(**wrong)


@pytest.mark.parametrize(
    ("options", "tolerance"),
    [({"encoding": "bgr8"}, 0), ({"compressed": "png"}, 0), ({"compressed": "jpeg"}, 3)],
)
@pytest.mark.parametrize("kind", ["mcap", "ros1"])
def test_colour_and_compressed_images(tmp_path, options, tolerance, kind):
    frames = read(make_bag(tmp_path / "bag", cameras(**options), kind=kind))
    assert len(frames) == 3
    difference = frames[2].left.astype(int) - picture("left", 2)
    assert frames[2].left.dtype == np.uint8
    assert np.abs(difference).max() <= tolerance


def test_first_camera_info_may_come_after_the_images(tmp_path):
    late = cameras(info="")
    path = make_bag(tmp_path / "bag", [*late, Camera("left", image=""), Camera("right", image="")])
    with StereoBag(path) as bag:
        assert bag.read_rig() == RIG
        assert len(list(bag.frames())) == 3


def test_frames_are_read_one_by_one(tmp_path, monkeypatch):
    """Memory does not grow: no image is decoded before its frame is asked for."""
    path = make_bag(tmp_path / "bag", cameras(), n_frames=20)
    decoded = []
    convert = reader_module.message_to_grey
    monkeypatch.setattr(reader_module, "message_to_grey", lambda *a: decoded.append(1) or convert(*a))
    with StereoBag(path) as bag:
        messages = []
        storage = bag._parts[0]._storages[0]
        inner = storage.messages
        storage.messages = lambda *a: (messages.append(1) or m for m in inner(*a))
        frames = bag.frames()
        assert not decoded
        for index in range(5):
            next(frames)
            assert len(decoded) == 2 * (index + 1)
            assert len(messages) == 2 * (
                max(index, 1) + 1
            )  # whether the first is a repeated one, the second tells


def test_stamps_pair_within_a_tolerance_only_when_asked(tmp_path):
    shifted = [Camera("left"), Camera("right", stamp_shift_ns=4_000_000)]
    path = make_bag(tmp_path / "bag", shifted)
    words = r"no pair.*3 on /stereo/left.*3 on /stereo/right.*, at most 0 s apart: .* differ by 4\.000 ms"
    with pytest.raises(BagError, match=words):
        read(path)
    frames = read(path, tolerance_s=0.005)
    assert [round(f.stamp_s * 1e9) for f in frames] == [FIRST_NS + i * PERIOD_NS for i in range(3)]


def no_recording(tmp_path):
    return tmp_path / "nowhere"


def text_file(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("nothing")
    return path


def text_with_suffix(suffix):
    def make(tmp_path):
        path = tmp_path / f"notes{suffix}"
        path.write_text("no recording at all")
        return path

    return make


def empty_file(tmp_path):
    path = tmp_path / "empty.mcap"
    path.touch()
    return path


def folder_without_recording(tmp_path):
    (tmp_path / "folder").mkdir()
    return tmp_path / "folder"


def truncated(kind, name):
    def make(tmp_path):
        path = make_bag(tmp_path / "bag", cameras(), kind=kind)
        file = path / name if path.is_dir() else path
        os.truncate(file, file.stat().st_size // 2)
        return path

    return make


def bad_metadata(tmp_path):
    path = make_bag(tmp_path / "bag", cameras())
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    return path


def changed_metadata(kind, old, new):
    def make(tmp_path):
        path = make_bag(tmp_path / "bag", cameras(), kind=kind)
        metadata = (path / "metadata.yaml").read_text()
        assert old in metadata
        (path / "metadata.yaml").write_text(metadata.replace(old, new))
        return path

    return make


def packed_file(tmp_path):
    return make_bag(tmp_path / "bag", cameras(), kind="mcap-file") / "bag.mcap.zstd"


def packed_files_without_metadata(tmp_path):
    path = packed_file(tmp_path).parent
    (path / "metadata.yaml").unlink()
    return path


def other_profile(tmp_path):
    path = make_bag(tmp_path / "bag", cameras()) / "bag.mcap"
    content = path.read_bytes()
    path.write_bytes(content.replace(b"ros2", b"ros1", 1))
    return path


def other_definition(old, new):
    def make(tmp_path):
        path = make_bag(tmp_path / "bag", cameras(), kind="mcap") / "bag.mcap"
        content, old_bytes, new_bytes = path.read_bytes(), old.encode(), new.encode()
        assert len(old_bytes) == len(new_bytes)
        assert old_bytes in content
        path.write_bytes(content.replace(old_bytes, new_bytes))
        return path

    return make


def without_images(tmp_path):
    return make_bag(tmp_path / "bag", cameras(image=""))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (no_recording, "no such file or folder"),
        (text_file, "not a recording"),
        (text_with_suffix(".mcap"), "does not begin as MCAP, SQLite or ROS 1 bag files do"),
        (text_with_suffix(".db3"), "cannot be read as a recording"),
        (text_with_suffix(".bag"), "cannot be read as a recording"),
        (empty_file, "cannot be read as a recording"),
        (folder_without_recording, "without metadata.yaml"),
        (truncated("mcap", "bag.mcap"), "mcap recover"),
        (truncated("mcap-file", "bag.mcap.zstd"), "cannot be read as a recording"),
        (truncated("sqlite3", "bag.db3"), "cannot be read as a recording"),
        (truncated("ros1", ""), "cannot be read as a recording"),
        (bad_metadata, "cannot be read as a recording"),
        (changed_metadata("mcap-messages", "zstd", "lz4"), "'lz4' is not supported.*ros2 bag convert"),
        (
            changed_metadata("mcap", "identifier: mcap", "identifier: x"),
            "Storage plugin 'x'.*ros2 bag convert",
        ),
        (changed_metadata("mcap", "bag.mcap", "other.mcap"), "files are missing.*beside metadata.yaml"),
        (changed_metadata("mcap", "version: 9", "version: 90"), "version 90 is not supported.*newer version"),
        (packed_file, "unpack it: zstd -d bag.mcap.zstd"),
        (packed_files_without_metadata, "no metadata.yaml.*unpack it: zstd -d bag.mcap.zstd"),
        (other_profile, "MCAP file of another system"),
        (
            other_definition("string encoding", "string encodinG"),
            "of sensor_msgs/msg/Image has another field",
        ),
        (other_definition("uint32 height", "string height"), "has another field than height"),
        (other_definition("float64[9] k", "float64[8] k"), "CameraInfo has another field than k"),
        (without_images, "no images"),
    ],
)
def test_unusable_recordings_are_refused_in_one_line(tmp_path, make, message):
    path = make(tmp_path)
    with pytest.raises(BagError, match=message) as error, StereoBag(path) as bag:
        list(bag.frames())
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("sides", "message"),
    [
        (cameras(info=""), "no CameraInfo on /stereo/left/camera_info.*none.*--rig"),
        ([Camera("left"), Camera("right", info="")], "no CameraInfo on /stereo/right/camera_info"),
        (
            [Camera("left", info_changes={"k": np.zeros(9), "p": np.zeros(12)}), Camera("right")],
            r"left CameraInfo is uncalibrated \(K\[0\] = 0 and P\[0\] = 0\)",
        ),
        (
            cameras(info_changes={"p": np.array([50.0, 0, 31.5, 0, 0, 50, 23.5, 0, 0, 0, 1, 0])}),
            "baseline of zero",
        ),
    ],
)
def test_unusable_camera_info_is_refused(tmp_path, sides, message):
    with StereoBag(make_bag(tmp_path / "bag", sides)) as bag, pytest.raises(BagError, match=message):
        bag.read_rig()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"encoding": "32FC1"}, r"/stereo/left/image_rect at 100\.000 s.*'32FC1' is not supported"),
        ({"step_too_small": True}, "step is 63 bytes"),
    ],
)
def test_unusable_images_name_topic_and_time(tmp_path, options, message):
    with pytest.raises(BagError, match=message):
        read(make_bag(tmp_path / "bag", cameras(**options)))


def spoilt(stamps):
    """Return a conversion of images that fails at these tenths of a second."""
    convert = reader_module.message_to_grey

    def message_to_grey(message, rig_size):
        if message.header.stamp.nanosec // PERIOD_NS in stamps:
            raise ImageError("cut short")
        return convert(message, rig_size)

    return message_to_grey


@pytest.mark.parametrize("lost", [{0}, {0, 1}, {2}, {4}, {0, 2, 3}])
def test_an_image_that_cannot_be_converted_is_a_frame_lost(tmp_path, monkeypatch, lost):
    path = make_bag(tmp_path / "bag", cameras(), n_frames=5)
    monkeypatch.setattr(reader_module, "message_to_grey", spoilt(lost))
    frames = read(path)
    assert len(frames) == 5
    for index, frame in enumerate(frames):
        assert bool(frame.problem) == (index in lost)
        assert frame.stamp_s == pytest.approx(100 + index / 10)
        assert (frame.left.size == 0) == (index in lost)


def test_a_camera_that_cannot_be_converted_is_an_error_soon(tmp_path):
    path = make_bag(tmp_path / "bag", cameras(encoding="yuv422"), n_frames=40)
    with StereoBag(path) as bag, pytest.raises(BagError, match=r"at 100\.000 s.*'yuv422' is not supported"):
        next(bag.frames())


@pytest.fixture(scope="module")
def recording_bytes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    return {
        ".mcap": (make_bag(folder / "a", cameras(), kind="mcap-chunks") / "a.mcap").read_bytes(),
        ".db3": (make_bag(folder / "b", cameras(), kind="sqlite3") / "b.db3").read_bytes(),
        ".bag": make_bag(folder / "c", cameras(), kind="ros1").read_bytes(),
    }


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    suffix=st.sampled_from([".mcap", ".db3", ".bag"]),
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=8),
    keep=st.floats(0, 1),
)
def test_damaged_bytes_give_frames_or_one_error(tmp_path, recording_bytes, suffix, flips, keep):
    content = bytearray(recording_bytes[suffix])
    for position, mask in flips:
        content[int(position * len(content))] ^= mask
    path = tmp_path / f"damaged{suffix}"
    path.write_bytes(content[: max(1, round(keep * len(content)))] if keep < 0.9 else content)
    try:
        with StereoBag(path) as bag:
            bag.read_rig()
            for frame in bag.frames():
                assert frame.left.dtype == np.uint8
    except BagError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize("metadata", [True, False])
def test_files_of_one_recording_are_read_in_the_order_of_time_not_of_letters(tmp_path, kind, metadata):
    bag = make_split_bag(tmp_path / "bag", cameras(), kind, n_files=11, n_frames=1)
    file = bag / "metadata.yaml"
    content = yaml.safe_load(file.read_text())
    content["rosbag2_bagfile_information"]["relative_file_paths"].sort()  # bag_10 before bag_2
    file.write_text(yaml.safe_dump(content))
    if not metadata:
        file.unlink()
    with StereoBag(bag) as opened:
        stamps = [round(frame.stamp_s, 6) for frame in opened.frames()]
    assert stamps == sorted(stamps) and len(stamps) == 11


def test_images_that_were_lost_get_no_tolerance(tmp_path):
    """Each camera lost every image of which the other's was recorded."""
    of_the_left = (2, 3, 7, 8, 10, 13, 14, 15)
    of_the_right = tuple(set(range(16)) - set(of_the_left))
    path = make_bag(
        tmp_path / "bag", [Camera("left", lost=of_the_left), Camera("right", lost=of_the_right)], n_frames=16
    )
    with pytest.raises(BagError, match=r"images are lost on the way: .* no tolerance helps: record anew"):
        read(path)
