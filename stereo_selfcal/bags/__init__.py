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
