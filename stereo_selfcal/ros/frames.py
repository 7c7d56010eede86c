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

"""What CameraInfo calls the cameras now, and which frame a picture of the left one has."""

from __future__ import annotations

from ..core.geometry.homography import SIDES
from ..files.frames import InfoFrames, bare, name_camera
from .config import NodeConfig
from .inputs import StereoInput


def info_frames(source: StereoInput, config: NodeConfig) -> InfoFrames | None:
    """Return what CameraInfo calls the cameras; None before both have come.

    Where ``rig.*`` stands in its place, the images say it.

    Args:
        source: Where CameraInfo and images come from.
        config: Parameters of the node.
    """
    if config.rig:
        formats = source.formats
        left_frame, right_frame = (bare(formats[side].frame_id) if side in formats else "" for side in SIDES)
        return InfoFrames(left_frame, right_frame, of_rig=True)
    left, right = source.camera_infos
    return None if left is None or right is None else InfoFrames.of_messages(left, right)


def camera_frame(source: StereoInput, config: NodeConfig) -> str:
    """Return the name of the camera's frame, for pictures and reports; "" where it has none.

    Args:
        source: Where CameraInfo and images come from.
        config: Parameters of the node.
    """
    return name_camera(config.frame_names, info_frames(source, config) or InfoFrames()).name
