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

"""Calls of ~/calibrate for tests: parameters that any frame is good enough for, and scripted calls."""

import time
from collections import deque
from types import SimpleNamespace

from stereo_selfcal.core.camera.pairing import PairCounts, StampedPair
from stereo_selfcal.core.camera.stamp_pattern import NoPairCause, StampPattern
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.files.node_settings import TARGET_NAMES
from stereo_selfcal.ros.call_progress import CallProgress
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.pair_source import InputState, Topics

# With these, a call ends with its first `frames` accepted frames.
ANY_STD = dict.fromkeys(TARGET_NAMES, 0.0)

RIG = {"width": 4, "height": 3, "fx": 5.0, "fy": 5.0, "cx": 1.5, "cy": 1.0, "baseline_m": 0.2}
ARRIVED = PairCounts(10, 10)
TOPICS = Topics("/left/image_rect", "/right/image_rect", "/left/camera_info", "/right/camera_info")

TOO_FEW = StampPattern(NoPairCause.TOO_FEW)


def config(**changes):
    values = {name: setting.default for name, setting in SETTINGS.items()}
    values.update({"timeout_s": 0.2, **ANY_STD, **{f"rig.{name}": value for name, value in RIG.items()}})
    values.update({name.replace("__", "."): value for name, value in changes.items()})
    return NodeConfig.from_values(values)


def image(value=100, encoding="mono8", step=4):
    return SimpleNamespace(
        data=bytes([value]) * 12, width=4, height=3, step=step, encoding=encoding, is_bigendian=0
    )


def pair(stamp_ns=0, left=None, right=None):
    return StampedPair(left or image(), right or image(), stamp_ns, stamp_ns)


class Source:
    """A camera that delivers ``pairs``, one per request, and then nothing."""

    def __init__(self, *pairs, counts=ARRIVED, pattern=TOO_FEW, infos=(None, None), mismatches=()):
        self.pattern = pattern
        self.topics = TOPICS
        self.camera_infos = infos
        self.states = deque([InputState(ARRIVED, None), InputState(counts, None, mismatches)])
        self.pairs = deque(pairs)
        self.stopped = False

    @property
    def state(self):
        return self.states.popleft() if len(self.states) > 1 else self.states[0]

    def camera_infos_of(self, _pair):
        return self.camera_infos

    def publishers(self, topic):
        return 1 if "left" in topic else 0

    def next_pair(self, timeout_s):
        assert timeout_s >= 0
        return self.pairs.popleft() if self.pairs else None


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
