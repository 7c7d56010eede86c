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

"""Calibration of frames by several processes. The results have the order and the values of one process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import resource_tracker

import cv2

from ..bags import StereoFrame
from ..blas import one_thread
from ..core.calibrator import Calibrator
from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.drive.travel import MotionSince
from ..core.errors import SelfcalError
from ..core.results import CalibrationResult
from ..core.search.parts_of_time import part_of
from ..search_path import SAFE_PATH
from .frame import FrameCalibrator, FrameHead

# A worker is ready after about a second, in which as many frames are done here. Recordings of at most twice
# as many do not pay for processes.
_ALONE_FRAMES = 12
# Frames that wait for a free worker, each, and at least one stretch more than there are workers: none of them
# idles, and few frames are in memory.
_AHEAD = 3
# The C library gives memory back after every frame and asks for it again, page by page: a tenth of the time
# of a frame. Workers keep it: arrays of up to 32 MiB (glibc takes no more), 256 MiB in all.
_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(32 * 2**20), "MALLOC_TRIM_THRESHOLD_": str(256 * 2**20)}


# What a terminal or a service manager sends to all processes of a program, to end it.
_OURS = {signal.SIGINT, signal.SIGHUP, signal.SIGTERM}


class WorkerError(SelfcalError):
    """A worker process ended before its work was done. The message is one line."""


def default_jobs() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def calibrate_in_order(
    frames: Iterator[StereoFrame], calibrator: Calibrator, jobs: int, expected: int | None = None
) -> Generator[tuple[FrameHead, CalibrationResult], None, None]:
    """Yield the result of every frame, in their order, without the points behind it.

    Reading goes on here while the workers calibrate. Frames that may start from each other, those of one part
    of the time (:class:`.KnownStarts`), go to one worker together. An error of reading is raised when the
    frames before it are done.

    Args:
        frames: Frames of the calibrator's rig.
        calibrator: Has the rig and the settings.
        jobs: Processes that calibrate; with 1 it is done here.
        expected: How many frames there are at most, None when not known.

    Raises:
        WorkerError: A worker died.
    """
    here = FrameCalibrator(calibrator)
    if jobs == 1 or (expected is not None and expected <= 2 * _ALONE_FRAMES):
        for frame in frames:
            yield FrameHead.of(frame), here.calibrate_slim(frame)
        return
    stretches = stretches_of(frames, calibrator.config)
    with _workers(jobs, calibrator.rig, calibrator.config) as workers:
        with for_workers():
            for _ in range(jobs):
                workers.submit(_get_ready)
        done = 0
        while done < _ALONE_FRAMES and (stretch := next(stretches, None)) is not None:
            done += len(stretch)
            for frame in stretch:
                yield FrameHead.of(frame), here.calibrate_slim(frame)
        yield from _by_workers(stretches, workers, jobs)


def stretches_of(frames: Iterable[StereoFrame], config: CalibratorConfig) -> Iterator[list[StereoFrame]]:
    """Yield the frames in stretches whose results do not depend on each other, each in its order.

    Args:
        frames: Frames in order.
        config: Settings.

    Raises:
        SelfcalError: The frames could not be read; those before it are yielded first.
    """
    stretch: list[StereoFrame] = []
    failure: SelfcalError | None = None
    of_stretch: int | None = None
    iterator = iter(frames)
    while failure is None:
        try:
            frame = next(iterator, None)
        except SelfcalError as error:
            frame, failure = None, error
        if frame is None:
            break
        part = part_of(frame.stamp_s, config.known.cold_every_s)
        if stretch and (part is None or part != of_stretch):
            yield stretch
            stretch = []
        stretch.append(frame)
        of_stretch = part
    if stretch:
        yield stretch
    if failure is not None:
        raise failure


_Calibrated = tuple[CalibrationResult, MotionSince | None]
_Waiting = deque[tuple[list[FrameHead], Future[list[_Calibrated]]]]


def _by_workers(
    stretches: Iterator[list[StereoFrame]], workers: ProcessPoolExecutor, jobs: int
) -> Iterator[tuple[FrameHead, CalibrationResult]]:
    waiting: _Waiting = deque()
    failure: SelfcalError | None = None
    while True:
        try:
            stretch = next(stretches, None)
        except SelfcalError as error:
            stretch, failure = None, error
        if stretch is None:
            break
        heads = [FrameHead.of(frame) for frame in stretch]
        with _death_reported(heads[0]), for_workers():
            waiting.append((heads, workers.submit(_calibrate, stretch)))
        del stretch
        while _enough(waiting, jobs) or (waiting and waiting[0][1].done()):
            yield from _next(waiting)
    while waiting:
        yield from _next(waiting)
    if failure is not None:
        raise failure


def _enough(waiting: _Waiting, jobs: int) -> bool:
    """Whether so many frames wait that no worker idles soon."""
    return len(waiting) > jobs and sum(len(heads) for heads, _ in waiting) > _AHEAD * jobs


def _next(waiting: _Waiting) -> Iterator[tuple[FrameHead, CalibrationResult]]:
    heads, future = waiting.popleft()
    with _death_reported(heads[0]):
        results = future.result()
    for head, (result, moved) in zip(heads, results, strict=True):
        yield replace(head, moved=moved), result


@contextmanager
def _death_reported(head: FrameHead) -> Iterator[None]:
    try:
        yield
    except BrokenProcessPool as error:
        raise WorkerError(
            f"a worker process died near the frame of {head.stamp_s:.3f} s: killed, or out of memory; "
            "run again with fewer --jobs"
        ) from error


@contextmanager
def _workers(jobs: int, rig: StereoRig, config: CalibratorConfig) -> Iterator[ProcessPoolExecutor]:
    # Spawned, as a fork of a process with threads may hang.
    context = multiprocessing.get_context("spawn")
    with for_workers():  # with an own mask, or starting it later would undo this one
        resource_tracker.ensure_running()
    others = set(multiprocessing.active_children())
    workers = ProcessPoolExecutor(jobs, context, _start_worker, (rig, config))
    try:
        yield workers
    except (KeyboardInterrupt, GeneratorExit):
        # Nobody wants their results any more, and on a busy machine one may need long to start.
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        raise
    finally:
        workers.shutdown(wait=True, cancel_futures=True)


@contextmanager
def for_workers() -> Iterator[None]:
    """Start processes with one thread of BLAS that keep their memory, without signals: ending them is ours.

    They inherit the variables and the mask of signals.
    """
    variables = dict(os.environ)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _OURS)
    one_thread()
    for name, value in (_MEMORY | {SAFE_PATH: "1"}).items():
        os.environ.setdefault(name, value)
    try:
        yield
    finally:
        for name in os.environ.keys() - variables.keys():
            del os.environ[name]
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_calibrator: Calibrator | None = None  # of this worker


def _start_worker(rig: StereoRig, config: CalibratorConfig) -> None:
    global _calibrator  # noqa: PLW0603  (what an initializer leaves for its tasks has no other place)
    _calibrator = Calibrator(rig, config)
    cv2.setNumThreads(1)  # the cores are busy with the other workers
    threading.Thread(target=end_with_parent, daemon=True).start()


def end_with_parent() -> None:
    """End this worker when the process that started it is gone, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _get_ready() -> None:
    """Do nothing; submitting this starts a process."""


def _calibrate(stretch: list[StereoFrame]) -> list[_Calibrated]:
    if _calibrator is None:
        raise RuntimeError("this worker was not started by its initializer")
    calibrator = FrameCalibrator(Calibrator(_calibrator.rig, _calibrator.config))
    # The motion between the frames of a stretch is estimated here, as it takes as long as a frame.
    return [(result, calibrator.motion_to(result)) for result in map(calibrator.calibrate_slim, stretch)]
