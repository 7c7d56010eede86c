"""Stereo pairs from recordings: rosbag2 (sqlite3, mcap) and ROS 1 bags, read without a ROS graph."""

from .errors import BagError
from .reader import StereoBag, StereoFrame
from .selection import Selection

__all__ = ["BagError", "Selection", "StereoBag", "StereoFrame"]
