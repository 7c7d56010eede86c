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

"""``~/debug_image`` and ``~/birds_eye``: pictures of the frames and of the result, for subscribers only.

While frames are calibrated, the last one of each second is shown with its lines and verdict. The last frame
of a call stays for some seconds. Between calls the current image is shown under the active calibration. A
misfit shows that the camera was moved.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image as ImageMessage

from ..core.camera.rig import StereoRig
from ..core.lanes.stripe_points import find_stripe_points
from ..core.results import CalibrationResult
from ..core.types import Array, Image
from ..pictures.camera_view import shown_extrinsics
from ..pictures.canvas import SKY_BLUE, VERMILION, YELLOW
from ..pictures.overview import draw_debug_image, draw_fringes, draw_notice
from ..pictures.travel_direction import shown_travel
from ..pictures.verdict import StripContent, numbers, verdict_of
from .calibration_keeper import ActiveCalibration
from .config import NodeConfig
from .diagnostics import age_text
from .live import LiveFrame, NoFrame
from .messages import image_message
from .overrides import overridable_publisher
from .record import FrameReport
from .shutdown import silent_after_shutdown

# One picture a second is enough for somebody who turns a camera. Drawing takes a few percent of a core then
# (25 ms for both pictures of 1280 x 720).
PERIOD_S = 1.0
# The last frame of a call stays long enough for its verdict and numbers to be read.
HOLD_S = 5.0

_QUEUE = 1
_LEAST_SIDE_PX = 16
_GREATEST_ASPECT = 8


class Views:
    """Draws the pictures that have subscribers, in a thread of its own.

    Args:
        node: The node.
        take: Returns a current frame, why there is none, or None while a call has them all; its
            argument is how long it may wait [s].
        active: Returns the active calibration.
        config: Returns the parameters.
        frame: Returns the name of the camera's frame.
        clock: Steady time [s], for tests.
    """

    def __init__(
        self,
        node: Node,
        take: Callable[[float], LiveFrame | NoFrame | None],
        active: Callable[[], ActiveCalibration | None],
        config: Callable[[], NodeConfig],
        frame: Callable[[], str],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node = node
        self._take = take
        self._active = active
        self._config = config
        self._frame = frame
        self._clock = clock
        self._debug_image, self._birds_eye = (
            overridable_publisher(node, ImageMessage, topic, _QUEUE)
            for topic in ("~/debug_image", "~/birds_eye")
        )
        self._lock = threading.Lock()
        self._last: FrameReport | None = None
        self._hold_until_s = -np.inf
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="views", daemon=True)

    def start(self) -> None:
        """Draw until :meth:`stop`."""
        self._thread.start()

    def stop(self) -> None:
        """End drawing and wait for it."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    def show(self, report: FrameReport) -> None:
        """Show a calibrated frame in the next picture; returns at once."""
        with self._lock:
            self._last = report if self._watched() else None  # images without a viewer are not kept

    def step(self) -> None:
        """Draw and publish each picture that has subscribers, if there is something new."""
        with self._lock:
            report, self._last = self._last, None
        if not self._watched():
            return
        if report is not None:
            self._hold_until_s = self._clock() + HOLD_S
            verdict = verdict_of(report.result)
            self._draw(report.left, report.right, report.rig, report.result, verdict, report.stamp_ns)
        elif self._clock() >= self._hold_until_s:
            self._draw_current(self._take(PERIOD_S))

    def _watched(self) -> bool:
        with silent_after_shutdown(self._node.context):
            return any(each.get_subscription_count() for each in (self._debug_image, self._birds_eye))
        return False

    def _draw_current(self, frame: LiveFrame | NoFrame | None) -> None:
        active = self._active()
        if isinstance(frame, NoFrame):
            notice = draw_notice(StripContent("NO PICTURE", VERMILION, (frame.reason,)))
            stamp_ns = int(self._node.get_clock().now().nanoseconds)
            for publisher in (self._debug_image, self._birds_eye):
                self._publish(publisher, notice, stamp_ns)
        elif frame is not None:
            rig, result, verdict = self._judge(frame, active)
            self._draw(frame.left, frame.right, rig, result, verdict, frame.stamp_ns)

    def _judge(
        self, frame: LiveFrame, active: ActiveCalibration | None
    ) -> tuple[StereoRig | None, CalibrationResult | None, StripContent]:
        """Return the rig, the result and the text to draw over a frame that was not calibrated."""
        if active is None:
            text = frame.problem or "call ~/calibrate on a straight road with painted lines"
            return (
                frame.rig,
                None,
                StripContent("NOT CALIBRATED", VERMILION if frame.problem else YELLOW, (text,)),
            )
        age = age_text(self._clock() - active.since_s)
        if frame.left.shape != (active.rig.height, active.rig.width):
            found = f"the images have {frame.left.shape[1]} x {frame.left.shape[0]} px"
            wanted = f"the calibration is for {active.rig.width} x {active.rig.height} px"
            return (
                None,
                None,
                StripContent("OTHER CAMERA", VERMILION, (f"{found}, {wanted}: calibrate again",)),
            )
        verdict = StripContent(f"CALIBRATION IN FORCE, {age} old", SKY_BLUE, numbers(active.result))
        return active.rig, active.result, verdict

    def _draw(
        self,
        left: Image,
        right: Image,
        rig: StereoRig | None,
        result: CalibrationResult | None,
        verdict: StripContent,
        stamp_ns: int,
    ) -> None:
        if not _drawable(left):
            verdict = StripContent(
                "NO PICTURE", VERMILION, (f"image of {left.shape[1]} x {left.shape[0]} px",)
            )
            self._publish(self._debug_image, draw_notice(verdict), stamp_ns)
            self._publish(self._birds_eye, draw_notice(verdict), stamp_ns)
            return
        if self._debug_image.get_subscription_count():
            picture = draw_debug_image(left, rig, result, verdict, self._stripes(left))
            self._publish(self._debug_image, picture, stamp_ns)
        if self._birds_eye.get_subscription_count():
            extrinsics = None if result is None else shown_extrinsics(result)
            fits = rig is not None and left.shape == right.shape == (rig.height, rig.width)
            if result is None or rig is None or extrinsics is None or not fits:
                picture = draw_notice(verdict)
            else:
                picture = draw_fringes(left, right, rig, extrinsics, verdict, shown_travel(result))
            self._publish(self._birds_eye, picture, stamp_ns)

    def _stripes(self, left: Image) -> Array:
        points = find_stripe_points(left, self._config().calibrator.extraction)
        return np.column_stack([points.columns, points.rows])

    def _publish(self, publisher: Publisher, picture: Image, stamp_ns: int) -> None:
        if publisher.get_subscription_count():
            publisher.publish(image_message(picture, self._frame(), stamp_ns))

    def _run(self) -> None:
        while not self._stopped.wait(PERIOD_S):
            try:
                self.step()
            except Exception:  # noqa: BLE001 - a picture that fails must not end the drawing
                if self._node.context.ok() and not self._stopped.is_set():
                    self._node.get_logger().error(
                        f"a picture failed:\n{traceback.format_exc()}", throttle_duration_sec=60.0
                    )


def _drawable(image: Image) -> bool:
    """Return whether an image has the shape of a camera image: a single row of pixels is not drawn."""
    short, long = sorted(image.shape)
    return bool(short >= _LEAST_SIDE_PX and long <= _GREATEST_ASPECT * short)
