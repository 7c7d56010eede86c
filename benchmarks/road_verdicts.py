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

"""What the calibrator and its peer make of stereo pairs, and how that is judged."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TypeVar

import cv2
import numpy as np

from stereo_selfcal import CalibrationResult, Calibrator

from .frames import READABLE, Array
from .road_pairs import RoadPair
from .road_peer import peer_pose
from .worlds import GROSS, WRONG, WRONG_SIGMAS

# A result that differs by no more standard deviations, of its own and of the reference together, is right.
RIGHT_SIGMAS = 3.0
# Factor between the median of absolute values and the standard deviation of a normal distribution.
MAD_TO_STD = 1.4826

_NOTHING = np.empty(0)
_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")


@dataclass(frozen=True, slots=True, eq=False)
class RoadVerdict:
    """What became of one pair. Poses are height [mm], pitch and roll [deg].

    Attributes:
        source: The set it belongs to.
        name: Of the pair.
        tag: What kind of road it shows.
        expected: "accepted", "welcome" or "refused".
        reason: Why it was refused; empty where it was accepted.
        pose: The estimate; empty when refused.
        std: Its standard deviations; empty when refused.
        low: Least pose by the reference.
        high: Greatest pose by the reference.
        reference_std: Standard deviations of the reference.
        stage: The last stage that ran.
        message: What the calibrator said.
        cpu_s: Processor time of the calibration [s].
        peer: The peer's estimate; empty where it has none.
        peer_cpu_s: Processor time of the peer [s].
    """

    source: str
    name: str
    tag: str
    expected: str
    reason: str
    pose: Array
    std: Array
    low: Array
    high: Array
    reference_std: Array
    stage: str = ""
    message: str = ""
    cpu_s: float = 0.0
    peer: Array = field(default_factory=_NOTHING.copy)
    peer_cpu_s: float = 0.0

    @property
    def accepted(self) -> bool:
        """Whether there is a result."""
        return not self.reason

    @property
    def error(self) -> Array:
        """How far the estimate lies outside of the reference, with its sign; empty when refused."""
        return outside(self.pose, self.low, self.high)

    @property
    def peer_error(self) -> Array:
        """The same of the peer."""
        return outside(self.peer, self.low, self.high)

    @property
    def sigmas(self) -> Array:
        """The error over the standard deviations of estimate and reference together; NaN where unknown."""
        if not self.accepted:
            return _NOTHING
        sigmas: Array = self.error / np.hypot(self.std, self.reference_std)
        sigmas[~np.isfinite(self.reference_std)] = np.nan
        return sigmas

    @property
    def wrong(self) -> bool:
        """Whether it was accepted and is wrong, by its own measure and by an absolute one."""
        if not self.accepted:
            return False
        return bool(np.any((np.abs(self.sigmas) > WRONG_SIGMAS) & (np.abs(self.error) > WRONG)))

    @property
    def gross(self) -> bool:
        """Whether it was accepted and is grossly wrong, whatever it said of itself."""
        return self.accepted and is_gross(self.error, self.reference_std)

    @property
    def peer_gross(self) -> bool:
        """The same of the peer."""
        return bool(len(self.peer)) and is_gross(self.peer_error, self.reference_std)

    @property
    def at_fault(self) -> bool:
        """Whether it is not what was expected of the pair."""
        unexpected = self.expected == ("refused" if self.accepted else "accepted")
        return unexpected or self.wrong or self.gross

    @property
    def word(self) -> str:
        """The verdict in a word."""
        if not self.accepted:
            return "refused"
        if self.gross:
            return "gross"
        if self.wrong:
            return "wrong"
        if not np.isfinite(self.sigmas).any():
            return "accepted"  # it cannot be judged
        return "right" if np.nanmax(np.abs(self.sigmas)) <= RIGHT_SIGMAS else "off"


def outside(pose: Array, low: Array, high: Array) -> Array:
    """Return how far a pose lies outside of a range: 0 within, NaN where the range is unknown."""
    if not len(pose):
        return _NOTHING
    away: Array = pose - np.clip(pose, low, high)
    return away


def is_gross(error: Array, reference_std: Array) -> bool:
    """Return whether an error is so large that no standard deviation of the estimate excuses it."""
    return bool(np.any((np.abs(error) > GROSS) & np.isfinite(reference_std)))


def judge(pair: RoadPair, with_peer: bool = True) -> RoadVerdict:
    """Calibrate one pair, and ask the peer."""
    calibrator = Calibrator(pair.rig)
    start = time.thread_time()
    result = calibrator.add(pair.left, pair.right)
    cpu_s = time.thread_time() - start
    peer, peer_cpu_s = None, 0.0
    if with_peer:
        start = time.thread_time()
        peer = peer_pose(pair.left, pair.right, pair.rig)
        peer_cpu_s = time.thread_time() - start
    seen = verdict_of(pair, result)
    return replace(seen, cpu_s=cpu_s, peer=_NOTHING if peer is None else peer, peer_cpu_s=peer_cpu_s)


def verdict_of(pair: RoadPair, result: CalibrationResult) -> RoadVerdict:
    """Return the verdict of a pair that was calibrated, without its peer and its times."""
    pose, std = _NOTHING, _NOTHING
    if result.extrinsics is not None and result.std is not None:
        pose, std = result.extrinsics.as_array() * READABLE, result.std.as_array() * READABLE
    return RoadVerdict(
        pair.source,
        pair.name,
        pair.tag,
        pair.expected,
        str(result.reason or ""),
        pose,
        std,
        pair.low,
        pair.high,
        pair.reference_std,
        list(result.stages)[-1] if result.stages else "",
        result.message,
    )


def in_processes(
    work: Callable[[_Task], _Answer], tasks: Iterable[_Task], processes: int
) -> Iterator[_Answer]:
    """Yield the answers in the order of the tasks, worked out in processes with one thread each."""
    if processes == 1:
        yield from map(work, tasks)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(processes, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        yield from pool.imap(work, tasks)


def rms_of(values: Array) -> Array:
    """Return the root of the mean square of every column, leaving out what is unknown."""
    root: Array = np.sqrt(np.nanmean(np.square(values), axis=0))
    return root


def robust_std_of(values: Array) -> Array:
    """Return the standard deviation of every column about 0 by its median, leaving out what is unknown."""
    robust: Array = MAD_TO_STD * np.nanmedian(np.abs(values), axis=0)
    return robust
