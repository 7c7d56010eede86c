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

"""Writes synthetic scenes as rosbag2 folders, with their truth beside the images.

Nothing of the clock, the machine or the user goes into a bag: same scene, same bytes (with the
same releases of rosbags, numpy and OpenCV).
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
import yaml
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ..core.camera.rig import StereoRig
from ..core.errors import SelfcalError
from .scenes import NAMED_SCENES, NamedScene, RenderedPair

Storage = Literal["mcap", "sqlite3"]
STORAGES: tuple[Storage, ...] = get_args(Storage)

NAMESPACE = "/stereo"
SIDES = ("left", "right")

# Inside the folder, so that it moves with the bag; ros2 bag and rosbags look at metadata.yaml only.
TRUTH_FILE = "truth.yaml"

_TRUTH_HEADER = """\
# Truth of this synthetic bag (SI units, radians): what a calibration should find.
# p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height_m]   (REP-103: x forward, y left, z up)
# expected: "calibrated", or the reason for which a calibration has to be refused.
"""

_METADATA_VERSION: Literal[9] = 9  # of ROS 2 Jazzy
_NS_PER_S = 1_000_000_000

_types = get_typestore(Stores.ROS2_JAZZY)


class BagWriteError(SelfcalError):
    """A bag cannot be written to its folder. The existing files there are unchanged."""


@dataclass(frozen=True, slots=True)
class SyntheticBag:
    """What a recording holds beside its images.

    Attributes:
        rig: The rig its images come from.
        truth: What a calibration should find, as plain values.
        jpeg_percent: Quality of its JPEG images; None where images are not compressed.
        storage: Storage of the messages; mcap is compressed, sqlite3 is not.
    """

    rig: StereoRig
    truth: Mapping[str, Any]
    jpeg_percent: int | None = None
    storage: Storage = "mcap"

    @classmethod
    def of(cls, scene: NamedScene, storage: Storage) -> SyntheticBag:
        """Return that of a scene."""
        return cls(scene.scene.rig, scene.truth(), storage=storage)


def write_bag(
    path: Path,
    scene: NamedScene,
    storage: Storage = "mcap",
    on_frame: Callable[[int], None] = lambda done: None,
) -> None:
    """Write a scene as a bag; it appears under its name only when it is complete.

    Args:
        path: Folder to make.
        scene: The scene to render.
        storage: Storage of the messages; mcap is compressed, sqlite3 is not.
        on_frame: Called with the number of frames after each of them.

    Raises:
        BagWriteError: Something is there already, or the folder around it is not.
    """
    write_recording(path, SyntheticBag.of(scene, storage), scene.frames(), on_frame)


def write_recording(
    path: Path,
    bag: SyntheticBag,
    frames: Iterable[RenderedPair],
    on_frame: Callable[[int], None] = lambda done: None,
) -> None:
    """Write frames as a bag; it appears under its name only when it is complete.

    Args:
        path: Folder to make.
        bag: What it holds beside its images.
        frames: The frames, in the order of time.
        on_frame: Called with the number of frames after each of them.

    Raises:
        BagWriteError: Something is there already, or the folder around it is not.
    """
    if path.exists() or path.is_symlink():
        raise BagWriteError(
            f"{path}: exists already and is not overwritten; choose another name or remove it"
        )
    _replace(path, bag, frames, on_frame)


def write_named_bags(folder: Path, scenes: Iterable[NamedScene] = NAMED_SCENES) -> Iterator[Path]:
    """Write one bag per scene into ``folder``, in place of the bag of that name; yield each path.

    Raises:
        BagWriteError: A file or folder with the name of a scene exists, and is no synthetic bag.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for scene in scenes:
        path = folder / scene.name
        if path.exists() and not (path / TRUTH_FILE).is_file():
            raise BagWriteError(f"{path}: is no synthetic bag and is not replaced; move it away")
        _replace(path, SyntheticBag.of(scene, "mcap"), scene.frames(), lambda done: None)
        yield path


def _replace(
    path: Path, bag: SyntheticBag, frames: Iterable[RenderedPair], on_frame: Callable[[int], None]
) -> None:
    """Write the bag to a temporary folder beside its final one, and move it there."""
    if not path.parent.is_dir():
        raise BagWriteError(f"{path}: there is no folder {path.parent} to write into")
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".synth-") as temporary:
        made = Path(temporary, path.name)  # the folder's name is that of the storage file in it
        _write_messages(made, bag, frames, on_frame)
        truth = yaml.safe_dump(dict(bag.truth), sort_keys=False, default_flow_style=None, width=100)
        (made / TRUTH_FILE).write_text(_TRUTH_HEADER + truth, encoding="utf-8")
        if path.is_dir():
            shutil.rmtree(path)
        made.replace(path)


def _write_messages(
    path: Path, bag: SyntheticBag, frames: Iterable[RenderedPair], on_frame: Callable[[int], None]
) -> None:
    plugin = StoragePlugin.MCAP if bag.storage == "mcap" else StoragePlugin.SQLITE3
    writer = Writer(path, version=_METADATA_VERSION, storage_plugin=plugin)
    if plugin is StoragePlugin.MCAP:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    rig, jpeg_percent = bag.rig, bag.jpeg_percent
    of_images = (
        ("image_rect", "Image") if jpeg_percent is None else ("image_rect/compressed", "CompressedImage")
    )
    with writer:
        images, infos = (
            {side: _add_topic(writer, f"{NAMESPACE}/{side}/{name}", kind) for side in SIDES}
            for name, kind in (of_images, ("camera_info", "CameraInfo"))
        )
        for done, frame in enumerate(frames, start=1):
            stamp_ns = round(frame.stamp_s * _NS_PER_S)
            for side, pixels in zip(SIDES, (frame.left, frame.right), strict=True):
                header = _header(stamp_ns, side)
                for connection, message in (
                    (infos[side], camera_info_message(rig, side, header)),
                    (
                        images[side],
                        image_message(pixels, header)
                        if jpeg_percent is None
                        else jpeg_message(pixels, header, jpeg_percent),
                    ),
                ):
                    data = _types.serialize_cdr(message, connection.msgtype)
                    writer.write(connection, stamp_ns, data)
            on_frame(done)


def _add_topic(writer: Writer, topic: str, kind: str) -> Connection:
    return writer.add_connection(topic, f"sensor_msgs/msg/{kind}", typestore=_types)


def _header(stamp_ns: int, side: str) -> Any:
    sec, nanosec = divmod(stamp_ns, _NS_PER_S)
    stamp = _types.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return _types.types["std_msgs/msg/Header"](stamp=stamp, frame_id=f"stereo_{side}_optical")


def image_message(pixels: np.ndarray[Any, np.dtype[np.uint8]], header: Any) -> Any:
    """Return a mono8 sensor_msgs/Image of ``pixels``, (H, W)."""
    height, width = pixels.shape
    return _types.types["sensor_msgs/msg/Image"](
        header=header,
        height=height,
        width=width,
        encoding="mono8",
        is_bigendian=0,
        step=width,
        data=np.ascontiguousarray(pixels).reshape(-1),
    )


def jpeg_message(pixels: np.ndarray[Any, np.dtype[np.uint8]], header: Any, percent: int) -> Any:
    """Return a sensor_msgs/CompressedImage of ``pixels``, (H, W), as JPEG of a quality [%]."""
    # Progressive: the same pixels in a few per cent less.
    how = [cv2.IMWRITE_JPEG_QUALITY, percent, cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
    encoded, data = cv2.imencode(".jpg", pixels, how)
    assert encoded, "OpenCV has JPEG"
    return _types.types["sensor_msgs/msg/CompressedImage"](
        header=header, format="mono8; jpeg compressed mono8", data=data.reshape(-1)
    )


def camera_info_message(rig: StereoRig, side: str, header: Any) -> Any:
    """Return the sensor_msgs/CameraInfo of one camera of a rectified rig without distortion."""
    # REP 104: P[0, 3] of the right camera is -fx * baseline, that of the left one zero.
    shift = -rig.fx * rig.baseline_m if side == "right" else 0.0
    k = [rig.fx, 0.0, rig.cx, 0.0, rig.fy, rig.cy, 0.0, 0.0, 1.0]
    p = [rig.fx, 0.0, rig.cx, shift, 0.0, rig.fy, rig.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    region = _types.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return _types.types["sensor_msgs/msg/CameraInfo"](
        header=header,
        height=rig.height,
        width=rig.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array(k),
        r=np.eye(3).reshape(-1),
        p=np.array(p),
        binning_x=0,
        binning_y=0,
        roi=region,
    )
