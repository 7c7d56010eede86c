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

"""The continuous watch: calibrates one frame every ``monitor_period_s``.

A frame is followed from the one before, as a call of ~/calibrate does it, where that one tells the camera.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..core.calibrator import Calibrator
from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.drive.alignment_watch import CORRELATION_S
from .config import NodeConfig
from .live import LiveFrame, NoFrame
from .memory import trim_heap
from .record import FrameReport, calibrate_timed, failed_frame, refused_frame

# The longest wait at a time: a changed period, and cameras other than before, are noticed after it.
TICK_S = 0.5


class Monitor:
    """Calibrates a frame each period, in a thread of its own.

    Args:
        take: Returns a current frame, why there is none, or None while a call has them all; its
            argument is how long it may wait [s].
        config: Returns the parameters.
        check: Returns whether frames are wanted. Called a few times a second, in this thread.
        report: Told of every frame that was calibrated, in this thread.
        alive: Returns whether the node is alive. After a shutdown everything fails, and no error is logged.
        logger: Logger of the node, for errors that should never happen.
        clock: Steady time [s], for tests.
    """

    def __init__(
        self,
        take: Callable[[float], LiveFrame | NoFrame | None],
        config: Callable[[], NodeConfig],
        check: Callable[[], bool],
        report: Callable[[FrameReport], None],
        alive: Callable[[], bool],
        logger: Any,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._take = take
        self._config = config
        self._check = check
        self._report = report
        self._alive = alive
        self._logger = logger
        self._clock = clock
        self._calibrator: tuple[CalibratorConfig, Calibrator] | None = None
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="monitor", daemon=True)

    def start(self) -> None:
        """Watch until :meth:`stop`."""
        self._thread.start()

    def cancel(self) -> None:
        """End the watch after the present frame; no error is logged from now on."""
        self._stopped.set()

    def stop(self) -> None:
        """End the watch and wait for it."""
        self.cancel()
        if self._thread.is_alive():
            self._thread.join()

    def step(self) -> None:
        """Calibrate one frame, if there is one and its rig is known."""
        config = self._config()
        frame = self._take(config.monitor_period_s)
        if isinstance(frame, NoFrame) and frame.fault is not None:
            self._report(failed_frame(frame.fault, frame.stamp_ns))
        if not isinstance(frame, LiveFrame) or frame.rig is None:
            return
        if frame.refusal is not None:
            self._report(refused_frame(frame.left, frame.right, frame.rig, frame.refusal, frame.stamp_ns))
            return
        calibrator = self._calibrator_of(frame.rig, config.calibrator)
        images, stamp_ns = (frame.left, frame.right), frame.stamp_ns
        calibrate = calibrator.calibrate_next_or_refuse
        self._report(calibrate_timed(calibrator.rig, calibrate, *images, stamp_ns, frame.stamp_difference_s))

    def _calibrator_of(self, rig: StereoRig, config: CalibratorConfig) -> Calibrator:
        """Return the calibrator of the frame before, which that frame may have told the camera.

        Only frames that are looked at cold tell how the right camera is turned. Its watch takes those of
        ``CORRELATION_S`` as one, so that they are looked at no more often.
        """
        if self._calibrator is None or self._calibrator[0] != config or self._calibrator[1].rig != rig:
            every_s = CORRELATION_S if config.known.cold_every_s > 0.0 else 0.0
            seldom = replace(config, known=replace(config.known, cold_every_s=every_s))
            self._calibrator = config, Calibrator(rig, seldom)
        return self._calibrator[1]

    def _run(self) -> None:
        last_s, delay_s = -float("inf"), 0.0
        while not self._stopped.wait(delay_s):
            delay_s = TICK_S
            try:
                wanted, period_s = self._check(), self._config().monitor_period_s
                if not wanted or not period_s:
                    continue
                if self._clock() >= last_s + period_s:
                    last_s = self._clock()
                    self.step()
                    trim_heap()
                delay_s = max(0.0, min(last_s + period_s - self._clock(), TICK_S))
            except Exception:  # noqa: BLE001 - a frame that fails must not end the watch
                if self._alive() and not self._stopped.is_set():
                    self._logger.error(
                        f"the watch failed on a frame:\n{traceback.format_exc()}", throttle_duration_sec=60.0
                    )
