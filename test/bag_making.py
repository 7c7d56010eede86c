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

"""Writes small recordings of every kind, good and bad, for the tests of reading and replaying."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import lz4.frame
import numpy as np
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from stereo_selfcal.core.camera.rig import StereoRig

RIG = StereoRig(64, 48, 50.0, 50.0, 31.5, 23.5, 0.15)
NS_PER_S = 1_000_000_000
PERIOD_NS = NS_PER_S // 10
FIRST_NS = 100 * NS_PER_S

KINDS = (
    "mcap",
    "mcap-chunks",
    "mcap-lz4",
    "mcap-messages",
    "mcap-file",
    "sqlite3",
    "sqlite3-messages",
    "sqlite3-file",
    "ros1",
    "ros1-lz4",
    "ros1-bz2",
)


@dataclass
class Camera:
    """One camera's topics as they should be recorded; None leaves a topic out."""

    side: str
    image: str | None = None
    info: str | None = None
    encoding: str = "mono8"
    compressed: str | bytes | None = None  # a format, or the bytes of every image
    step_too_small: bool = False
    stamp_shift_ns: int = 0
    lost: tuple[int, ...] = ()
    info_changes: dict[str, Any] = field(default_factory=dict)
    info_of: Callable[[int], dict[str, Any] | None] = lambda index: {}  # changes of a frame; None: no message
    info_delay_ns: int = 0

    def __post_init__(self):
        suffix = "/compressed" if self.compressed else ""
        if self.image is None:
            self.image = f"/stereo/{self.side}/image_rect{suffix}"
        if self.info is None:
            self.info = f"/stereo/{self.side}/camera_info"


def cameras(**both):
    return [Camera("left", **both), Camera("right", **both)]


def picture(side: str, index: int, rig: StereoRig = RIG):
    """A grey picture that tells side and frame: their mean can be compared after any lossy coding."""
    columns = np.arange(rig.width, dtype=np.float64) * (1.0 if side == "left" else 0.5)
    row = (40 + 10 * index + columns).astype(np.uint8)
    return np.tile(row, (rig.height, 1))


def make_bag(path: Path, cameras, n_frames=3, kind="mcap", rig=RIG, other_topics=(), first=0):
    """Write a recording and return what to open: a folder, or a file for ROS 1.

    Frames are numbered from ``first`` on; their pictures and stamps go by the number.
    """
    if kind == "mcap-lz4":
        return _make_lz4(path, cameras, n_frames, rig, first)
    ros1 = kind.startswith("ros1")
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    writer = Writer1(path.with_suffix(".bag")) if ros1 else _writer2(path, kind)
    if kind in ("ros1-lz4", "ros1-bz2"):
        writer.set_compression(Writer1.CompressionFormat[kind[5:].upper()])
    with writer:
        connections = {}
        for topic, msgtype in dict.fromkeys([*_topics(cameras), *other_topics]):  # two may share a topic
            connections[topic] = writer.add_connection(topic, msgtype, typestore=types)
        for index in range(first, first + n_frames):
            for camera in cameras:
                stamp_ns = FIRST_NS + index * PERIOD_NS
                for topic, message in _messages(types, camera, index, stamp_ns, rig, ros1):
                    msgtype = connections[topic].msgtype
                    data = (types.serialize_ros1 if ros1 else types.serialize_cdr)(message, msgtype)
                    delay_ns = camera.info_delay_ns if topic == camera.info else 0
                    writer.write(connections[topic], stamp_ns + delay_ns, data)
    return path.with_suffix(".bag") if ros1 else path


def make_split_bag(path: Path, cameras, kind="mcap", n_files=2, n_frames=3, rig=RIG):
    """Write a recording of several storage files, as a recorder with a size limit does."""
    merged = None
    for index in range(n_files):
        part = make_bag(
            path.with_name(f"{path.name}_{index}"), cameras, n_frames, kind, first=index * n_frames
        )
        metadata = yaml.safe_load((part / "metadata.yaml").read_text())
        (part / "metadata.yaml").unlink()
        content = metadata["rosbag2_bagfile_information"]
        if merged is None:
            merged = metadata
            part.rename(path)
            continue
        whole = merged["rosbag2_bagfile_information"]
        for name in content["relative_file_paths"]:
            (part / name).rename(path / name)
        part.rmdir()
        whole["relative_file_paths"] += content["relative_file_paths"]
        whole["message_count"] += content["message_count"]
        whole["duration"]["nanoseconds"] += content["duration"]["nanoseconds"] + PERIOD_NS
        for one, other in zip(
            whole["topics_with_message_count"], content["topics_with_message_count"], strict=True
        ):
            one["message_count"] += other["message_count"]
    (path / "metadata.yaml").write_text(yaml.safe_dump(merged))
    return path


def _make_lz4(path, cameras, n_frames, rig, first):
    """Write an MCAP file with lz4 chunks and without a summary, which no writer here can."""
    types = get_typestore(Stores.ROS2_JAZZY)

    def text(value):
        return struct.pack("<I", len(value)) + value

    def record(code, content):
        return bytes([code]) + struct.pack("<Q", len(content)) + content

    channels, chunks = b"", b""
    numbers = {}
    for number, (topic, msgtype) in enumerate(_topics(cameras), 1):
        numbers[topic] = number, msgtype
        definition = types.generate_msgdef(msgtype, ros_version=2)[0].encode()
        schema = struct.pack("<H", number) + text(msgtype.encode()) + text(b"ros2msg") + text(definition)
        channel = struct.pack("<HH", number, number) + text(topic.encode()) + text(b"cdr") + text(b"")
        channels += record(3, schema) + record(4, channel)
    for index in range(first, first + n_frames):
        stamp_ns = FIRST_NS + index * PERIOD_NS
        content = channels if index == first else b""
        for camera in cameras:
            for topic, message in _messages(types, camera, index, stamp_ns, rig, False):
                number, msgtype = numbers[topic]
                head = struct.pack("<HIQQ", number, index, stamp_ns, stamp_ns)
                content += record(5, head + types.serialize_cdr(message, msgtype))
        packed = lz4.frame.compress(content)
        head = struct.pack("<QQQI", stamp_ns, stamp_ns, len(content), 0)
        chunks += record(6, head + text(b"lz4") + struct.pack("<Q", len(packed)) + packed)
    magic = b"\x89MCAP0\r\n"
    end = record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0))
    path.mkdir()
    file = path / f"{path.name}.mcap"
    file.write_bytes(magic + record(1, text(b"ros2") + text(b"tests")) + chunks + end + magic)
    return path


def _writer2(path, kind):
    storage, _, mode = kind.partition("-")
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer2(path, version=9, storage_plugin=plugin)
    modes = {
        "chunks": CompressionMode.STORAGE,
        "messages": CompressionMode.MESSAGE,
        "file": CompressionMode.FILE,
    }
    if mode:
        writer.set_compression(modes[mode], CompressionFormat.ZSTD)
    return writer


def _topics(cameras):
    for camera in cameras:
        if camera.image:
            yield camera.image, f"sensor_msgs/msg/{'CompressedImage' if camera.compressed else 'Image'}"
        if camera.info:
            yield camera.info, "sensor_msgs/msg/CameraInfo"


def _messages(types, camera, index, stamp_ns, rig, ros1):
    sec, nanosec = divmod(stamp_ns + camera.stamp_shift_ns, NS_PER_S)
    stamp = types.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    seq = {"seq": index} if ros1 else {}
    header = types.types["std_msgs/msg/Header"](stamp=stamp, frame_id=camera.side, **seq)
    changes = camera.info_of(index)
    if camera.info and changes is not None:
        yield camera.info, camera_info(types, camera, header, rig, ros1, changes)
    if index in camera.lost:
        return
    if camera.image and camera.compressed:
        if isinstance(camera.compressed, bytes):
            content = np.frombuffer(camera.compressed, np.uint8)
        else:
            _, content = cv2.imencode(f".{camera.compressed}", picture(camera.side, index, rig))
        kind = types.types["sensor_msgs/msg/CompressedImage"]
        yield (
            camera.image,
            kind(header=header, format=f"mono8; {camera.compressed!s:.10} compressed ", data=content),
        )
    elif camera.image:
        pixels = picture(camera.side, index, rig)
        if camera.encoding == "bgr8":
            pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
        elif camera.encoding == "mono16":  # of a camera of 12 bits
            pixels = (pixels.astype("<u2") * 16).view(np.uint8)
        step = pixels.strides[0]
        yield (
            camera.image,
            types.types["sensor_msgs/msg/Image"](
                header=header,
                height=rig.height,
                width=rig.width,
                encoding=camera.encoding,
                is_bigendian=0,
                step=step - 1 if camera.step_too_small else step,
                data=pixels.reshape(-1),
            ),
        )


def camera_info(types, camera, header, rig, ros1, changes):
    shift = -rig.fx * rig.baseline_m if camera.side == "right" else 0.0
    values = {
        "distortion_model": "plumb_bob",
        "binning_x": 0,
        "binning_y": 0,
        "d": np.zeros(5),
        "k": np.array([rig.fx, 0, rig.cx, 0, rig.fy, rig.cy, 0, 0, 1.0]),
        "r": np.eye(3).reshape(-1),
        "p": np.array([rig.fx, 0, rig.cx, shift, 0, rig.fy, rig.cy, 0, 0, 0, 1.0, 0]),
    } | camera.info_changes
    values |= changes
    region = types.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return types.types["sensor_msgs/msg/CameraInfo"](
        header=header,
        height=rig.height,
        width=rig.width,
        roi=region,
        **{(name.upper() if ros1 and len(name) == 1 else name): value for name, value in values.items()},
    )
