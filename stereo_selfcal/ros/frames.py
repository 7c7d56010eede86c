"""What CameraInfo calls the cameras now, and which frame a picture of the left one has. Needs no ROS."""

from __future__ import annotations

from ..files.frames import InfoFrames, name_camera
from .config import NodeConfig
from .pair_source import PairSource


def info_frames(source: PairSource, config: NodeConfig) -> InfoFrames | None:
    """Return what CameraInfo calls the cameras; None before both have come.

    Args:
        source: Where CameraInfo comes from.
        config: Parameters of the node.
    """
    if config.rig:
        return InfoFrames(of_rig=True)
    left, right = source.camera_infos
    return None if left is None or right is None else InfoFrames.of_messages(left, right)


def camera_frame(source: PairSource, config: NodeConfig) -> str:
    """Return the name of the camera's frame, for pictures and reports; "" where it has none.

    Args:
        source: Where CameraInfo comes from.
        config: Parameters of the node.
    """
    return name_camera(config.frame_names, info_frames(source, config) or InfoFrames()).name
