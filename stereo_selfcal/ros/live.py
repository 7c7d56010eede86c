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

"""Single current frames, for the watch, the road and pictures, while no call of ``~/calibrate`` has them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from ..core.camera.bit_depth import BitDepth
from ..core.camera.frozen import refuse_frozen
from ..core.camera.image_messages import message_to_grey
from ..core.camera.pairing import StampedPair
from ..core.camera.rig import StereoRig
from ..core.errors import ImageError, RigError
from ..core.faults import Fault
from ..core.rejection import Rejection
from ..core.types import Image
from .config import NodeConfig
from .inputs import StereoInput
from .pair_source import PairSource, known_rectifier, no_pair_reason

# While somebody waits for a single frame, a call takes the input over after this time at most.
_SLICE_S = 0.05
_CLOCK_STEP_S = 1e-3  # a wait that ends at once must not divide by zero


@dataclass(frozen=True, slots=True, eq=False)
class LiveFrame:
    """A frame that was not calibrated.

    Attributes:
        left: (H, W) uint8 image of the left camera; rectified where the rig is known.
        right: The same of the right camera.
        rig: The rig, None as long as it is not known.
        problem: Why the rig is not known, "" otherwise.
        stamp_ns: Stamp of the frame [ns].
        refusal: Why it cannot be calibrated: a camera repeats its last image. None in any other case.
        stamp_difference_s: Stamp of the right image minus that of the left one [s].
    """

    left: Image
    right: Image
    rig: StereoRig | None
    problem: str
    stamp_ns: int
    refusal: Rejection | None = None
    stamp_difference_s: float = 0.0


@dataclass(frozen=True, slots=True)
class NoFrame:
    """Why there is no frame.

    Attributes:
        reason: One sentence.
        fault: The fault of the program that came up while it was read; None in any other case.
        stamp_ns: Stamp of the frame in which it came up [ns].
    """

    reason: str
    fault: Fault | None = None
    stamp_ns: int = 0


def known_rig(source: PairSource, config: NodeConfig) -> StereoRig | None:
    """Return the rig of the parameters or of CameraInfo, None before both have come.

    Raises:
        RigError: The rig is invalid.
    """
    rectifier = known_rectifier(source, config)
    return None if rectifier is None else rectifier.rig


def missing_info(source: PairSource) -> str:
    """Return a sentence about each CameraInfo that has not come, "" when both have."""
    infos = zip((source.topics.left_info, source.topics.right_info), source.camera_infos, strict=True)
    missing = [f"{topic} (publishers: {source.publishers(topic)})" for topic, info in infos if info is None]
    if not missing:
        return ""
    why = "; ".join(source.state.info_mismatches) or "publish it or set rig.*"
    return f"no CameraInfo on {' and '.join(missing)}: {why}"


@dataclass(slots=True, eq=False)
class _Wait:
    """A wait for a frame, which others may share.

    Attributes:
        frame: What came of it, once it is over.
        over: Whether it is over.
    """

    frame: LiveFrame | NoFrame | None = None
    over: threading.Event = field(default_factory=threading.Event)


class LiveFrames:
    """Shares the input between calls, which need every frame, and users of single frames. A call goes first.

    Users who wait at the same time get the same frame.

    Args:
        source: The input.
        config: Returns the parameters.
    """

    def __init__(self, source: StereoInput, config: Callable[[], NodeConfig]) -> None:
        self._source = source
        self._config = config
        self._depth = BitDepth()
        self._taking = threading.Lock()
        self._claimed = threading.Event()
        self._waits = threading.Lock()
        self._wait: _Wait | None = None  # that of the user who has the input, or will have it next
        self._open = False  # whether the input goes on between single frames; of who takes

    @contextmanager
    def all(self) -> Iterator[StereoInput]:
        """Take the input over for a call; its frames arrive from now on. One thread at a time."""
        self._claimed.set()
        with self._taking:
            self._end()
            self._source.begin()
            try:
                yield self._source
            finally:
                self._source.end()
                self._claimed.clear()

    def close(self) -> None:
        """End the input that goes on for whoever takes one frame after the other."""
        with self._taking:
            self._end()
            with self._waits:
                wait, self._wait = self._wait, None
        if wait is not None:  # of users who wait for the next frame of this one
            wait.over.set()

    def next(self, timeout_s: float) -> LiveFrame | NoFrame | None:
        """Wait for the newest frame after the one before; as :meth:`one`, but the input goes on.

        So no frame is lost while the one before is looked at. It goes on until :meth:`close`.

        Args:
            timeout_s: How long to wait [s].
        """
        return self.one(timeout_s, go_on=True)

    def one(self, timeout_s: float, *, go_on: bool = False) -> LiveFrame | NoFrame | None:
        """Wait for a frame and return it, or why there is none; None when a call has or takes the input.

        Args:
            timeout_s: How long to wait [s].
            go_on: Whether the input goes on until :meth:`close`.
        """
        end_s = time.monotonic() + timeout_s
        while not (self._claimed.is_set() or self._source.stopped):
            with self._waits:
                # Where the input goes on for another user, that one's next frame is this one's, too.
                theirs = self._open and not go_on
                mine = not theirs and self._taking.acquire(blocking=False)
                if mine or theirs:
                    self._wait = self._wait or _Wait()
                wait = self._wait
            if wait is None:  # a call has the input, whose claim has just ended
                return None
            if mine:
                return self._take(wait, timeout_s, go_on)
            self._share(wait, end_s)
            if isinstance(wait.frame, LiveFrame) or time.monotonic() >= end_s:
                return wait.frame
            timeout_s = max(0.0, end_s - time.monotonic())  # of another user, whose patience was shorter
        return None

    def _take(self, wait: _Wait, timeout_s: float, go_on: bool) -> LiveFrame | NoFrame | None:
        """Take the input for one frame, and hand what comes to everybody who waits."""
        try:
            wait.frame = self._next(timeout_s, go_on)
            return wait.frame
        finally:
            with self._waits:
                self._wait = None
                self._taking.release()
            wait.over.set()

    def _share(self, wait: _Wait, end_s: float) -> None:
        """Wait until another user's wait is over, or nobody is to wait any more, or time is up."""
        while not wait.over.wait(min(_SLICE_S, max(0.0, end_s - time.monotonic()))):
            if self._claimed.is_set() or self._source.stopped or time.monotonic() >= end_s:
                return

    def _next(self, timeout_s: float, go_on: bool) -> LiveFrame | NoFrame | None:
        start_s, before = time.monotonic(), self._source.state.counts
        go_on |= self._open
        if not self._open:
            self._source.begin()
        self._open = True
        try:
            while not self._claimed.is_set() and not self._source.stopped:
                pair = self._newest_pair()
                if pair is not None:
                    return self._read_or_refuse(pair)
                elapsed_s = time.monotonic() - start_s
                if elapsed_s >= timeout_s:
                    elapsed_s = max(elapsed_s, _CLOCK_STEP_S)
                    return NoFrame(no_pair_reason(self._source, self._config(), before, elapsed_s))
            return None
        finally:
            if not go_on or self._claimed.is_set():
                self._end()

    def _newest_pair(self) -> StampedPair[Any] | None:
        """Wait a little for a pair; return the newest where several have come."""
        pair = self._source.next_pair(_SLICE_S)
        newer = pair
        while newer is not None:
            pair, newer = newer, self._source.next_pair(0.0)
        return pair

    def _end(self) -> None:
        """End the input, if it is open; to be called by who takes."""
        if self._open:
            self._open = False
            self._source.end()

    def _read_or_refuse(self, pair: StampedPair[Any]) -> LiveFrame | NoFrame:
        try:
            return self._read(pair)
        except Exception as error:  # noqa: BLE001  (whatever it is, the next frames are read)
            fault = Fault.of(error)
            return NoFrame(fault.rejection.message, fault, pair.stamp_ns)

    def _read(self, pair: StampedPair[Any]) -> LiveFrame | NoFrame:
        rectifier, problem, stamp_ns = None, "", pair.stamp_ns
        try:
            rectifier = known_rectifier(self._source, self._config(), pair)
            problem = "" if rectifier is not None else missing_info(self._source)
        except RigError as error:
            problem = str(error)
        size = None if rectifier is None else (rectifier.rig.width, rectifier.rig.height)
        grey = []
        for topic, message in zip(self._source.topics[:2], (pair.left, pair.right), strict=True):
            try:
                grey.append(message_to_grey(message, size))
            except ImageError as error:
                return NoFrame(f"{topic}: {error}")
        images = self._depth.to_8_bits(grey[0], grey[1])
        if rectifier is None:
            return LiveFrame(*images, None, problem, stamp_ns)
        refusal = refuse_frozen(pair.frozen, *images, since=True)
        rectifier = rectifier.for_images(*images)
        return LiveFrame(*rectifier.apply(*images), rectifier.rig, "", stamp_ns, refusal, pair.difference_s)
