"""What the node publishes of a result: parameters and latched messages, all from one callback group."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field

from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from ..core.results import CalibrationResult
from ..result_file import result_parameters
from .messages import extrinsics_message, pose_message
from .parameters import NodeParameters

# The default callback group runs only short work; longer than this means it hangs.
_PUBLISH_TIMEOUT_S = 10.0
_LATCHED = QoSProfile(
    depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
)


@dataclass(frozen=True, slots=True, eq=False)
class Publication:
    """A result to be published.

    Attributes:
        result: An accepted result.
        road_frame: Name of the road frame.
        stamp_ns: Stamp of the (last) frame [ns].
    """

    result: CalibrationResult
    road_frame: str
    stamp_ns: int


@dataclass(slots=True, eq=False)
class _Order:
    """A publication on its way from another thread to the default callback group."""

    publication: Publication
    done: threading.Event = field(default_factory=threading.Event)
    error: Exception | None = None


class Outputs:
    """Sets the result parameters and publishes the result.

    Args:
        node: The node.
        parameters: Its parameters.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._node = node
        self._parameters = parameters
        self._extrinsics = node.create_publisher(ParameterEvent, "~/extrinsics", _LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "~/pose", _LATCHED)
        # Published from the default callback group, in which the parameter services run.
        self._order: _Order | None = None
        self._guard = node.create_guard_condition(self._on_guard)

    def publish(self, publication: Publication) -> None:
        """Publish from the default callback group, and wait until it is done.

        One thread at a time, and none of that group.

        Raises:
            OutputError: The result is a rejection, or holds NaN or infinity.
            TimeoutError: The callback group hangs.
        """
        order = _Order(publication)
        self._order = order
        self._guard.trigger()
        if not order.done.wait(_PUBLISH_TIMEOUT_S):
            raise TimeoutError(f"the result was not published within {_PUBLISH_TIMEOUT_S} s")
        if order.error is not None:
            raise order.error

    def publish_now(self, publication: Publication) -> None:
        """Publish; to be called from the default callback group, or before the node is spun.

        Raises:
            OutputError: As :meth:`publish`; then nothing was published.
        """
        result, stamp_ns = publication.result, publication.stamp_ns
        parameters = result_parameters(result)
        assert result.extrinsics is not None and result.covariance is not None
        pose = pose_message(result.extrinsics, result.covariance, publication.road_frame, stamp_ns)
        event = extrinsics_message(self._node.get_fully_qualified_name(), stamp_ns, parameters)
        self._parameters.publish_result(parameters)
        self._extrinsics.publish(event)
        self._pose.publish(pose)

    def _on_guard(self) -> None:
        order, self._order = self._order, None
        if order is None:
            return
        try:
            self.publish_now(order.publication)
        except Exception as error:  # noqa: BLE001 - raised again in the thread that waits
            order.error = error
        finally:
            order.done.set()
