"""The node's subscriptions: images paired as they come, and the last CameraInfo of each camera."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from ..core.pairing import StampedPair, StampPairer, message_stamp_ns
from .calibration import InputState, Topics
from .config import NodeConfig

SIDES = ("left", "right")

_QUEUE = 5  # the depth of rmw's profile for sensor data (REP 2003), as is the best effort


class StereoInput:
    """Subscribes to the stereo camera; the callbacks only pair and enqueue.

    Subscriptions are best effort, which matches every publisher; ``qos_overrides.*`` parameters
    change that. Pairs are kept only between :meth:`begin` and :meth:`end`.

    Args:
        node: The node.
        config: Its configuration.
    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self._node = node
        self._pairer: StampPairer[Any] = StampPairer()
        self._arrived = threading.Condition()
        self._pending: deque[StampedPair[Any]] = deque()
        self._wanted = False
        self._stopped = False
        self._infos: dict[str, Any] = {}
        self.configure(config)
        # One group for all: stamps must reach the pairer in order of arrival.
        group = MutuallyExclusiveCallbackGroup()
        self._images, self._info_topics = [], []
        for side in SIDES:
            topic = f"{side}/image_rect"
            kind = Image
            if config.image_transport == "compressed":
                # As image_transport has it: the suffix goes behind the remapped name.
                topic, kind = f"{node.resolve_topic_name(topic)}/compressed", CompressedImage
            self._images.append(self._subscribe(kind, topic, self._image_callback(side), group))
            self._info_topics.append(
                self._subscribe(CameraInfo, f"{side}/camera_info", self._info_callback(side), group)
            )

    def _subscribe(self, kind: type, topic: str, callback: Any, group: Any) -> Subscription:
        # One profile each: rclpy writes the overrides of a topic into the profile it is given.
        profile = QoSProfile(depth=_QUEUE, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        return self._node.create_subscription(
            kind,
            topic,
            callback,
            profile,
            callback_group=group,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    @property
    def topics(self) -> Topics:
        """Full names of the topics: images left and right, CameraInfo left and right."""
        return Topics(*(subscription.topic_name for subscription in (*self._images, *self._info_topics)))

    def publishers(self, topic: str) -> int:
        """Return how many publishers a topic has."""
        return int(self._node.count_publishers(topic))

    @property
    def state(self) -> InputState:
        """Counts so far."""
        with self._arrived:
            return InputState(self._pairer.counts, self._pairer.nearest_s)

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._stopped

    @property
    def camera_infos(self) -> tuple[Any, Any]:
        """The last CameraInfo of the left and of the right camera, None where none came."""
        with self._arrived:
            return self._infos.get("left"), self._infos.get("right")

    def configure(self, config: NodeConfig) -> None:
        """Take over changed parameters."""
        with self._arrived:
            self._pairer.configure(
                config.approximate_sync, config.approximate_sync_tolerance_seconds, config.queue_size
            )
            # The oldest go first when the calibrator is slower than the camera.
            self._pending = deque(self._pending, maxlen=config.queue_size)

    def begin(self) -> None:
        """Keep pairs from now on; those from before are forgotten."""
        with self._arrived:
            self._pairer.flush()
            self._pairer.forget_nearest()
            self._pending.clear()
            self._wanted = True

    def end(self) -> None:
        """Keep no more pairs."""
        with self._arrived:
            self._wanted = False
            self._pending.clear()

    def stop(self) -> None:
        """Wake whoever waits for a pair: the node shuts down."""
        with self._arrived:
            self._stopped = True
            self._arrived.notify_all()

    def next_pair(self, timeout_s: float) -> StampedPair[Any] | None:
        """Wait for the next pair and return it, None when none came in time or the node shuts down.

        Args:
            timeout_s: How long to wait [s]; 0 returns at once.
        """
        deadline = time.monotonic() + timeout_s
        with self._arrived:
            while not self._pending and not self._stopped:
                left_s = deadline - time.monotonic()
                if left_s <= 0 or not self._arrived.wait(left_s):
                    # A pair may be waiting for a nearer partner that will not come.
                    self._pending.extend(self._pairer.flush())
                    break
            return self._pending.popleft() if self._pending and not self._stopped else None

    def _image_callback(self, side: str) -> Any:
        def received(message: Any) -> None:
            with self._arrived:
                add = self._pairer.add_left if side == "left" else self._pairer.add_right
                pairs = add(message_stamp_ns(message), message)
                if self._wanted and pairs:
                    self._pending.extend(pairs)
                    self._arrived.notify_all()

        return received

    def _info_callback(self, side: str) -> Any:
        def received(message: Any) -> None:
            with self._arrived:
                self._infos[side] = message

        return received
