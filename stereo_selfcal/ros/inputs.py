"""The node's subscriptions: images paired as they come, and the last CameraInfo of each camera."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    QoSCompatibility,
    QoSHistoryPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from ..core.camera.pairing import PairCounts, StampedPair, StampPairer, message_stamp_ns
from .calibration import InputState, Topics
from .config import NodeConfig
from .listening import SubscriptionSchedule
from .memory import trim_heap

SIDES = ("left", "right")

# What rmw calls the node of a publisher that was discovered before its node was.
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
_LONGEST_FORMAT = 80  # of what is reported once a second; a message may hold any text
_QUEUE = 5  # the depth of rmw's profile for sensor data (REP 2003), as is the best effort
# A tick later than the one that unsubscribes: an image may still be in a callback then.
_TRIM_HEAP_TICK = 2


@dataclass(frozen=True, slots=True)
class Look:
    """Since when images are taken: the first one that arrived then, or as long as none has, the beginning.

    Attributes:
        counts: Images and pairs up to then.
        since_s: Steady time [s].
    """

    counts: PairCounts
    since_s: float


class _Gate(MutuallyExclusiveCallbackGroup):  # type: ignore[misc]
    """Callbacks one at a time, and none while it is closed.

    The executor takes no message then. DDS keeps the newest few, which costs a tenth of taking them all.
    """

    def __init__(self, is_open: Callable[[], bool]) -> None:
        super().__init__()
        self._is_open = is_open

    def can_execute(self, entity: Any) -> bool:
        """Return whether a callback may run now."""
        return self._is_open() and bool(super().can_execute(entity))


class StereoInput:
    """Subscribes to the stereo camera while images are wanted; the callbacks only pair and enqueue.

    Subscriptions are best effort, which matches every publisher; ``qos_overrides.*`` parameters
    change that. Pairs are kept only between :meth:`begin` and :meth:`end`. A CameraInfo is listened to
    also as long as none has come: it may be sent once only. Between two moments in which images are wanted
    they are not taken, though the subscriptions stay.

    Args:
        node: The node.
        config: Its configuration.
    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self._node = node
        self._pairer: StampPairer[Any] = StampPairer()
        self._arrived = threading.Condition()
        self._pending: deque[StampedPair[Any]] = deque()
        self._stopped = False
        self._infos: dict[str, Any] = {}
        self._formats: dict[str, tuple[int, int, str]] = {}
        self._listening = SubscriptionSchedule()
        self._look: Look | None = None
        self._taking = False
        self._ticks_off = 0
        self._switching = threading.Lock()
        self._subscribed: dict[str, Subscription] = {}
        self._profiles: dict[str, QoSProfile] = {}
        self.configure(config)
        compressed = config.image_transport == "compressed"
        self._kind: type = CompressedImage if compressed else Image
        leaf = "image_rect" if config.rectified else "image_raw"
        # Names as they were before remapping, as that must not happen twice.
        self._names = [f"{side}/{leaf}" for side in SIDES]
        if compressed:  # as image_transport has it: the suffix goes behind the remapped name
            self._names = [f"{node.resolve_topic_name(name)}/compressed" for name in self._names]
        self._names += [f"{side}/camera_info" for side in SIDES]
        self._topics = Topics(*map(node.resolve_topic_name, self._names))
        self.tick()

    @property
    def topics(self) -> Topics:
        """Full names of the topics: images left and right, CameraInfo left and right."""
        return self._topics

    def publishers(self, topic: str) -> int:
        """Return how many publishers a topic has."""
        return int(self._node.count_publishers(topic))

    @property
    def state(self) -> InputState:
        """Counts so far."""
        with self._arrived:
            state = InputState(self._pairer.counts, self._pairer.nearest_s)
        look = self._look
        if look is None:
            return state
        added = state.counts.since(look.counts)
        return state if added.left and added.right else replace(state, mismatches=self.mismatches())

    @property
    def look(self) -> Look | None:
        """Since when images are taken, None while they are not."""
        return self._look

    @property
    def formats(self) -> dict[str, tuple[int, int, str]]:
        """Width, height and encoding of the last image of each side; of compressed ones 0, 0, the format."""
        with self._arrived:
            return dict(self._formats)

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._stopped

    @property
    def camera_infos(self) -> tuple[Any, Any]:
        """The last CameraInfo of the left and of the right camera, None where none came."""
        with self._arrived:
            return self._infos.get("left"), self._infos.get("right")

    def mismatches(self) -> tuple[str, ...]:
        """Return sentences about publishers that nothing can be received from, by their type or QoS."""
        found = []
        for topic, kind in self._kinds():
            for publisher in self._node.get_publishers_info_by_topic(topic):
                name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
                if publisher.node_name == _UNKNOWN_NODE:
                    name = "a node not known by name yet"
                wanted = f"sensor_msgs/msg/{kind.__name__}"
                compatible, reason = qos_check_compatible(publisher.qos_profile, self._profiles[topic])
                if publisher.topic_type != wanted:
                    found.append(f"{name} publishes {publisher.topic_type} on {topic}, {wanted} is read")
                elif compatible == QoSCompatibility.ERROR:
                    why = " ".join(reason.replace("ERROR:", "").split()).rstrip(";")
                    found.append(
                        f"{name} publishes {topic} with a QoS that does not match ({why}): set "
                        f"qos_overrides.{topic}.subscription.*"
                    )
        return tuple(found)

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
            self._listening.want()
        self.tick()

    def end(self) -> None:
        """Keep no more pairs."""
        with self._arrived:
            self._listening.release(time.monotonic())
            self._pending.clear()
            self._open_or_close(self._taking)

    def tick(self) -> None:
        """Subscribe and take images, or leave it, when it is time to; to be called once a second."""
        with self._switching:
            if self._stopped:
                return
            publishers = tuple(self.publishers(topic) for topic in self._topics[:2])
            with self._arrived:
                on = self._listening.due(time.monotonic(), publishers)
                # Whoever wants images from here on comes for a tick of his own.
                taking = self._listening.taking
            opening = taking and not self._taking
            if opening:
                self._drop_old_images()
            with self._arrived:
                self._open_or_close(taking)
            self._switch(on)
            executor = self._node.executor
            if opening and executor is not None:
                executor.wake()  # it waits without these subscriptions
            self._ticks_off = 0 if on else self._ticks_off + 1
            if self._ticks_off == _TRIM_HEAP_TICK:
                trim_heap()

    def stop(self) -> None:
        """Wake whoever waits for a pair: the node shuts down."""
        with self._switching, self._arrived:
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

    def _kinds(self) -> list[tuple[str, type]]:
        """Return all topics with the type that is read there."""
        return list(zip(self._topics, (self._kind, self._kind, CameraInfo, CameraInfo), strict=True))

    def _open_or_close(self, taking: bool) -> None:
        """Take images from now on, if they still are to be taken, or leave them; callers lock."""
        self._taking = taking and self._listening.taking
        if not self._taking:
            self._look = None
            self._pairer.forget_waiting()
        elif self._look is None:
            self._look = Look(self._pairer.counts, time.monotonic())

    def _drop_old_images(self) -> None:
        """Drop what DDS has kept of the images that were not taken: whoever wants images means new ones."""
        for topic in self._topics[:2]:
            subscription = self._subscribed.get(topic)
            if subscription is None:
                continue
            with subscription.handle:
                for _ in range(_QUEUE):
                    if subscription.handle.take_message(subscription.msg_type, False) is None:
                        break

    def _images_wait(self) -> bool:
        """Return whether DDS keeps few images while they are not taken; qos_overrides may ask for many."""
        profiles = filter(None, map(self._profiles.get, self._topics[:2]))
        return all(p.history == QoSHistoryPolicy.KEEP_LAST and p.depth <= _QUEUE for p in profiles)

    def _switch(self, on: bool) -> None:
        """Make the subscriptions that are needed now, and drop the others."""
        with self._arrived:
            missing = [self._infos.get(side) is None for side in SIDES]
        wanted = dict(zip(self._topics, (on, on, on or missing[0], on or missing[1]), strict=True))
        callbacks = [*map(self._image_callback, SIDES), *map(self._info_callback, SIDES)]
        # One group for both cameras: stamps must reach the pairer in order of arrival. And one for each time,
        # as a group of rclpy remembers for ever what it once had.
        images = _Gate(lambda: self._taking or not self._images_wait())
        infos = _Gate(lambda: self._taking or None in self.camera_infos)
        groups = (images, images, infos, infos)
        for name, (topic, kind), callback, group in zip(
            self._names, self._kinds(), callbacks, groups, strict=True
        ):
            if wanted[topic] and topic not in self._subscribed:
                self._subscribed[topic] = self._subscribe(kind, name, topic, callback, group)
            elif not wanted[topic] and topic in self._subscribed:
                self._node.destroy_subscription(self._subscribed.pop(topic))

    def _subscribe(self, kind: type, name: str, topic: str, callback: Any, group: Any) -> Subscription:
        overriding = None
        if topic not in self._profiles:
            # One profile each: rclpy writes the overrides of a topic into the profile it is given.
            profile = QoSProfile(depth=_QUEUE, reliability=QoSReliabilityPolicy.BEST_EFFORT)
            self._profiles[topic] = profile
            overriding = QoSOverridingOptions.with_default_policies()
        return self._node.create_subscription(
            kind,
            name,
            callback,
            self._profiles[topic],
            callback_group=group,
            # Handlers of events cannot be destroyed while an executor waits; mismatches() says more.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=overriding,
        )

    def _image_callback(self, side: str) -> Any:
        def received(message: Any) -> None:
            with self._arrived:
                add = self._pairer.add_left if side == "left" else self._pairer.add_right
                pairs = add(message_stamp_ns(message), message)
                self._formats[side] = _format(message)
                now_s = time.monotonic()
                if self._listening.arrived(now_s, bool(pairs)) and self._look is not None:
                    self._look = Look(self._pairer.counts, now_s)
                if self._listening.wanted and pairs:
                    self._pending.extend(pairs)
                    self._arrived.notify_all()

        return received

    def _info_callback(self, side: str) -> Any:
        def received(message: Any) -> None:
            with self._arrived:
                self._infos[side] = message

        return received


def _format(message: Any) -> tuple[int, int, str]:
    if isinstance(message, CompressedImage):
        return 0, 0, str(message.format)[:_LONGEST_FORMAT]
    return int(message.width), int(message.height), str(message.encoding)[:_LONGEST_FORMAT]
