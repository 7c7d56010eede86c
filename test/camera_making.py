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

"""Cameras of 640 x 480 px as their CameraInfo describes them, and recordings of a road seen by them."""

import math
from types import SimpleNamespace

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from stereo_selfcal.core.camera.rectifier import StereoRectifier
from stereo_selfcal.synth.bag import camera_info_message, image_message
from stereo_selfcal.synth.scenes import custom_scene

PERIOD_NS = 100_000_000
START_NS = 100_000_000_000


def cameras(fx=500.0, rectified=True, baseline_m=0.2, **changes):
    """Return two cameras; changes are those of fields of both CameraInfo."""
    infos = []
    for side in ("left", "right"):
        k = [fx, 0, 319.5, 0, fx, 239.5, 0, 0, 1]
        p = [fx, 0, 319.5, -fx * baseline_m if side == "right" else 0.0, 0, fx, 239.5, 0, 0, 0, 1, 0]
        values = {"k": k, "p": p, "d": [], "r": np.eye(3).ravel(), "distortion_model": "plumb_bob"}
        infos.append(SimpleNamespace(**{"width": 640, "height": 480, **values, **changes}))
    return StereoRectifier.from_camera_info(*infos, rectified)


def make_road_bag(path, n_frames, fx_of=lambda index: None, seen=lambda side, pixels: pixels):
    """Write a recording of a road at 1.4 m, 3 degrees, 0.8 degrees.

    Args:
        path: Folder to make.
        n_frames: Frames; two are rendered, and take turns.
        fx_of: Returns of the number of a frame the focal length in its CameraInfo, None for the true one.
        seen: Returns the image that a camera takes of what it should see.
    """
    scene = custom_scene(height_m=1.4, pitch_rad=math.radians(3.0), roll_rad=math.radians(0.8), n_frames=2)
    rendered = [scene.frame(index) for index in range(2)]
    types = get_typestore(Stores.ROS2_JAZZY)
    header, time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            (side, kind): writer.add_connection(
                f"/stereo/{side}/{'image_rect' if kind == 'Image' else 'camera_info'}",
                f"sensor_msgs/msg/{kind}",
                typestore=types,
            )
            for side in ("left", "right")
            for kind in ("Image", "CameraInfo")
        }
        for index in range(n_frames):
            stamp_ns = START_NS + index * PERIOD_NS
            sec, nanosec = divmod(stamp_ns, 1_000_000_000)
            frame = rendered[index % 2]
            for side, pixels in (("left", seen("left", frame.left)), ("right", seen("right", frame.right))):
                head = header(stamp=time(sec=sec, nanosec=nanosec), frame_id=side)
                info = camera_info_message(scene.scene.rig, side, head)
                info.k[[0, 4]] = info.p[[0, 5]] = fx = fx_of(index) or scene.scene.rig.fx
                info.p[3] = -fx * scene.scene.rig.baseline_m if side == "right" else 0.0
                for kind, message in (("CameraInfo", info), ("Image", image_message(pixels, head))):
                    data = types.serialize_cdr(message, f"sensor_msgs/msg/{kind}")
                    writer.write(connections[side, kind], stamp_ns, data)
    return path
