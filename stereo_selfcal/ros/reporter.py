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

"""Reports to ``/diagnostics`` once a second, and measures the rates for it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from ..core.camera.image_messages import SUPPORTED_ENCODINGS
from ..core.camera.pairing import PairCounts
from ..core.errors import RigError
from ..core.geometry.homography import SIDES
from .config import NodeConfig
from .diagnostics import CalibrationReport, CameraInfoReport, ImagesReport, Snapshot, diagnostics_message
from .frames import camera_frame
from .inputs import StereoInput
from .intake import IntakeWindow
from .live import missing_info
from .pair_source import known_rectifier, no_pair_reason
from .shutdown import silent_after_shutdown

PERIOD_S = 1.0
# Rates are means over this number of reports at most: a camera with one image per second must not seem to
# stop.
_RATE_REPORTS = 3
# A rate is measured over at least this time. It is longer without a pair, as a slow camera may have had no
# time for one.
_MIN_RATE_TIME_S = 0.5
_MIN_TIME_WITHOUT_PAIR_S = 2.0
_CLOCK_STEP_S = 1e-3  # two reports at once must not divide by zero


@dataclass(frozen=True, slots=True)
class _Measured:
    """What arrived within a span of time.

    Attributes:
        added: Images and pairs.
        elapsed_s: Length of the span [s].
        no_pair: Why there was no pair, "" if there was one.
        at_s: Steady time of its end [s].
        mismatches: Sentences about publishers that nothing can be received from.
    """

    added: PairCounts
    elapsed_s: float
    no_pair: str
    at_s: float
    mismatches: tuple[str, ...] = ()


class DiagnosticsReporter:
    """Publishes the diagnostics of the node.

    Args:
        node: The node.
        source: Its input.
        config: Returns its parameters.
        calibration: Returns the report of the calibration.
        clock: Steady time [s], for tests.
    """

    def __init__(
        self,
        node: Node,
        source: StereoInput,
        config: Callable[[], NodeConfig],
        calibration: Callable[[], CalibrationReport],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node = node
        self._source = source
        self._config = config
        self._calibration = calibration
        self._clock = clock
        self._earlier: deque[tuple[PairCounts, float]] = deque(maxlen=_RATE_REPORTS)
        self._window: IntakeWindow | None = None
        self._measured: _Measured | None = None
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        # The timer runs on the steady clock: a simulation that stands still must not silence the diagnostics.
        # It has its own callback group: parameter services must not wait while subscriptions are made.
        node.create_timer(
            PERIOD_S,
            self._on_timer,
            callback_group=MutuallyExclusiveCallbackGroup(),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )

    def snapshot(self) -> Snapshot:
        """Return what there is to report."""
        config = self._config()
        return Snapshot(
            node=self._node.get_fully_qualified_name(),
            road_frame=config.road_frame,
            camera_frame=camera_frame(self._source, config),
            calibration=self._calibration(),
            images=self._images(config),
            camera_info=self._camera_info(config),
        )

    def _images(self, config: NodeConfig) -> ImagesReport:
        state, now_s, window = self._source.state, self._clock(), self._source.window
        topics, formats = self._source.topics, self._source.formats
        measured = self._measured or _Measured(PairCounts(), 0.0, "", now_s)
        return ImagesReport(
            counts=state.counts,
            added=measured.added,
            elapsed_s=measured.elapsed_s,
            receiving=window is not None,
            age_s=now_s - measured.at_s,
            no_pair=measured.no_pair,
            nearest_s=state.nearest_s,
            topics=topics,
            publishers=(self._source.publishers(topics.left), self._source.publishers(topics.right)),
            formats={side: formats[side] for side in SIDES if side in formats},
            incompatible_qos=measured.mismatches,
            unusable=tuple(
                f"{topic}: image encoding {formats[side].encoding!r} is not supported: publish one of "
                f"{', '.join(SUPPORTED_ENCODINGS)}"
                for side, topic in zip(SIDES, topics[:2], strict=True)
                if side in formats
                and formats[side].is_raw
                and formats[side].encoding not in SUPPORTED_ENCODINGS
            ),
        )

    def _measure(self) -> None:
        """Measure rates over the last reports, within the present window of intake."""
        state, now_s, window = self._source.state, self._clock(), self._source.window
        if window is None:
            return
        if window is not self._window:
            self._window = window
            self._earlier.clear()
            self._earlier.append((window.counts, window.since_s))
        before, before_s = self._earlier[0]
        counts = state.counts
        added, elapsed_s = counts.since(before), now_s - before_s
        if elapsed_s < (_MIN_RATE_TIME_S if added.pairs else _MIN_TIME_WITHOUT_PAIR_S):
            if self._measured is not None and self._measured.added.pairs:
                return
            elapsed_s = max(elapsed_s, _CLOCK_STEP_S)
        self._earlier.append((counts, now_s))
        no_pair = "" if added.pairs else no_pair_reason(self._source, self._config(), before, elapsed_s)
        self._measured = _Measured(added, elapsed_s, no_pair, now_s, state.mismatches)

    def _camera_info(self, config: NodeConfig) -> CameraInfoReport:
        source = "parameters rig.*" if config.rig else "CameraInfo"
        try:
            rectifier = known_rectifier(self._source, config)
        except RigError as error:
            reason = getattr(error, "reason", None)
            return CameraInfoReport(source, faults=(f"{reason}: {error}" if reason else str(error),))
        if rectifier is None:
            return CameraInfoReport(source, missing=missing_info(self._source))
        formats = self._source.formats.items()
        sizes = {side: (found.width, found.height) for side, found in formats if found.is_raw}
        return CameraInfoReport(
            f"{source}, {rectifier.turn_text}" if rectifier.turned else source,
            rectifier.rig,
            faults=tuple(map(str, rectifier.size_faults(sizes.get("left"), sizes.get("right")))),
            doubts=tuple(map(str, rectifier.doubts)),
        )

    def _on_timer(self) -> None:
        with silent_after_shutdown(self._node.context):
            self._measure()  # before the tick that may end a probe: the last second belongs to it
            self._source.tick()
            message = diagnostics_message(self._node.get_clock().now().to_msg(), self.snapshot())
            self._publisher.publish(message)
