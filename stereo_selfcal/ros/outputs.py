"""What the node publishes of a result: parameters and latched messages, all from one callback group."""

from __future__ import annotations

import importlib
import threading
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from ..core.errors import ConfigError, OutputError
from ..core.results import CalibrationResult
from ..core.types import Array
from ..files.node_settings import RESULT_PREFIX
from ..files.result_file import result_parameters
from ..files.saved_result import RESULT_NAMES
from .config import NodeConfig
from .markers import markers_message, no_markers_message
from .messages import deleted_message, extrinsics_message, pose_message, transform_message
from .parameters import NodeParameters

# The default callback group runs only short work; longer than this means it hangs.
_PUBLISH_TIMEOUT_S = 10.0
_SHUTDOWN = "the node shuts down: nothing is published any more"
_LATCHED = QoSProfile(
    depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
)


@dataclass(frozen=True, slots=True, eq=False)
class Publication:
    """A result to be published.

    Attributes:
        result: An accepted result.
        config: Parameters it is published with.
        stamp_ns: Stamp of the (last) frame [ns].
        lanes: Lane lines of the last frame on the road, each (N, 2) [m], as far as they are known.
    """

    result: CalibrationResult
    config: NodeConfig
    stamp_ns: int
    lanes: tuple[Array, ...] = ()


@dataclass(slots=True, eq=False)
class _Order:
    """A publication on its way from another thread to the default callback group."""

    publication: Publication | None
    done: threading.Event = field(default_factory=threading.Event)
    error: Exception | None = None


class Outputs:
    """Sets the result parameters and publishes the result.

    Args:
        node: The node.
        parameters: Its parameters.

    Raises:
        ConfigError: ``publish_tf`` is set where there is no tf2_ros.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._node = node
        self._parameters = parameters
        self._extrinsics = node.create_publisher(ParameterEvent, "~/extrinsics", _LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "~/pose", _LATCHED)
        self._markers = node.create_publisher(MarkerArray, "~/markers", _LATCHED)
        self._transform = _transform_broadcaster(node) if parameters.config.publish_tf else None
        # Published from the default callback group, in which the parameter services run.
        self._order: _Order | None = None
        self._stopped = False
        self._guard = node.create_guard_condition(self._on_guard)

    def publish(self, publication: Publication) -> None:
        """Publish from the default callback group, and wait until it is done.

        One thread at a time, and none of that group.

        Raises:
            OutputError: The result is a rejection, or holds NaN or infinity; or the node shuts down.
            TimeoutError: The callback group hangs.
        """
        self._do(publication)

    def withdraw(self) -> None:
        """Take back what was published; from which thread and with which errors, see :meth:`publish`.

        The parameters have no value any more, ``~/extrinsics`` says that they were deleted, and the markers
        go. ``~/pose`` and ``/tf_static`` have no way to say so.
        """
        self._do(None)

    def _do(self, publication: Publication | None) -> None:
        order = _Order(publication)
        self._order = order
        if self._stopped:  # after the order is given, so that one of both sees the other
            raise OutputError(_SHUTDOWN)
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
        result, config, stamp_ns = publication.result, publication.config, publication.stamp_ns
        parameters = result_parameters(result)
        extrinsics, covariance = result.extrinsics, result.covariance
        assert extrinsics is not None and covariance is not None
        # All are made before the first goes out.
        event = extrinsics_message(self._node.get_fully_qualified_name(), stamp_ns, parameters)
        pose = pose_message(extrinsics, covariance, config.road_frame, stamp_ns)
        markers = markers_message(extrinsics, publication.lanes, config.road_frame, stamp_ns)
        transform = transform_message(extrinsics, config.road_frame, config.camera_frame, stamp_ns)
        self._parameters.publish_result(parameters)
        self._extrinsics.publish(event)
        self._pose.publish(pose)
        self._markers.publish(markers)
        if self._transform is not None:
            self._transform.sendTransform(transform)

    def stop(self) -> None:
        """End the waiting of whoever publishes: the node shuts down, and nobody will do it."""
        self._stopped = True
        order, self._order = self._order, None
        if order is not None:
            order.error = OutputError(_SHUTDOWN)
            order.done.set()

    def withdraw_now(self) -> None:
        """Take back; to be called as :meth:`publish_now`."""
        self._parameters.withdraw_result()
        stamp_ns = int(self._node.get_clock().now().nanoseconds)
        names = [RESULT_PREFIX + name for name in RESULT_NAMES]
        self._extrinsics.publish(deleted_message(self._node.get_fully_qualified_name(), stamp_ns, names))
        self._markers.publish(no_markers_message())

    def _on_guard(self) -> None:
        order, self._order = self._order, None
        if order is None:
            return
        try:
            if order.publication is None:
                self.withdraw_now()
            else:
                self.publish_now(order.publication)
        except Exception as error:  # noqa: BLE001 - raised again in the thread that waits
            order.error = error
        finally:
            order.done.set()


def _transform_broadcaster(node: Node) -> Any:
    """Return tf2's broadcaster; imported only where it is wanted, as not every system has it."""
    try:
        tf2_ros = importlib.import_module("tf2_ros")
    except ImportError as error:
        raise ConfigError(
            f"publish_tf is true, but tf2_ros cannot be imported ({error}): install tf2_ros_py or set "
            "publish_tf to false"
        ) from error
    return tf2_ros.StaticTransformBroadcaster(node)
