"""Calls of ~/calibrate for tests: parameters that any frame is good enough for, and scripted calls."""

import time

from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.ros.call_progress import CallProgress

# With these, a call ends with its first `frames` accepted frames.
ANY_STD = {"target_height_std_m": 0.0, "target_pitch_std_rad": 0.0, "target_roll_std_rad": 0.0}


def scripted_calls(next_outcome):
    """Return a class of calls that end at once with what a function returns."""

    class ScriptedCall:
        cancelled = False

        def __init__(self, *_):
            self.begun_s = time.monotonic()

        def cancel(self):
            self.cancelled = True

        @property
        def progress(self):
            return CallProgress(0, 0, time.monotonic() - self.begun_s, 60.0, Targets())

        def run(self):
            return next_outcome()

    return ScriptedCall
