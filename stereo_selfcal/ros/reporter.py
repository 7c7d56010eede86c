"""Reports to ``/diagnostics`` once a second: asks the input and the node, and measures rates."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from ..core.errors import RigError
from ..core.pairing import PairCounts
from .calibration import no_pair_reason
from .config import NodeConfig
from .diagnostics import CalibrationReport, CameraInfoReport, ImagesReport, Snapshot, diagnostics_message
from .inputs import StereoInput
from .live import known_rig, missing_info

PERIOD_S = 1.0
# Rates are means over so many periods: a camera with one image per second does not seem to stop.
_WINDOW = 3


class DiagnosticsReporter:
    """Publishes the diagnostics of the node.

    Args:
        node: The node.
        source: Its input.
        config: Returns its parameters.
        calibration: Returns what is known of the calibration.
    """

    def __init__(
        self,
        node: Node,
        source: StereoInput,
        config: Callable[[], NodeConfig],
        calibration: Callable[[], CalibrationReport],
    ) -> None:
        self._node = node
        self._source = source
        self._config = config
        self._calibration = calibration
        self._seen: deque[tuple[PairCounts, float]] = deque(maxlen=_WINDOW)
        self._seen.append((source.state.counts, time.monotonic()))
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        # On the steady clock: a simulation that stands still must not silence the diagnostics.
        node.create_timer(PERIOD_S, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def snapshot(self) -> Snapshot:
        """Return what there is to report."""
        config = self._config()
        return Snapshot(
            node=self._node.get_fully_qualified_name(),
            road_frame=config.road_frame,
            camera_frame=config.camera_frame,
            calibration=self._calibration(),
            images=self._images(config),
            camera_info=self._camera_info(config),
        )

    def _images(self, config: NodeConfig) -> ImagesReport:
        state, now_s = self._source.state, time.monotonic()
        before, before_s = self._seen[0]
        self._seen.append((state.counts, now_s))
        added, elapsed_s = state.counts.since(before), max(now_s - before_s, 1e-3)
        topics = self._source.topics
        return ImagesReport(
            counts=state.counts,
            added=added,
            elapsed_s=elapsed_s,
            no_pair="" if added.pairs else no_pair_reason(self._source, config, before, elapsed_s),
            nearest_s=state.nearest_s,
            topics=topics,
            publishers=(self._source.publishers(topics.left), self._source.publishers(topics.right)),
        )

    def _camera_info(self, config: NodeConfig) -> CameraInfoReport:
        source = "parameters rig.*" if config.rig else "CameraInfo"
        try:
            rig = known_rig(self._source, config)
        except RigError as error:
            return CameraInfoReport(source, faults=(str(error),))
        return CameraInfoReport(source, rig, missing="" if rig else missing_info(self._source))

    def _on_timer(self) -> None:
        message = diagnostics_message(self._node.get_clock().now().to_msg(), self.snapshot())
        try:
            self._publisher.publish(message)
        except RuntimeError:  # rcl's errors
            if self._node.context.ok():  # Ctrl-C may come at any moment; then there is nobody to tell
                raise
