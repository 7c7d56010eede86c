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

"""Takes the messages of a camera from DDS in a thread of its own, as many at a time as have come.

An executor of rclpy looks at all services, timers and subscriptions of the node twice for each message: 0.6
ms for one whose taking costs 0.3 ms. The left and the right image and both CameraInfo of a moment are four
messages. Here they are waited for and taken together.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription

# From the first message of a moment to its last: a camera publishes both images one after the other.
_TOGETHER_S = 0.004
_LOG_PERIOD_S = 5.0
# A wait ends after this time without a message, so that a shutdown nobody tells of is noticed [ns].
_PATIENCE_NS = 1_000_000_000


class TakenElsewhere(CallbackGroup):  # type: ignore[misc]  # rclpy has no types
    """The group of subscriptions that no executor takes from, nor waits for."""

    def can_execute(self, entity: Any) -> bool:
        """Return that no callback may run."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return that no callback may run."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: none has run."""


class MessageTaker:
    """Waits for messages and calls the callbacks of their subscriptions, one at a time, in its own thread.

    Args:
        node: The node of the subscriptions.
        wanted: Returns those to take from now, in :class:`TakenElsewhere`. Asked before each round, in which
            one message of each is taken, so that callbacks are called in order of arrival.
    """

    def __init__(self, node: Node, wanted: Callable[[], Sequence[Subscription]]) -> None:
        self._node = node
        self._wanted = wanted
        self._stopped = threading.Event()
        self._changed = GuardCondition(None, None, context=node.context)
        self._thread = threading.Thread(target=self._run, name="images", daemon=True)

    def start(self) -> None:
        """Take messages until :meth:`stop`."""
        self._thread.start()

    def wake(self) -> None:
        """Have it ask anew which subscriptions to take from, and let go of those that were destroyed."""
        if not self._stopped.is_set():
            self._changed.trigger()

    def stop(self) -> None:
        """Take no more messages, and wait for the callback that runs."""
        if self._stopped.is_set():
            return
        self._changed.trigger()
        self._stopped.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()
        self._changed.destroy()

    def _run(self) -> None:
        while self._node.context.ok() and not self._stopped.is_set():
            try:
                if self._wait(self._wanted()):
                    self._stopped.wait(_TOGETHER_S)
                    while self._take_one_each():
                        pass
            except Exception:  # noqa: BLE001 - one bad message must not end the taking
                if self._node.context.ok() and not self._stopped.is_set():
                    self._node.get_logger().error(
                        f"a message could not be taken:\n{traceback.format_exc()}",
                        throttle_duration_sec=_LOG_PERIOD_S,
                    )
                    self._stopped.wait(_TOGETHER_S)

    def _wait(self, subscriptions: Sequence[Subscription]) -> bool:
        """Wait for a message, or for :meth:`wake`; return whether there is a message."""
        context = self._node.context
        with context.handle:
            waits = rclpy_implementation.WaitSet(len(subscriptions), 1, 0, 0, 0, 0, context.handle)
            waits.clear_entities()
            handles = []
            try:
                for subscription in subscriptions:
                    handle = subscription.handle
                    try:
                        handle.__enter__()
                    except InvalidHandle:  # destroyed meanwhile
                        return False
                    handles.append(handle)
                    waits.add_subscription(handle)
                waits.add_guard_condition(self._changed.handle)
                waits.wait(_PATIENCE_NS)
                return bool(waits.get_ready_entities("subscription"))
            finally:
                for handle in handles:
                    handle.__exit__(None, None, None)

    def _take_one_each(self) -> bool:
        """Take one message of each subscription and call back; return whether there was any."""
        found = False
        for subscription in self._wanted():
            if self._stopped.is_set():
                return False
            message = take(subscription)
            if message is not None:
                found = True
                subscription.callback(message)
        return found


def take(subscription: Subscription) -> Any:
    """Return the oldest message that DDS keeps for a subscription; None where there is none."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:  # destroyed meanwhile
        return None
    return None if taken is None else taken[0]
