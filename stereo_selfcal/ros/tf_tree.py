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

"""``/tf_static``: the transform is sent where its frames have no other parent, and told where they have.

A frame has one parent. Two publishers of it would make every consumer jump between both. So the tree is
listened to before anything is sent and from time to time afterwards, in short bursts, as ``/tf`` may have
hundreds of messages a second. Each burst subscribes anew: what is latched comes again, and a joint that has
been removed meanwhile is forgotten.

tf2_ros and tf2_msgs are imported only where a transform is to be sent, as not every system has them.
"""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from ..core.errors import ConfigError, shortened
from ..files.frames import bare
from .shutdown import silent_after_shutdown

_Numbers = tuple[float, ...]

_TICK_S = 1.0
# A burst lasts so many ticks: the latched messages of every publisher have come by then, and one of each
# joint that moves at least once a second.
_LISTENED_TICKS = 2
_QUIET_TICKS = 13
_TOPICS = ("/tf_static", "/tf")
_QUEUE = 100  # that of tf2's own listeners
_QOS = (
    QoSProfile(
        depth=_QUEUE,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
    ),
    QoSProfile(depth=_QUEUE, reliability=QoSReliabilityPolicy.BEST_EFFORT),
)


class Joint(NamedTuple):
    """Two frames in the tree, by their names without slashes at the front."""

    parent: str
    child: str

    @classmethod
    def of(cls, transform: Any) -> Joint:
        """Return that of a TransformStamped."""
        return cls(bare(transform.header.frame_id), bare(transform.child_frame_id))


class _Remedies(NamedTuple):
    """What to do about the child of a joint: its parameter, and what to set, by what is wrong."""

    parameter: str
    other_parent: str
    loop: str


_VEHICLE_IS_ROAD = (
    "set vehicle_frame to the name of road_frame to have the camera in it with yaw 0, as before"
)
# Of the joints in the order they are sent in: the camera in the vehicle, and then the road in it.
_REMEDIES = (
    _Remedies(
        "camera_frame",
        "set camera_frame to a name of its own, or remove that joint from the URDF and have it from exports",
        "set camera_frame to a name of its own, or take the camera out of the URDF above the vehicle and "
        "have it from exports",
    ),
    _Remedies(
        "road_frame",
        f"set road_frame to a name of its own, remove that joint, or {_VEHICLE_IS_ROAD}",
        f"set road_frame to a name of its own, or {_VEHICLE_IS_ROAD}",
    ),
)


def find_conflict(wanted: Sequence[Joint], heard: Iterable[tuple[str, Joint]], top: str = "") -> str:
    """Return why joints cannot be sent, one sentence; "" where they can.

    Args:
        wanted: The camera in the vehicle, and then the road in it, where it is sent.
        heard: Joints of others, with the topics they are on.
        top: The road, where the camera is in it and where it is in the vehicle is not known; else "". A
            parent that others give it is that of another camera's road.
    """
    parents: dict[str, dict[str, str]] = {}
    for topic, joint in heard:
        parents.setdefault(joint.child, {})[joint.parent] = topic
    for joint, remedies in zip(wanted, _REMEDIES, strict=False):
        for parent, topic in parents.get(joint.child, {}).items():
            return (
                f"{remedies.parameter} {shortened(joint.child)} has the parent {shortened(parent)} on "
                f"{topic} already, and a frame has one parent: {remedies.other_parent}"
            )
    for joint, remedies in zip(wanted, _REMEDIES, strict=False):
        topic = _way_up(joint.parent, joint.child, parents)
        if topic:
            return (
                f"{shortened(joint.parent)} is below {remedies.parameter} {shortened(joint.child)} on "
                f"{topic}, and a frame cannot be above itself: {remedies.loop}"
            )
    for parent, topic in parents.get(top, {}).items() if top else ():
        return (
            f"road_frame {shortened(top)} has the parent {shortened(parent)} on {topic} already, and where "
            "this camera's road is in it is not known while the yaw is not: set road_frame to a name of its "
            "own for each camera, or, where you have joined it to the vehicle yourself, set vehicle_frame to "
            "the name of road_frame"
        )
    return ""


def _way_up(start: str, end: str, parents: dict[str, dict[str, str]]) -> str:
    """Return the topic on which a frame has another one above it; "" where it has not."""
    seen, waiting = {start}, [start]
    while waiting:
        for parent, topic in parents.get(waiting.pop(), {}).items():
            if parent == end:
                return topic
            if parent not in seen:
                seen.add(parent)
                waiting.append(parent)
    return ""


class TfTree:
    """Sends transforms to ``/tf_static`` unless somebody else does; safe to be used by several threads.

    Args:
        node: The node.

    Raises:
        ConfigError: tf2_ros or tf2_msgs is not installed.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        try:
            self._broadcaster = importlib.import_module("tf2_ros").StaticTransformBroadcaster(node)
            self._message_type = importlib.import_module("tf2_msgs.msg").TFMessage
        except ImportError as error:
            raise ConfigError(
                f"publish_tf is true, but tf2 cannot be imported ({error}): install tf2_ros_py and tf2_msgs, "
                "or set publish_tf to false"
            ) from error
        self._group = MutuallyExclusiveCallbackGroup()
        self._lock = threading.Lock()
        self._wanted: list[TransformStamped] = []
        self._top = ""
        self._standing: dict[str, Joint] = {}  # the last that was sent of each child
        self._sent: set[tuple[Joint, _Numbers]] = set()  # of this run: they come back
        self._is_sent = False
        self._conflict = ""
        self._heard: set[tuple[str, Joint]] | None = None  # of others, by the last burst; None before it
        self._arriving: set[tuple[str, Joint]] = set()
        self._subscriptions: list[Any] = []
        self._ticks = 0
        self._begin()
        node.create_timer(
            _TICK_S, self.tick, callback_group=self._group, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    @property
    def conflict(self) -> str:
        """Why nothing is sent, or who contradicts what was sent, one sentence; "" where all is well."""
        with self._lock:
            return self._conflict

    @property
    def outdated(self) -> str:
        """What was sent, is not wanted any more and cannot be taken back, one sentence; "" if nothing."""
        with self._lock:
            wanted = {Joint.of(transform) for transform in self._wanted}
            joints = [joint for joint in self._standing.values() if joint not in wanted]
        if not joints:
            return ""
        names = ", ".join(f"{shortened(joint.parent)} -> {shortened(joint.child)}" for joint in joints)
        return f"what was sent before stands on /tf_static until a restart: {names}"

    def send(self, transforms: list[TransformStamped], top: str = "") -> None:
        """Send transforms as soon as the tree is known, and nobody else sends their frames.

        Args:
            transforms: The camera in the vehicle first; none: what was wanted is not wanted any more.
            top: A frame that must have no parent of others (:func:`find_conflict`); "": none.
        """
        with self._lock:
            self._wanted, self._top, self._is_sent = transforms, bare(top), False
            self._decide()

    def tick(self) -> None:
        """Go on with the bursts; called once a second."""
        with silent_after_shutdown(self._node.context):
            self._ticks += 1
            if self._subscriptions:
                if self._ticks >= _LISTENED_TICKS:
                    self._end()
            elif self._ticks >= _QUIET_TICKS:
                self._begin()

    def _begin(self) -> None:
        self._ticks, self._arriving = 0, set()
        self._subscriptions = [
            self._node.create_subscription(
                self._message_type, topic, self._listener(topic), qos, callback_group=self._group
            )
            for topic, qos in zip(_TOPICS, _QOS, strict=True)
        ]

    def _listener(self, topic: str) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            with self._lock:
                for transform in message.transforms:
                    joint = Joint.of(transform)
                    if (joint, _numbers(transform)) not in self._sent:
                        self._arriving.add((topic, joint))

        return hear

    def _end(self) -> None:
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop())
        with self._lock:
            self._ticks, self._heard = 0, self._arriving
            before = self._conflict
            self._decide()
            if self._conflict and self._conflict != before:
                self._node.get_logger().warning(self._conflict)

    def _decide(self) -> None:
        """Send what is wanted, or say why it is not sent; callers lock."""
        if self._heard is None:
            return
        if not self._wanted:
            self._conflict = ""
            return
        joints = [Joint.of(transform) for transform in self._wanted]
        conflict = find_conflict(joints, sorted(self._heard), self._top)
        if not conflict and not self._is_sent:
            self._standing.update((joint.child, joint) for joint in joints)
            self._sent.update((Joint.of(transform), _numbers(transform)) for transform in self._wanted)
            self._broadcaster.sendTransform(self._wanted)
            self._is_sent = True
        end = "; the transform was sent before that" if self._is_sent else "; nothing is sent on /tf_static"
        self._conflict = f"{conflict}{end}" if conflict else ""


def _numbers(transform: Any) -> _Numbers:
    """Return where a transform puts its child, with all digits: they come back as they were sent."""
    moved, turned = transform.transform.translation, transform.transform.rotation
    return moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w
