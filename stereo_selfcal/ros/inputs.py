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

"""The node's input: subscriptions, intake of the images and CameraInfo, put together."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import Any

from rclpy.node import Node

from ..core.camera.camera_difference import check_steady
from ..core.camera.camera_info_history import CameraInfoHistory
from ..core.camera.pairing import StampedPair
from ..core.camera.stamp_pattern import StampPattern
from ..core.geometry.homography import SIDES, Side
from .config import NodeConfig
from .intake import ImageFormat, ImageIntake, IntakeWindow
from .memory import HeapTrimmer
from .pair_source import InputState, Topics
from .subscriptions import CameraSubscriptions
from .taking import MessageTaker

# A CameraInfo is kept for as long as its images may wait for the calibrator.
_KEEP_NS = 10_000_000_000
# A CameraInfo may arrive later than its image by so much. After a wait in vain, none is waited for until
# another one has come: some publishers send it only once.
_LATE_S = 0.1


class CameraInfos:
    """Keeps the CameraInfo of each camera; safe to be used by several threads.

    Args:
        rectified: Whether the images are rectified.
    """

    def __init__(self, rectified: bool = True) -> None:
        self._lock = threading.Condition()
        self._late = False
        self._kept: dict[Side, CameraInfoHistory] = {
            side: CameraInfoHistory(_KEEP_NS, rectified) for side in SIDES
        }

    @property
    def last(self) -> tuple[Any, Any]:
        """That of the left and of the right camera, None where none came."""
        with self._lock:
            return self._kept["left"].last, self._kept["right"].last

    @property
    def missing(self) -> tuple[bool, bool]:
        """Whether that of the left and of the right camera has not come yet."""
        left, right = self.last
        return left is None, right is None

    def keep(self, side: Side, message: Any) -> None:
        """Keep a CameraInfo, and wake who waits for it."""
        with self._lock:
            self._kept[side].add(message, time.monotonic_ns())
            self._late = False
            self._lock.notify_all()

    def of(self, pair: StampedPair[Any]) -> tuple[Any, Any]:
        """Return those that hold for a pair, None where none came; wait a little for those of its stamps."""
        stamps_ns = pair.left_stamp_ns, pair.right_stamp_ns
        both = self._kept["left"], self._kept["right"]

        def arrived() -> bool:
            lasts = [history.last_stamp_ns for history in both]
            return all(
                last is not None and last >= stamp for last, stamp in zip(lasts, stamps_ns, strict=True)
            )

        with self._lock:
            if not self._late:
                self._late = not self._lock.wait_for(arrived, _LATE_S)
            now_ns = time.monotonic_ns()
            left, right = (h.at(stamp, now_ns) for h, stamp in zip(both, stamps_ns, strict=True))
        return left, right

    def check(self, topics: Topics, rectified: bool) -> None:
        """Refuse CameraInfo of a topic that alternates.

        Raises:
            CameraInfoError: It does, as that of two publishers on one topic.
        """
        with self._lock:
            for side, topic in zip(SIDES, (topics.left_info, topics.right_info), strict=True):
                check_steady(self._kept[side], topic, side, rectified)

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            for history in self._kept.values():
                history.clear()


class StereoInput:
    """Subscribes to the stereo camera while images are wanted; a thread of its own takes, pairs and enqueues.

    Pairs are kept only between :meth:`begin` and :meth:`end`. While no image is wanted, none is taken, though
    the subscriptions may stay. CameraInfo is subscribed to until one has come, too: some publishers send it
    only once.

    Args:
        node: The node.
        config: Its configuration.
    """

    def __init__(self, node: Node, config: NodeConfig) -> None:
        self._intake = ImageIntake(config)
        self._rectified = config.rectified  # it never changes
        self._infos = CameraInfos(config.rectified)
        self._subscriptions = CameraSubscriptions(
            node,
            config,
            on_image=self._intake.add,
            on_camera_info=self._infos.keep,
            images_wanted=lambda: self._intake.is_open,
            infos_wanted=lambda: self._intake.is_open or any(self._infos.missing),
        )
        self._taker = MessageTaker(node, self._subscriptions.to_take)
        self._heap = HeapTrimmer()
        self._switching = threading.Lock()
        self.tick()

    def start(self) -> None:
        """Take messages until :meth:`stop`."""
        self._taker.start()

    @property
    def topics(self) -> Topics:
        """Full names of the topics: images left and right, CameraInfo left and right."""
        return self._subscriptions.topics

    def publishers(self, topic: str) -> int:
        """Return how many publishers a topic has."""
        return self._subscriptions.publishers(topic)

    @property
    def state(self) -> InputState:
        """Counts so far; and, while one side sends no image, the mismatches that may be the cause."""
        state, window = self._intake.state, self._intake.window
        if any(self._infos.missing):
            state = replace(state, info_mismatches=self._subscriptions.info_mismatches())
        if window is None:
            return state
        added = state.counts.since(window.counts)
        if added.left and added.right:
            return state
        return replace(state, mismatches=self._subscriptions.mismatches())

    @property
    def pattern(self) -> StampPattern:
        """Why the images since the last pair, or since :meth:`begin`, formed none."""
        return self._intake.pattern

    @property
    def window(self) -> IntakeWindow | None:
        """The span in which images are taken now, None while they are not taken."""
        return self._intake.window

    @property
    def formats(self) -> dict[Side, ImageFormat]:
        """Format of the last image of each side."""
        return self._intake.formats

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._intake.stopped

    @property
    def camera_infos(self) -> tuple[Any, Any]:
        """The last CameraInfo of the left and of the right camera, None where none came."""
        return self._infos.last

    def camera_infos_of(self, pair: StampedPair[Any]) -> tuple[Any, Any]:
        """Return the CameraInfo that hold for the images of a pair, None where none came.

        Raises:
            CameraInfoError: That of a topic alternates.
        """
        infos = self._infos.of(pair)
        self._infos.check(self.topics, self._rectified)
        return infos

    def configure(self, config: NodeConfig) -> None:
        """Take over changed parameters."""
        self._intake.configure(config)

    def begin(self) -> None:
        """Keep pairs from now on; those from before are forgotten."""
        self._intake.begin()
        self.tick()

    def end(self) -> None:
        """Keep no more pairs."""
        self._intake.end()

    def tick(self) -> None:
        """Subscribe and take images, or end both, as the schedule says; to be called once a second."""
        with self._switching:
            if self.stopped:
                return
            topics = self.topics
            publishers = (self.publishers(topics.left), self.publishers(topics.right))
            subscribe, take = self._intake.update_schedule(publishers)
            if take and not self._intake.is_open:
                self._subscriptions.drop_old_images()
            self._intake.open_or_close(take)
            left_missing, right_missing = self._infos.missing
            self._subscriptions.switch(subscribe, (subscribe or left_missing, subscribe or right_missing))
            self._taker.wake()
            self._heap.tick(subscribed=subscribe)

    def next_pair(self, timeout_s: float) -> StampedPair[Any] | None:
        """Wait for the next pair and return it, None when none came in time or nobody is to wait any more.

        Args:
            timeout_s: How long to wait [s]; 0 returns at once.
        """
        return self._intake.next_pair(timeout_s)

    def interrupt(self) -> None:
        """Wake whoever waits for a pair; there is none until :meth:`begin`."""
        self._intake.interrupt()

    def stop(self) -> None:
        """Take no more messages, and wake whoever waits for a pair: the node shuts down."""
        with self._switching:
            self._intake.stop()
        self._taker.stop()
