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

"""The node in the process of a test: messages go straight into its callbacks, and what it sends is kept."""

import itertools
import math
import threading
import time
from collections import deque

import rclpy
from call_making import ANY_STD
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl import rcutils_logger
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from ros_graph import NAME, PATIENCE_S
from std_srvs.srv import Trigger

from stereo_selfcal.ros.selfcal import SelfcalNode


class NodeInProcess:
    """The node, spun in a thread of its own, without a graph around it; use it in a ``with`` statement.

    Its parameters are given as keywords, None for one that is not to be given; those of rclpy's Node
    (``namespace``) as ``options``.

    Attributes:
        selfcal: The node.
        sent: What it published: (topic, message), the newest at the end.
        logged: The lines of its log that were not throttled.
    """

    def __init__(self, options=None, **parameters):
        self._options = options or {}
        self.sent, self.logged, self._failures = deque(maxlen=1000), deque(maxlen=1000), []
        quick = {"output_path": "", "timeout_s": 0.1, "monitor_period_s": 0.0, **ANY_STD}
        self._parameters = {**quick, **parameters}
        self._write_log = rcutils_logger._rclpy.rclpy_logging_rcutils_log

    def __enter__(self):
        # Below the throttling, which knows callers by the line they stand in.
        write, logged = self._write_log, self.logged

        def keep(severity, name, message, *where):
            logged.append(message)
            write(severity, name, message, *where)

        rcutils_logger._rclpy.rclpy_logging_rcutils_log = keep
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        overrides = [
            Parameter(name, value=value) for name, value in self._parameters.items() if value is not None
        ]
        try:
            self.selfcal = SelfcalNode(parameter_overrides=overrides, **self._options)
        except Exception:
            rclpy.try_shutdown()
            rcutils_logger._rclpy.rclpy_logging_rcutils_log = self._write_log
            raise
        self.node = self.selfcal.node
        for publisher in self.node.publishers:
            self._listen(publisher)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.selfcal.stop()
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        rclpy.try_shutdown()
        rcutils_logger._rclpy.rclpy_logging_rcutils_log = self._write_log

    def _listen(self, publisher):
        publish, topic = publisher.publish, publisher.topic_name

        def keep(message):
            self.sent.append((topic, message))
            publish(message)

        publisher.publish = keep

    def _spin(self):
        try:
            self._executor.spin()
        except Exception as error:  # noqa: BLE001 - shown by check()
            self._failures.append(error)

    def send(self, topic, message):
        """Hand a message to whoever in the node has subscribed to the topic."""
        for subscription in list(self.node.subscriptions):
            if subscription.topic_name == topic:
                subscription.callback(serialize_message(message) if subscription.raw else message)

    def calibrate(self, messages=()):
        """Call ~/calibrate, send messages meanwhile, and return the answer.

        Args:
            messages: (topic, message) sent over and over; or a function of the number of the round,
                from 0 on, that returns those of this round.
        """
        return self._while_sending(
            lambda: self.serve("calibrate", Trigger.Request(), Trigger.Response()), messages
        )

    def serve(self, name, request, response):
        """Return what a service of the node answers."""
        service = next(s for s in self.node.services if s.srv_name.endswith(f"/{name}"))
        return service.callback(request, response)

    def _while_sending(self, function, messages):
        results = []
        thread = threading.Thread(target=lambda: results.append(function()))
        thread.start()
        deadline = time.monotonic() + PATIENCE_S
        for number in itertools.count():
            if not thread.is_alive():
                break
            assert time.monotonic() < deadline, "no answer"
            for topic, message in messages(number) if callable(messages) else messages:
                self.send(topic, message)
            thread.join(0.01)
        (result,) = results  # none: the function raised
        return result

    @property
    def calibrated_frames(self):
        """How many frames went through the calibrator."""
        return self.selfcal._record.statistics.total

    def draw(self, messages=()):
        """Have both pictures drawn as if somebody looked at them, while messages come."""
        for publisher in self.node.publishers:
            if publisher.topic_name in (f"{NAME}/debug_image", f"{NAME}/birds_eye"):
                publisher.get_subscription_count = lambda: 1
        self._while_sending(self.selfcal._views.step, messages)

    def report(self):
        """Have every timer of the node do its work once: the diagnostics."""
        for timer in self.node.timers:
            timer.callback()

    def check(self, longest_text=4000):
        """Fail if a callback failed, or if anything new that was sent or logged is not finite or endless."""
        assert not self._failures, self._failures
        assert self._thread.is_alive()
        while self.sent:
            topic, message = self.sent.popleft()
            for path, value in leaves(message):
                if isinstance(value, float):
                    assert math.isfinite(value), f"{topic}: {path} is {value}"
                if isinstance(value, str):
                    assert len(value) <= longest_text, f"{topic}: {path} has {len(value)} characters"
        while self.logged:
            line = self.logged.popleft()
            assert len(line) <= longest_text, f"{len(line)} characters in the log: {line[:100]}"
            assert "Traceback" not in line, line


def leaves(message, path=""):
    """Yield (path, value) of every number and text in a message, but for the pixels of images."""
    if hasattr(message, "get_fields_and_field_types"):
        for name in message.get_fields_and_field_types():
            yield from leaves(getattr(message, name), f"{path}.{name}")
    elif isinstance(message, str | bytes | bool | int | float):
        yield path, message
    elif getattr(message, "typecode", "") not in ("B", "b"):
        for index, value in enumerate(message):
            yield from leaves(value, f"{path}[{index}]")
