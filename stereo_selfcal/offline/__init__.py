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

"""Calibration of recordings: where the frames come from, the work over all of them, what stays of each.

Neither ROS nor a command line is in here: ``replay``, the report and the fleet call
:func:`calibrate_recording` alike.
"""

from ..bags import Selection
from .bag import BagSource
from .csv_table import as_csv
from .folder import FolderSource
from .opening import open_source
from .pool import WorkerError, default_jobs
from .progress import ProgressPoint
from .recording import FrameSource
from .rows import AttemptSummary, FrameRow
from .run import Replay, calibrate_recording, look_again
from .until_good import Goal

__all__ = [
    "AttemptSummary",
    "BagSource",
    "FolderSource",
    "FrameRow",
    "FrameSource",
    "Goal",
    "ProgressPoint",
    "Replay",
    "Selection",
    "WorkerError",
    "as_csv",
    "calibrate_recording",
    "default_jobs",
    "look_again",
    "open_source",
]
