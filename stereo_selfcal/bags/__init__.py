"""Stereo pairs from recordings: rosbag2 (sqlite3, mcap) and ROS 1 bags, read without a ROS graph."""

from .errors import BagError
from .reader import StereoBag, StereoFrame

__all__ = ["BagError", "StereoBag", "StereoFrame"]
