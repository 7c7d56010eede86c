"""Stereo pairs from recordings: rosbag2 (sqlite3, mcap) and ROS 1 bags, read without a ROS graph."""

from .errors import BagError
from .frame import StereoFrame, readable
from .part import RECORDING_SUFFIXES
from .reader import StereoBag, stereo_pairs
from .regular_file import open_regular
from .selection import Selection
from .topics import StereoTopics

__all__ = [
    "RECORDING_SUFFIXES",
    "BagError",
    "Selection",
    "StereoBag",
    "StereoFrame",
    "StereoTopics",
    "open_regular",
    "readable",
    "stereo_pairs",
]
