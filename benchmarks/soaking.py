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

"""Runs the node for a time, with cameras and callers, and measures it: the work of the section ``soak``.

``python -m benchmarks.soaking SECONDS FOLDER`` in the environment with ROS prints its report as JSON. The
node is a process of its own; two cameras and the callers are this one.
"""

from __future__ import annotations

import json
import math
import signal
import struct
import subprocess
import sys
import threading
import time
from array import array
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from stereo_selfcal import Extrinsics
from stereo_selfcal.files.node_settings import TARGET_NAMES
from stereo_selfcal.synth.renderer import Frame, render
from stereo_selfcal.synth.scenes import LEFT_PHOTOMETRY, RIGHT_PHOTOMETRY
from stereo_selfcal.synth.world import Scene

from .graph import RIG, SIDES
from .idle import cpu_s, memory_mib
from .soak import ASK_EVERY_S, BARE_EVERY, CALL_EVERY_S, LOST_S, RATE_HZ, TIMEOUT_S, Minute, SoakReport

POSE = Extrinsics(1.4, math.radians(3.0), math.radians(0.8))
_N_FRAMES = 3
_NOISE = 0.01
_START_S = 60.0
_STAMP = struct.Struct("<iI")
_STAMP_OFFSET = 4  # in a serialized message: behind the representation of the encapsulation


class _Caller:
    """Sends requests of one service and remembers when they were answered."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.sent = self.answered = 0

    def ask(self, request: Any, answered: Any) -> None:
        """Send a request; ``answered(response, elapsed_s)`` is called by the thread that spins."""
        self.sent += 1
        start_s = time.monotonic()

        def done(future: Any) -> None:
            self.answered += 1
            answered(future.result(), time.monotonic() - start_s)

        self.client.call_async(request).add_done_callback(done)

    @property
    def waiting(self) -> int:
        """Requests without an answer."""
        return self.sent - self.answered


class _Cameras:
    """Publishes at 30 Hz in a thread; what they see can be chosen."""

    def __init__(self, node: Node) -> None:
        good, bare = _frames()
        self._messages = {
            True: [[_serialized(_image(pixels)) for pixels in frame] for frame in good],
            False: [[_serialized(_image(pixels)) for pixels in bare]],
        }
        self._infos = [_serialized(_info(side)) for side in SIDES]
        self._images_out = [
            node.create_publisher(Image, f"/{side}/image_rect", qos_profile_sensor_data) for side in SIDES
        ]
        self._infos_out = [
            node.create_publisher(CameraInfo, f"/{side}/camera_info", qos_profile_sensor_data)
            for side in SIDES
        ]
        self.lines = True
        self.sent = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        next_s = time.monotonic()
        while not self._stopped.wait(max(0.0, next_s - time.monotonic())):
            next_s = max(next_s + 1.0 / RATE_HZ, time.monotonic() - 1.0)  # a late frame is not caught up
            stamp = divmod(time.time_ns(), 10**9)
            frames = self._messages[self.lines]
            frame = frames[self.sent % len(frames)]
            for publisher, message in zip(
                (*self._infos_out, *self._images_out), (*self._infos, *frame), strict=True
            ):
                _STAMP.pack_into(message, _STAMP_OFFSET, *stamp)
                publisher.publish(bytes(message))
            self.sent += 1


class _Soak:
    """The node as a process, its cameras and its callers; use it in a ``with`` statement.

    Args:
        folder: Where the node keeps its log and result.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._log = folder, folder / "node.log"
        self.report = SoakReport()

    def __enter__(self) -> _Soak:
        with ExitStack() as stack:
            rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
            stack.callback(rclpy.try_shutdown)
            node = rclpy.create_node("soak")
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            spinning = threading.Thread(target=executor.spin, daemon=True)
            spinning.start()
            stack.callback(spinning.join)
            stack.callback(executor.shutdown)
            self._cameras = _Cameras(node)
            self._process = _start_node(self._folder, self._log)
            stack.callback(self._process.wait)
            stack.callback(self._process.kill)
            self._calibrate = _Caller(node.create_client(Trigger, "/stereo_selfcal/calibrate"))
            self._ask = _Caller(node.create_client(GetParameters, "/stereo_selfcal/get_parameters"))
            for caller in (self._calibrate, self._ask):
                if not caller.client.wait_for_service(_START_S):
                    raise RuntimeError(f"the node does not start: {self._log.read_text(encoding='utf-8')}")
            self._cameras.start()
            stack.callback(self._cameras.stop)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, duration_s: float) -> None:
        """Call and measure for so long [s]."""
        report, pid = self.report, self._process.pid
        start_s, cpu_start_s = time.monotonic(), cpu_s(pid)
        second = 0
        while (elapsed_s := time.monotonic() - start_s) < duration_s:
            if int(elapsed_s // 60) == len(report.minutes):
                report.minutes.append(Minute())
            self._measure(report.minutes[-1], second)
            second += 1
            time.sleep(max(0.0, start_s + second * ASK_EVERY_S - time.monotonic()))
        report.elapsed_s = time.monotonic() - start_s
        report.cpu_s = cpu_s(pid) - cpu_start_s
        report.images = self._cameras.sent
        deadline = time.monotonic() + LOST_S
        while (self._calibrate.waiting or self._ask.waiting) and time.monotonic() < deadline:
            time.sleep(0.1)
        report.calls, report.lost_calls = self._calibrate.sent, self._calibrate.waiting
        report.asked, report.lost_questions = self._ask.sent, self._ask.waiting
        report.log_bytes = self._log.stat().st_size

    def _measure(self, minute: Minute, second: int) -> None:
        own, resident = memory_mib(self._process.pid, "RssAnon", "VmRSS")
        minute.own_mib.append(own)
        minute.rss_mib.append(resident)
        minute.log_lines = self._log.read_bytes().count(b"\n")
        self._ask.ask(GetParameters.Request(names=["frames"]), lambda _, s: minute.asked_s.append(s))
        if second % CALL_EVERY_S == 0:
            self._cameras.lines = self._calibrate.sent % BARE_EVERY != BARE_EVERY - 1
            self._calibrate.ask(Trigger.Request(), lambda answer, _: minute.calls.append(answer.success))

    def end(self) -> None:
        """End the node as Ctrl-C would, in the middle of a call."""
        self._cameras.lines = False
        self._calibrate.ask(Trigger.Request(), lambda *_: None)
        time.sleep(ASK_EVERY_S)
        start_s = time.monotonic()
        self._process.send_signal(signal.SIGINT)
        self.report.exit_status = self._process.wait(LOST_S)
        self.report.ending_s = time.monotonic() - start_s


def _frames() -> tuple[list[tuple[Frame, Frame]], tuple[Frame, Frame]]:
    """Return frames of a straight road, and one of a road without lines."""
    scene = Scene(RIG, POSE, left=LEFT_PHOTOMETRY, right=RIGHT_PHOTOMETRY)
    scene = scene.with_noise(_NOISE)
    good = [render(scene, np.random.default_rng(seed)) for seed in range(_N_FRAMES)]
    flat = np.full((RIG.height, RIG.width), 90, np.uint8)
    return good, (flat, flat)


def _image(pixels: Frame) -> Image:
    message = Image(height=pixels.shape[0], width=pixels.shape[1], step=pixels.shape[1], encoding="mono8")
    message.data = array("B", pixels.tobytes())
    return message


def _info(side: str) -> CameraInfo:
    shift = -RIG.fx * RIG.baseline_m if side == "right" else 0.0
    return CameraInfo(
        width=RIG.width,
        height=RIG.height,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=[RIG.fx, 0.0, RIG.cx, 0.0, RIG.fy, RIG.cy, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[RIG.fx, 0.0, RIG.cx, shift, 0.0, RIG.fy, RIG.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def _serialized(message: Any) -> bytearray:
    return bytearray(serialize_message(message))


def _start_node(folder: Path, log: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "stereo_selfcal", "node", "--ros-args"]
    command += ["-p", f"output_path:={folder / 'result.yaml'}", "-p", f"timeout_s:={TIMEOUT_S}"]
    for name in TARGET_NAMES:  # a call is to end with its first frame
        command += ["-p", f"{name}:=0.0"]
    with log.open("wb") as output:
        return subprocess.Popen(command, stdout=output, stderr=output)


def main(arguments: list[str]) -> int:
    """Run the node for so many seconds with its files in a folder, and print the report."""
    seconds, folder = arguments
    with _Soak(Path(folder)) as running:
        running.run(float(seconds))
        running.end()
    sys.stdout.write(json.dumps(asdict(running.report)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
