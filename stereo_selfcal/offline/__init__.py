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
    "Replay",
    "Selection",
    "WorkerError",
    "as_csv",
    "calibrate_recording",
    "default_jobs",
    "look_again",
    "open_source",
]
