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

"""The ROS subscriptions to a stereo camera: names, message types, QoS, and what DDS holds back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    QoSCompatibility,
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from ..core.errors import ConfigError
from ..core.geometry.homography import SIDES, Side
from .config import NodeConfig
from .overrides import QOS_PREFIX, check_qos_overrides, start_values
from .pair_source import Topics
from .shutdown import silent_after_shutdown
from .taking import TakenElsewhere, take

# What rmw calls the node of a publisher that was discovered before its node was.
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
_QUEUE = 5  # the depth of rmw's profile for sensor data (REP 2003), as is the best effort
# Those of a subscription that concern what is received; durability is that of cameras that publish once.
_POLICIES = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)
# For what was published before there was a subscription: of DDS, only reliable ones are given it.
_LATCHED = QoSProfile(
    depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
)


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """One topic of the camera.

    Attributes:
        message_type: Class of its messages.
        name: Its name before remapping, which must not happen twice.
        topic: Its full name.
        received: Called with each message.
    """

    message_type: type
    name: str
    topic: str
    received: Callable[[Any], None]


class CameraSubscriptions:
    """Subscribes to the images and to the CameraInfo of both cameras, and drops the subscriptions again.

    Subscriptions are best effort and volatile, which matches every publisher. Some cameras publish CameraInfo
    once, latched (reliable and transient local). It is subscribed to with a latched profile, too, while there
    is such a publisher: that profile alone would match no other. ``qos_overrides.*`` parameters replace both.

    Args:
        node: The node.
        config: Its configuration.
        on_image: Called with each image message and its side.
        on_camera_info: Called with each CameraInfo and its side.
        images_wanted: Returns whether image messages are to be taken from DDS.
        infos_wanted: Returns the same for CameraInfo.

    Raises:
        ConfigError: An override of a QoS policy cannot be followed; by :meth:`switch`.
    """

    def __init__(
        self,
        node: Node,
        config: NodeConfig,
        on_image: Callable[[Side, Any], None],
        on_camera_info: Callable[[Side, Any], None],
        images_wanted: Callable[[], bool],
        infos_wanted: Callable[[], bool],
    ) -> None:
        self._node = node
        self._images_wanted = images_wanted
        self._infos_wanted = infos_wanted
        self._subscribed: dict[str, Subscription] = {}
        self._latched: dict[str, Subscription] = {}
        self._profiles: dict[str, QoSProfile] = {}
        self._overrides = start_values(node)
        compressed = config.image_transport == "compressed"
        leaf = "image_rect" if config.rectified else "image_raw"

        def image_stream(side: Side) -> Stream:
            name = f"{side}/{leaf}"
            if compressed:  # as image_transport has it: the suffix goes behind the remapped name
                name = f"{node.resolve_topic_name(name)}/compressed"
            message_type = CompressedImage if compressed else Image
            return Stream(
                message_type, name, node.resolve_topic_name(name), lambda message: on_image(side, message)
            )

        def info_stream(side: Side) -> Stream:
            name = f"{side}/camera_info"
            return Stream(
                CameraInfo, name, node.resolve_topic_name(name), lambda message: on_camera_info(side, message)
            )

        self._images = tuple(map(image_stream, SIDES))
        self._infos = tuple(map(info_stream, SIDES))

    @property
    def topics(self) -> Topics:
        """Full names of the topics."""
        return Topics(*(stream.topic for stream in (*self._images, *self._infos)))

    def publishers(self, topic: str) -> int:
        """Return how many publishers a topic has; 0 after a shutdown, when nobody can tell."""
        with silent_after_shutdown(self._node.context):
            return int(self._node.count_publishers(topic))
        return 0

    def mismatches(self) -> tuple[str, ...]:
        """Return sentences about publishers that nothing can be received from, by their type or QoS."""
        return tuple(text for stream in (*self._images, *self._infos) for text in self._mismatches_of(stream))

    def info_mismatches(self) -> tuple[str, ...]:
        """Return those about CameraInfo, and about publishers of it that may have sent theirs too early."""
        found = []
        for stream in self._infos:
            found += self._mismatches_of(stream)
            for publisher in self._publishers_of(stream.topic):
                profile = publisher.qos_profile
                if profile.durability == _LATCHED.durability and not _is_latched(publisher):
                    found.append(
                        f"{_name_of(publisher)} publishes {stream.topic} transient local, but best effort: "
                        "what it sent before this node listened is lost, make it reliable or send it anew"
                    )
        return tuple(found)

    def _publishers_of(self, topic: str) -> list[TopicEndpointInfo]:
        """Return what is known of each publisher of a topic; none after a shutdown."""
        with silent_after_shutdown(self._node.context):
            return list(self._node.get_publishers_info_by_topic(topic))
        return []

    def _mismatches_of(self, stream: Stream) -> list[str]:
        found = []
        topic, wanted = stream.topic, f"sensor_msgs/msg/{stream.message_type.__name__}"
        for publisher in self._publishers_of(topic):
            compatible, reason = qos_check_compatible(publisher.qos_profile, self._profiles[topic])
            if publisher.topic_type != wanted:
                found.append(
                    f"{_name_of(publisher)} publishes {publisher.topic_type} on {topic}, {wanted} is read"
                )
            elif compatible == QoSCompatibility.ERROR:
                why = " ".join(reason.replace("ERROR:", "").split()).rstrip(";")
                found.append(
                    f"{_name_of(publisher)} publishes {topic} with a QoS that does not match ({why}): set "
                    f"{QOS_PREFIX}{topic}.subscription.*"
                )
        return found

    def switch(self, images: bool, infos: tuple[bool, bool]) -> None:
        """Make the subscriptions that are needed, and destroy the others.

        Args:
            images: Whether those to the images are needed.
            infos: Whether those to the CameraInfo of the left and of the right camera are.
        """
        for stream in self._images:
            self._switch_one(stream, images)
        for stream, needed in zip(self._infos, infos, strict=True):
            self._switch_one(stream, needed)
            self._switch_latched(stream, needed and self._latches(stream))

    def to_take(self) -> list[Subscription]:
        """Return the subscriptions whose messages are to be taken now.

        From the others none is taken. DDS keeps the newest few, which costs a tenth of taking them all.
        """
        images = self._images_wanted() or not self._dds_keeps_few_images()
        infos = self._infos_wanted()
        found = [self._subscribed.get(stream.topic) for stream in self._images if images]
        found += [
            kind.get(s.topic) for s in self._infos if infos for kind in (self._subscribed, self._latched)
        ]
        return [subscription for subscription in found if subscription is not None]

    def drop_old_images(self) -> None:
        """Drop the images that DDS kept while none were taken: whoever wants images wants new ones."""
        for stream in self._images:
            subscription = self._subscribed.get(stream.topic)
            for _ in range(_QUEUE):
                if subscription is None or take(subscription) is None:
                    break

    def _dds_keeps_few_images(self) -> bool:
        """Return whether DDS keeps few images while they are not taken; qos_overrides may ask for many."""
        profiles = [self._profiles[s.topic] for s in self._images if s.topic in self._profiles]
        return all(p.history == QoSHistoryPolicy.KEEP_LAST and p.depth <= _QUEUE for p in profiles)

    def _switch_one(self, stream: Stream, needed: bool) -> None:
        if needed and stream.topic not in self._subscribed:
            self._subscribed[stream.topic] = self._subscribe(stream)
        elif not needed and stream.topic in self._subscribed:
            self._node.destroy_subscription(self._subscribed.pop(stream.topic))

    def _latches(self, stream: Stream) -> bool:
        """Return whether a topic has a publisher of latched messages, for which the user set nothing else."""
        if f"{QOS_PREFIX}{stream.topic}.subscription.durability" in self._overrides:
            return False
        return any(map(_is_latched, self._publishers_of(stream.topic)))

    def _switch_latched(self, stream: Stream, needed: bool) -> None:
        if needed and stream.topic not in self._latched:
            self._latched[stream.topic] = self._create(stream, _LATCHED)
        elif not needed and stream.topic in self._latched:
            self._node.destroy_subscription(self._latched.pop(stream.topic))

    def _subscribe(self, stream: Stream) -> Subscription:
        if stream.topic in self._profiles:
            return self._create(stream, self._profiles[stream.topic])
        # One profile each: rclpy writes the overrides of a topic into the profile it is given.
        profile = QoSProfile(depth=_QUEUE, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        prefix = f"{QOS_PREFIX}{stream.topic}.subscription."
        check_qos_overrides(prefix, self._overrides)
        if str(self._overrides.get(f"{prefix}durability")).lower() == "transient_local":
            profile.reliability = _LATCHED.reliability  # else the override would have no effect
        self._profiles[stream.topic] = profile
        try:
            return self._create(stream, profile, QoSOverridingOptions(_POLICIES))
        except RuntimeError as error:  # the middleware's own limits
            raise ConfigError(f"{prefix}*: {' '.join(str(error).split())}") from error

    def _create(
        self,
        stream: Stream,
        profile: QoSProfile,
        overriding: QoSOverridingOptions | None = None,
    ) -> Subscription:
        return self._node.create_subscription(
            stream.message_type,
            stream.name,
            stream.received,
            profile,
            # A group of its own: one of rclpy never forgets a subscription it once had.
            callback_group=TakenElsewhere(),
            # Handlers of events cannot be destroyed while an executor waits; mismatches() says more.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=overriding,
        )


def _is_latched(publisher: Any) -> bool:
    """Return whether a publisher hands what it sent before to a subscription that comes later."""
    profile = publisher.qos_profile
    return (profile.reliability, profile.durability) == (_LATCHED.reliability, _LATCHED.durability)


def _name_of(publisher: Any) -> str:
    if publisher.node_name == _UNKNOWN_NODE:
        return "a node not known by name yet"
    return f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
