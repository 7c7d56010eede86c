"""Calibration of recordings: where the frames come from, the work over all of them, what stays of each.

Neither ROS nor a command line is in here: ``replay``, the report and the fleet call
:func:`calibrate_recording` alike.
"""

from ..bags import Selection
from .bag import BagSource
from .recording import FrameSource
from .rows import FrameRow
from .run import Replay, calibrate_recording, look_again

__all__ = [
    "BagSource",
    "FrameRow",
    "FrameSource",
    "Replay",
    "Selection",
    "calibrate_recording",
    "look_again",
]
