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

"""Pictures of some frames of a recording, for the page."""

from __future__ import annotations

import base64
import math
from typing import Any

import cv2

from ..core.drive.drive import clock
from ..core.errors import SelfcalError
from ..core.results import CalibrationResult
from ..core.types import Image
from ..offline import FrameRow, FrameSource, Replay, look_again
from ..pictures.birds_eye import draw_birds_eye
from ..pictures.camera_view import draw_camera_view, shown_extrinsics
from ..pictures.contradiction import contradicts, draw_contradiction
from ..pictures.travel_direction import shown_travel
from .choice import best_median_worst, ranked, refusals, segment_of

# Pictures are looked at, not measured in: a third of the bytes of a PNG, and the fringes stay.
_JPEG_QUALITY = 80
_MIN_PICTURE_PX = 960  # smaller images are enlarged to it, as their lines and text would be too coarse
_MOST_REFUSALS_SHOWN = 3
# A phone shows them 366 px wide: letters of 12 px there. What does not fit in such letters is on the page.
_TEXT_SIZE = 2.2


def pictures(source: FrameSource, replay: Replay) -> list[dict[str, Any]]:
    """Return the pictures of some frames, with what is to be said of them."""
    shown: list[tuple[str, FrameRow]] = []
    for name, off_m, row in best_median_worst(ranked(replay.rows, replay.drive)):
        near = f"its own pose puts the road {digits(off_m * 1e3)} mm from the calibration's, 5 to 20 m ahead"
        shown.append((f"{name} accepted frame: {near}", row))
    room = 1 if shown else _MOST_REFUSALS_SHOWN
    for reason, count, row in refusals(replay.rows)[:room]:
        shown.append((f"Refused: {reason}, as {count} of {len(replay.rows)} frames", row))
    return [_picture(source, replay, title, row) for title, row in shown]


def _picture(source: FrameSource, replay: Replay, title: str, row: FrameRow) -> dict[str, Any]:
    """Draw a frame under the calibration of its part of the drive; a refused one under what was tried."""
    entry: dict[str, Any] = {
        "title": title,
        "when": row.name
        or f"{clock(row.stamp_s)}, {row.stamp_s - replay.rows[0].stamp_s:.1f} s from the start",
        "own": "" if row.extrinsics is None else row.extrinsics.describe(),
        "notes": row.notes if row.rejection is None else (row.rejection.finding,),
    }
    try:
        frame, result = look_again(source, row, replay.config)
    except SelfcalError as error:
        return entry | {"problem": str(error)}
    if frame.left.size == 0:
        return entry | {"problem": frame.problem or "the image is empty"}
    if row.accepted:
        result = segment_of(row, replay.drive).estimate.drawn_as(result)
    scale = max(1.0, _MIN_PICTURE_PX / frame.left.shape[1])
    entry["overlay"] = _data_uri(
        draw_camera_view(frame.left, replay.rig, result, scale, text_size=_TEXT_SIZE)
    )
    if contradicts(result):
        parts = draw_contradiction(frame.right, replay.rig, result, scale)
        entry["contradiction"] = _data_uri(parts[0]) if parts else ""
    entry["birds_eye"] = _birds_eye(frame.left, frame.right, replay, result)
    return entry


def _birds_eye(left: Image, right: Image, replay: Replay, result: CalibrationResult) -> str:
    pose, rig = shown_extrinsics(result), replay.rig
    if pose is None or not left.shape == right.shape == (rig.height, rig.width):
        return ""
    travel = shown_travel(result)
    return _data_uri(
        draw_birds_eye(left, right, rig, pose, travel=travel, text_size=_TEXT_SIZE, titled=False)
    )


def _data_uri(picture: Image) -> str:
    _, content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return f"data:image/jpeg;base64,{base64.b64encode(content.tobytes()).decode()}"


def digits(value: float) -> str:
    """Return two significant digits, and no fewer than a whole number has."""
    if value <= 0.0:
        return "0"
    return f"{value:.{max(0, 1 - math.floor(math.log10(value)))}f}"
