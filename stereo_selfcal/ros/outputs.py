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

"""What the node publishes of a result: parameters and latched messages, all from one callback group."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from visualization_msgs.msg import MarkerArray

from ..core.errors import OutputError
from ..core.geometry.camera_info_repair import RepairedPair
from ..core.geometry.homography import SIDES
from ..core.results import CalibrationResult
from ..core.types import Array
from ..files.frames import PlacedCamera
from ..files.node_settings import RESULT_PREFIX
from ..files.result_file import (
    alignment_parameters,
    evidence_parameters,
    result_parameters,
    yaw_parameters,
)
from ..files.saved_result import RESULT_NAMES
from .config import NodeConfig
from .markers import markers_message, no_markers_message
from .messages import (
    camera_info_message,
    deleted_message,
    extrinsics_message,
    no_camera_info_message,
    pose_message,
    transform_messages,
)
from .parameters import NodeParameters
from .tf_tree import TfTree

# The default callback group runs only short work: after this time it is taken to hang.
_PUBLISH_TIMEOUT_S = 10.0
_SHUTDOWN = "the node shuts down: nothing is published any more"
_EXTRINSICS = tuple(RESULT_PREFIX + name for name in RESULT_NAMES)
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
        lanes: Lane lines of the last frame on the road, each (N, 2) [m]; empty where they are not known.
        pair: The corrected CameraInfo of both cameras; None where the cameras are not known.
        placed: The camera in the vehicle; None before CameraInfo has told which frame is meant.
        frames_told: Whether CameraInfo has told it, so that it may go to ``/tf_static``.
    """

    result: CalibrationResult
    config: NodeConfig
    stamp_ns: int
    lanes: tuple[Array, ...] = ()
    pair: RepairedPair | None = None
    placed: PlacedCamera | None = None
    frames_told: bool = True


@dataclass(slots=True, eq=False)
class _Request:
    """What the default callback group is to do for another thread."""

    work: Callable[[], None]
    done: threading.Event = field(default_factory=threading.Event)
    error: Exception | None = None


class Outputs:
    """Sets the result parameters and publishes the result.

    Args:
        node: The node.
        parameters: Its parameters.

    Raises:
        ConfigError: ``publish_tf`` is set where tf2_ros or tf2_msgs is not installed.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._node = node
        self._parameters = parameters
        self._said = _EXTRINSICS  # the names in the last event
        self._extrinsics = node.create_publisher(ParameterEvent, "~/extrinsics", _LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "~/pose", _LATCHED)
        self._markers = node.create_publisher(MarkerArray, "~/markers", _LATCHED)
        self._camera_infos = (
            [node.create_publisher(CameraInfo, f"~/{side}/camera_info", _LATCHED) for side in SIDES]
            if parameters.config.publish_camera_info
            else []
        )
        self._tree = TfTree(node) if parameters.config.publish_tf else None
        # Done in the default callback group, in which the parameter services run.
        self._request: _Request | None = None
        self._stopped = False
        self._guard = node.create_guard_condition(self._on_guard)

    def publish(self, publication: Publication) -> None:
        """Publish from the default callback group, and wait until it is done.

        To be called by one thread at a time, and from no callback of that group.

        Raises:
            OutputError: The result is a rejection, or holds NaN or infinity; or the node shuts down.
            TimeoutError: The callback group hangs.
        """
        self._do(lambda: self.publish_now(publication))

    @property
    def conflict(self) -> str:
        """Why nothing is sent to ``/tf_static``, or who contradicts it, one sentence; "" if all is well."""
        return "" if self._tree is None else self._tree.conflict

    @property
    def outdated(self) -> str:
        """What stands on ``/tf_static`` though it is not wanted any more, one sentence; "" if nothing."""
        return "" if self._tree is None else self._tree.outdated

    def withdraw(self) -> None:
        """Withdraw what was published; callers and errors as of :meth:`publish`.

        The parameters lose their values, ``~/extrinsics`` says that they were deleted, the markers are
        deleted, and the CameraInfo is that of cameras that are not calibrated. ``~/pose`` and ``/tf_static``
        cannot express it.
        """
        self._do(self.withdraw_now)

    def _do(self, work: Callable[[], None]) -> None:
        request = _Request(work)
        self._request = request
        if self._stopped:  # asked after the request is set, so that it is not missed by stop()
            raise OutputError(_SHUTDOWN)
        self._guard.trigger()
        if not request.done.wait(_PUBLISH_TIMEOUT_S):
            raise TimeoutError(f"the result was not published within {_PUBLISH_TIMEOUT_S} s")
        if request.error is not None:
            raise request.error

    def publish_now(self, publication: Publication) -> None:
        """Publish; to be called from the default callback group, or before the node is spun.

        Raises:
            OutputError: As :meth:`publish`; then nothing was published.
        """
        result, stamp_ns = publication.result, publication.stamp_ns
        parameters = result_parameters(result) | yaw_parameters(result)
        # All messages are made before the first is published: an error leaves nothing half published.
        in_vehicle = self._in_vehicle(publication)
        said = parameters | evidence_parameters(result)
        gone = [name for name in self._said if name not in said]
        event = extrinsics_message(self._node.get_fully_qualified_name(), stamp_ns, said, gone)
        pair = publication.pair
        infos = [camera_info_message(each, stamp_ns) for each in ((pair.left, pair.right) if pair else ())]
        self._parameters.publish_result(parameters | alignment_parameters(result))
        self._extrinsics.publish(event)
        self._said = tuple(said)
        self._publish_in_vehicle(*in_vehicle)
        for publisher, info in zip(self._camera_infos, infos, strict=False):
            publisher.publish(info)

    def publish_camera(self, publication: Publication) -> None:
        """Publish where the camera is in the vehicle anew; to be called as :meth:`publish_now`."""
        self._publish_in_vehicle(*self._in_vehicle(publication))

    def _in_vehicle(
        self, publication: Publication
    ) -> tuple[MarkerArray, PoseWithCovarianceStamped | None, list[TransformStamped], str]:
        """Return the messages of where the camera is, as far as its frames are known.

        The last is the road, where it must have no parent of others: while the yaw is not known.
        """
        placed, config, stamp_ns = publication.placed, publication.config, publication.stamp_ns
        extrinsics = publication.result.extrinsics
        assert extrinsics is not None
        if placed is None:
            return markers_message(extrinsics, publication.lanes, config.road_frame, stamp_ns), None, [], ""
        markers = markers_message(extrinsics, publication.lanes, placed.parent, stamp_ns, placed.camera)
        sent = publication.frames_told and not placed.problem
        transforms = transform_messages(placed, stamp_ns) if sent else []
        top = placed.road if placed.yaw_remark else ""
        return markers, pose_message(placed, stamp_ns), transforms, top

    def _publish_in_vehicle(
        self,
        markers: MarkerArray,
        pose: PoseWithCovarianceStamped | None,
        transforms: list[TransformStamped],
        top: str,
    ) -> None:
        self._markers.publish(markers)
        if pose is not None:
            self._pose.publish(pose)
        if self._tree is not None:
            self._tree.send(transforms, top)

    def stop(self) -> None:
        """End the waiting in :meth:`publish`: the node shuts down, and the request will not be served."""
        self._stopped = True
        request, self._request = self._request, None
        if request is not None:
            request.error = OutputError(_SHUTDOWN)
            request.done.set()

    def withdraw_now(self) -> None:
        """Withdraw what was published; to be called as :meth:`publish_now`."""
        self._parameters.withdraw_result()
        stamp_ns = int(self._node.get_clock().now().nanoseconds)
        self._extrinsics.publish(deleted_message(self._node.get_fully_qualified_name(), stamp_ns, self._said))
        self._said = _EXTRINSICS
        self._markers.publish(no_markers_message())
        if self._tree is not None:
            self._tree.send([])
        for publisher in self._camera_infos:
            publisher.publish(no_camera_info_message(stamp_ns))

    def _on_guard(self) -> None:
        request, self._request = self._request, None
        if request is None:
            return
        try:
            request.work()
        except Exception as error:  # noqa: BLE001 - raised again in the thread that waits
            request.error = error
        finally:
            request.done.set()
