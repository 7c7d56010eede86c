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

"""What the tests over DDS share: the node as a real process, and a camera that publishes rendered frames."""

import array
import math
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from ros_domain import own_domain

# Before anything opens DDS: on this machine only, in a domain of this process's own.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(own_domain())

import cv2
import numpy as np
import rclpy
from call_making import ANY_STD
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.geometry.homography import SIDES
from stereo_selfcal.files.saved_result import RESULT_NAMES
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

ROOT = Path(__file__).resolve().parent.parent
NAME = "/stereo_selfcal"
RIG = PAPER_RIG
RESULTS = [f"extrinsics.{name}" for name in RESULT_NAMES]
TRUTH = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))  # of the scene straight_road

# For a machine that does much else at the time; nothing here is asserted to be quick.
PATIENCE_S = 90.0
PERIOD_S = 0.1
# For calls that are to fail, though images have to arrive: long enough on a busy machine.
SHORT_S = 4.0
LONG_S = 40.0
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class NodeProcess:
    """The node as a process of its own; ends it as Ctrl-C would."""

    def __init__(self, tmp_path, parameters=None, arguments=()):
        command = [sys.executable, "-m", "stereo_selfcal", "node", "--ros-args", *arguments]
        quick = {"output_path": "''", "timeout_s": PATIENCE_S, **ANY_STD}
        for name, value in {**quick, **(parameters or {})}.items():
            command += ["-p", f"{name}:={value}"]
        self.log = Path(tmp_path, "node.log")
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command, cwd=ROOT, stdout=log, stderr=log, env={**os.environ, "PYTHONUNBUFFERED": "1"}
            )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.end()

    @property
    def output(self):
        return self.log.read_text(encoding="utf-8", errors="replace")

    def end(self, how=signal.SIGINT):
        """Send a signal and return the exit status."""
        self.process.send_signal(how)
        return self.wait()

    def wait(self):
        try:
            return self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise


class Graph:
    """A node of the test process, spun in a thread, with clients of the node under test."""

    def __init__(self):
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self.node = Node("tester")
        self.clients = {}
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def close(self):
        self.executor.shutdown()
        self.thread.join()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def destroy(self, destroy, *entities):
        """Destroy entities in the thread that spins: it must not meet one half destroyed."""

        def destroy_all():
            for entity in entities:
                destroy(entity)

        wait_for(self.executor.create_task(destroy_all))

    def start(self, kind, name, request):
        """Send a request as soon as the service is there and return the future."""
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, f"{NAME}/{name}")
        client = self.clients[name]
        assert client.wait_for_service(PATIENCE_S), f"{name} is not offered"
        return client.call_async(request)

    def call(self, kind, name, request):
        """Return the answer of a parameter service; asks again, as DDS may lose it to a new client."""
        for _ in range(4):
            future = self.start(kind, name, request)
            deadline = time.monotonic() + PATIENCE_S / 4
            while not future.done() and time.monotonic() < deadline:
                time.sleep(0.02)
            if future.done():
                return future.result()
        raise AssertionError(f"no answer of {name} in {PATIENCE_S} s")

    def start_calibrate(self):
        return self.start(Trigger, "calibrate", Trigger.Request())

    def calibrate(self):
        return wait_for(self.start_calibrate())

    def parameters(self, *names):
        values = self.call(GetParameters, "get_parameters", GetParameters.Request(names=list(names))).values
        return [parameter_value_to_python(value) for value in values]

    def describe(self, *names):
        request = DescribeParameters.Request(names=list(names))
        return self.call(DescribeParameters, "describe_parameters", request).descriptors

    def list_parameters(self):
        return set(self.call(ListParameters, "list_parameters", ListParameters.Request()).result.names)

    def set_parameter(self, name, value):
        message = value if not isinstance(value, bool | int | float | str) else None
        message = message or Parameter(name, value=value).to_parameter_msg()
        return self.call(
            SetParameters, "set_parameters", SetParameters.Request(parameters=[message])
        ).results[0]

    def latest(self, kind, name):
        """Return the latched message of a topic, as a late subscriber gets it; None without one."""
        received = []
        subscription = self.node.create_subscription(kind, f"{NAME}/{name}", received.append, LATCHED)
        try:
            wait_until(subscription.get_publisher_count, f"a publisher of {name}")
            deadline = time.monotonic() + 3.0
            while not received and time.monotonic() < deadline:
                time.sleep(0.05)
            return received[-1] if received else None
        finally:
            self.destroy(self.node.destroy_subscription, subscription)

    def wait_for_diagnostics(self, accept):
        """Return the first diagnostic status for which ``accept(values, status)`` holds.

        A status without a key that ``accept`` asks for is another one than is meant.
        """
        found = []

        def received(message):
            for status in message.status:
                with suppress(KeyError):
                    if accept({pair.key: pair.value for pair in status.values}, status):
                        found.append(status)

        subscription = self.node.create_subscription(DiagnosticArray, "/diagnostics", received, 10)
        try:
            wait_until(lambda: found, "the diagnostics that are waited for")
            return found[0]
        finally:
            self.destroy(self.node.destroy_subscription, subscription)


class Camera:
    """Publishes frames over and over, 10 Hz, each pass with later stamps; use it in a ``with`` statement.

    Where another camera has published before, ``first`` keeps the stamps apart: what is still on its way from
    there would pair with images of this one.
    """

    def __init__(self, graph, frames, encoding="mono8", sides=SIDES, infos=SIDES, right_late_ns=0, first=0):
        self.graph, self.frames, self.encoding, self.sides = graph, frames, encoding, sides
        self.first = first
        self.right_late_ns = right_late_ns
        kind, suffix = (CompressedImage, "/compressed") if encoding == "png" else (Image, "")
        node = graph.node
        self.images = {s: node.create_publisher(kind, f"/{s}/image_rect{suffix}", 10) for s in sides}
        self.infos = {s: node.create_publisher(CameraInfo, f"/{s}/camera_info", 10) for s in infos}
        self.stopped = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stopped.set()
        self.thread.join()
        self.graph.destroy(self.graph.node.destroy_publisher, *self.images.values(), *self.infos.values())

    def _run(self):
        messages = [
            {side: image_message(pixels, self.encoding) for side, pixels in zip(SIDES, frame, strict=True)}
            for frame in self.frames
        ]
        infos = {side: info_message(side) for side in SIDES}
        index = self.first
        while not self.stopped.wait(PERIOD_S):
            for side in SIDES:
                stamp_ns = stamp_of(index) + (self.right_late_ns if side == "right" else 0)
                self._publish(self.infos.get(side), infos[side], stamp_ns)
                self._publish(self.images.get(side), messages[index % len(messages)][side], stamp_ns)
            index += 1

    @staticmethod
    def _publish(publisher, message, stamp_ns):
        if publisher is not None:
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            publisher.publish(message)


def stamp_of(index):
    """Return the stamp [ns] of the frame with this number: no short decimal, so that rounding would show."""
    return 1_700_000_000_000_000_000 + index * 100_000_007


def image_message(pixels, encoding="mono8"):
    """Return (H, W) uint8 pixels as a message in any encoding."""
    height, width = pixels.shape
    if encoding == "png":
        data = cv2.imencode(".png", pixels)[1].tobytes()
        return CompressedImage(format="mono8; png compressed ", data=data)
    values = {
        "mono8": lambda: pixels,
        "mono16": lambda: pixels.astype("<u2") * 256 + 17,
        "bgr8": lambda: np.repeat(pixels[:, :, None], 3, axis=2),
        "rgba8": lambda: np.repeat(pixels[:, :, None], 4, axis=2),
        "bayer_rggb8": lambda: pixels,
        "yuv422": lambda: np.repeat(pixels[:, :, None], 2, axis=2),
    }[encoding]()
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, 4)))  # a driver that aligns its rows
    return Image(height=height, width=width, encoding=encoding, step=padded.shape[1], data=bytes_of(padded))


def bytes_of(pixels):
    """Return uint8 pixels as the field of a message; rclpy looks at every single one of other kinds."""
    return array.array("B", pixels.tobytes())


def info_message(side, rig=RIG):
    shift = -rig.fx * rig.baseline_m if side == "right" else 0.0
    return CameraInfo(
        width=rig.width,
        height=rig.height,
        k=[rig.fx, 0.0, rig.cx, 0.0, rig.fy, rig.cy, 0.0, 0.0, 1.0],
        r=np.eye(3).ravel(),
        p=[rig.fx, 0.0, rig.cx, shift, 0.0, rig.fy, rig.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


@cache
def rendered(scene="straight_road", index=0):
    """Return (left, right) of one frame of a named scene."""
    frame = named_scene(scene).frame(index)
    return frame.left, frame.right


def assert_near_truth(extrinsics):
    """Fail if an estimate from ``straight_road`` is off."""
    assert abs(extrinsics.height_m - TRUTH.height_m) < 0.01
    assert abs(extrinsics.pitch_rad - TRUTH.pitch_rad) < math.radians(0.05)
    assert abs(extrinsics.roll_rad - TRUTH.roll_rad) < math.radians(0.3)


def blank():
    return (np.full((RIG.height, RIG.width), 90, np.uint8),) * 2


def wait_for(future):
    wait_until(future.done, "an answer")
    return future.result()


def wait_until(condition, what):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"waited {PATIENCE_S} s for {what}"
        time.sleep(0.02)
