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

"""Processes on a ROS graph for the benchmarks of the node: cameras, clients, and the node in variants.

``python -m benchmarks.graph WHAT ...`` in the environment with ROS; each prints its findings as JSON.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import struct
import sys
import threading
import time
from array import array
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from stereo_selfcal import Calibrator, StereoRig
from stereo_selfcal.core.road_now import RoadTracker
from stereo_selfcal.files.node_settings import TARGET_NAMES
from stereo_selfcal.ros import node
from stereo_selfcal.ros.intake import ImageIntake
from stereo_selfcal.ros.subscription_schedule import SubscriptionSchedule
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import PAPER_RIG, random_scene

NODE = "/stereo_selfcal"
SIDES = ("left", "right")
RIG = StereoRig(1280, 720, 1033.2, 1033.2, 639.5, 359.5, PAPER_RIG.baseline_m)
FULL_HD = StereoRig(1920, 1080, 1549.8, 1549.8, 959.5, 539.5, PAPER_RIG.baseline_m)
_SENSOR_DATA = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)
_PATIENCE_S = 60.0
DRIVE_HZ = 10.0
# From the first answer on: until each process has sent to the one that asks. Opening the shared memory of a
# newcomer, Fast DDS sleeps for a third of a second in one of three cases or so (healthy_check of its ports),
# in which the process that does it, be it the node or the one that asks, can send nothing.
_JOIN_S = 10.0


def road(rig: StereoRig = RIG) -> dict[str, np.ndarray]:
    """Return a rendered pair."""
    scene = random_scene(np.random.default_rng(0), 0.01, rig)
    return dict(zip(SIDES, render(scene, np.random.default_rng(0)), strict=True))


def camera(hz: float, rig: StereoRig = RIG) -> None:
    """Publish a stereo camera that sees one road until killed; images and CameraInfo at the same rate."""
    pair = road(rig)
    _publish(hz, [tuple(pair[side] for side in SIDES)], rig=rig)


def drive(path: str) -> None:
    """Publish the frames of a file over and over at 10 Hz; print the index and the stamp [ns] of each.

    Args:
        path: A file of NumPy with ``frames`` (N, 2, H, W) uint8.
    """
    stamps: list[int] = []
    try:
        _publish(DRIVE_HZ, list(np.load(path)["frames"]), stamps)
    finally:
        sys.stdout.write(json.dumps(stamps) + "\n")
        sys.stdout.flush()


def _publish(
    hz: float,
    frames: Sequence[Sequence[np.ndarray]],
    stamps: list[int] | None = None,
    rig: StereoRig = RIG,
) -> None:
    """Publish pairs of images over and over until killed, with their CameraInfo.

    Args:
        hz: Pairs per second.
        frames: Left and right image of each.
        stamps: The stamp [ns] of each pair is appended to it.
        rig: The camera.
    """
    ros = Node("camera")
    pairs = {}
    images = {}
    for index, side in enumerate(SIDES):
        images[side] = [array("B", np.ascontiguousarray(frame[index]).tobytes()) for frame in frames]
        image = Image(height=rig.height, width=rig.width, encoding="mono8", step=rig.width)
        shift = -rig.fx * rig.baseline_m if side == "right" else 0.0
        info = CameraInfo(
            width=rig.width,
            height=rig.height,
            distortion_model="plumb_bob",
            d=[0.0] * 5,
            k=[rig.fx, 0.0, rig.cx, 0.0, rig.fy, rig.cy, 0.0, 0.0, 1.0],
            r=np.eye(3).ravel(),
            p=[rig.fx, 0.0, rig.cx, shift, 0.0, rig.fy, rig.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        )
        pairs[side, ros.create_publisher(Image, f"/{side}/image_rect", _SENSOR_DATA)] = image
        pairs["", ros.create_publisher(CameraInfo, f"/{side}/camera_info", _SENSOR_DATA)] = info
    next_s = time.monotonic()
    for number in itertools.count():
        now = ros.get_clock().now()
        if stamps is not None:
            stamps.append(now.nanoseconds)
        for (side, publisher), message in pairs.items():
            if side:
                message.data = images[side][number % len(frames)]
            message.header.stamp = now.to_msg()
            publisher.publish(message)
        next_s = max(next_s + 1.0 / hz, time.monotonic() - 1.0)
        time.sleep(max(0.0, next_s - time.monotonic()))


def ask(seconds: float) -> None:
    """Call get_parameters fifty times a second and print how long each answer took [ms]; see _JOIN_S."""
    ros = Node("asker")
    # In a thread of its own: an executor that is spun for each answer gets slower with every one.
    executor = SingleThreadedExecutor()
    executor.add_node(ros)
    threading.Thread(target=executor.spin, daemon=True).start()
    client = ros.create_client(GetParameters, f"{NODE}/get_parameters")
    request = GetParameters.Request(names=["extrinsics.height_m", "timeout_s"])

    def answer_time_ms() -> float:
        start_s = time.perf_counter()
        answered = threading.Event()
        client.call_async(request).add_done_callback(lambda _: answered.set())
        answered.wait(_PATIENCE_S)
        return 1e3 * (time.perf_counter() - start_s) if answered.is_set() else float("inf")

    def answer_times_ms(duration_s: float) -> list[float]:
        times, end_s = [], time.monotonic() + duration_s
        while time.monotonic() < end_s:
            times.append(answer_time_ms())
            time.sleep(0.02)
        return times

    client.wait_for_service(_PATIENCE_S)
    answer_time_ms()
    answer_times_ms(_JOIN_S)
    sys.stdout.write(json.dumps(answer_times_ms(seconds)) + "\n")
    sys.stdout.flush()
    os._exit(0)  # without waiting for the thread


def calibrate(seconds: float) -> None:
    """Call ~/calibrate again and again; print how often it was accepted and refused, and the last answer."""
    ros = Node("caller")
    client = ros.create_client(Trigger, f"{NODE}/calibrate")
    client.wait_for_service(_PATIENCE_S)
    counts, message, end_s = [0, 0], "", time.monotonic() + seconds
    while time.monotonic() < end_s:
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(ros, future, timeout_sec=_PATIENCE_S)
        counts[not future.result().success] += 1
        message = future.result().message
    sys.stdout.write(json.dumps([*counts, message]) + "\n")


def listen(seconds: float) -> None:
    """Listen to ~/road_pose; print of each message its stamp and its arrival [ns], and its pose.

    The pose is height, pitch and roll [m, rad, rad].
    """
    ros = Node("listener")
    heard = []

    def received(message: PoseWithCovarianceStamped) -> None:
        arrived_ns = time.time_ns()
        stamp, pose = message.header.stamp, message.pose.pose
        q = pose.orientation
        pitch = math.asin(2.0 * (q.w * q.y - q.z * q.x))
        roll = math.atan2(2.0 * (q.w * q.x + q.y * q.z), 1.0 - 2.0 * (q.x**2 + q.y**2))
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        heard.append((stamp_ns, arrived_ns, pose.position.z, pitch, roll))

    ros.create_subscription(PoseWithCovarianceStamped, f"{NODE}/road_pose", received, 10)
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        rclpy.spin_once(ros, timeout_sec=0.2)
    sys.stdout.write(json.dumps(heard) + "\n")
    sys.stdout.flush()


@dataclass(frozen=True, slots=True)
class Time:
    """The stamp of a message.

    Attributes:
        sec: Seconds.
        nanosec: Nanoseconds beyond them.
    """

    sec: int
    nanosec: int


class Counters:
    """What a process counts for another one to read, in a file of three numbers.

    Attributes:
        values: Images taken, images lost between two that were taken, seconds of processor time that
            frames were calibrated or followed.
    """

    def __init__(self, path: str, hz: float) -> None:
        self.values = np.memmap(path, np.float64, "r+", shape=(3,))
        self._hz = hz
        self._last: dict[str, tuple[object, float]] = {}

    def image(self, side: str, stamp: Any, window: object = None) -> None:
        """Count an image; those missing since the one before, if it is of the same span of taking."""
        stamp_s = stamp.sec + 1e-9 * stamp.nanosec
        before, before_s = self._last.get(side, (None, math.nan))
        self._last[side] = window, stamp_s
        self.values[0] += 1
        if before is window and math.isfinite(before_s):
            self.values[1] += max(round((stamp_s - before_s) * self._hz) - 1, 0)

    def timed(self, function: Callable) -> Callable:
        """Return a function that adds its processor time."""

        def wrapped(*arguments: Any, **named: Any) -> Any:
            start_s = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                self.values[2] += time.thread_time() - start_s

        return wrapped


def subscriber(kind: str, counters: Counters) -> None:
    """Run a node that only subscribes to both images and takes all, until killed.

    Args:
        kind: ``plain``, or ``raw``: images are not deserialised, and their stamps read from the bytes.
        counters: What it counts.
    """
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    ros = Node(NODE[1:])
    raw = kind == "raw"

    def received(side: str, message: Any) -> None:
        # Behind the four bytes that say the encoding.
        stamp = Time(*struct.unpack_from("<iI", message, 4)) if raw else message.header.stamp
        counters.image(side, stamp)

    for side in SIDES:
        ros.create_subscription(Image, f"/{side}/image_rect", partial(received, side), _SENSOR_DATA, raw=raw)
    with suppress(KeyboardInterrupt):
        rclpy.spin(ros)


def variant(kind: str, counters: Counters | None = None) -> None:
    """Run the node as it is (``lazy``), or subscribed all the time (``kept``), or one that only subscribes.

    Args:
        kind: Of the node; ``plain`` and ``raw`` are a :func:`subscriber`.
        counters: What it counts.
    """
    if kind == "kept":
        update = SubscriptionSchedule.update
        # What is to differ cannot be said to mypy.
        SubscriptionSchedule.update = lambda *arguments: update(*arguments) or True  # type: ignore[method-assign]
    if counters is not None:
        if kind in ("plain", "raw"):
            subscriber(kind, counters)
            return
        add, counted = ImageIntake.add, counters

        def counted_add(self: ImageIntake, side: Any, message: Any) -> None:
            counted.image(side, message.header.stamp, self.window)
            add(self, side, message)

        ImageIntake.add = counted_add  # type: ignore[method-assign]  # as above
        looked = Calibrator.calibrate_next_or_refuse
        Calibrator.calibrate_next_or_refuse = counters.timed(looked)  # type: ignore[method-assign]  # as above
        RoadTracker.follow = counters.timed(RoadTracker.follow)  # type: ignore[method-assign]  # as above
    first_frame = [word for name in TARGET_NAMES for word in ("-p", f"{name}:=0.0")]
    sys.exit(node.main(["--ros-args", "-p", "output_path:=''", *first_frame]))


def main(arguments: list[str]) -> None:
    """Run one: camera HZ [full_hd], drive FILE, ask S, calibrate S, listen S, node VARIANT [FILE HZ]."""
    what, argument, *more = arguments
    if what == "node":
        variant(argument, Counters(more[0], float(more[1])) if more else None)
        return
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    with suppress(KeyboardInterrupt):
        if what == "drive":
            drive(argument)
        elif what == "camera":
            camera(float(argument), FULL_HD if more else RIG)
        else:
            {"ask": ask, "calibrate": calibrate, "listen": listen}[what](float(argument))


if __name__ == "__main__":
    main(sys.argv[1:])
