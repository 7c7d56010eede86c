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

"""What ``replay --mcap`` writes: the frames of a recording with what was found in them.

The recording is read a second time, when its calibration is known. So what the node latches stands at the
front of the file, and whoever plays it has the transforms from its first image on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..bags import StereoFrame
from ..core.alignment_verdict import report_alignment
from ..core.camera.plain_camera_info import PlainCameraInfo
from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.delay_report import is_late
from ..core.geometry.alignment import Alignment
from ..core.geometry.pose import BODY_FROM_OPTICAL, road_from_camera_rotation
from ..core.geometry.vehicle import CameraAxes, RigidTransform, body_from_camera
from ..core.types import Array
from ..files.frames import FrameNames, InfoFrames, PlacedCamera, bare, place_camera
from ..files.node_settings import CAMERA_FRAME
from ..files.result_file import (
    alignment_parameters,
    evidence_parameters,
    result_parameters,
    yaw_parameters,
)
from ..files.saved_evidence import told_travel
from ..offline import FrameRow, FrameSource, Replay, look_again
from ..pictures.canvas import GREEN, VERMILION
from ..pictures.overview import draw_debug_image
from ..pictures.verdict import StripContent
from ..published.markers import lanes_on_road, result_markers
from ..published.status import (
    StatusLevel,
    StatusReport,
    alignment_numbers,
    alignment_values,
    delay_values,
    describe_rig,
    estimate_values,
    pose_values,
    rejection_values,
    rig_values,
    yaw_values,
)
from ..published.transforms import camera_transforms, optical_transforms
from ..report.uncertainty import std_of
from . import messages, topics
from .mcap_file import McapFile, new_mcap_file
from .topics import NODE, TOPICS

_NS_PER_S = 1_000_000_000
# A JPEG of this quality, calibrated again, gives the same pose within a fraction of its standard deviation.
_IMAGE_QUALITY = 95
_PICTURE_QUALITY = 80  # for people
_OPTICAL_FRAMES = ("stereo_left_optical", "stereo_right_optical")  # where CameraInfo has no names
# A turn that is not seen has a finite variance in a message: any angle up to half a turn.
_UNKNOWN_VARIANCE = np.pi**2


@dataclass(frozen=True, slots=True, eq=False)
class _Named:
    """The result with the names of its frames.

    Attributes:
        names: The frames as they are asked for.
        infos: What CameraInfo calls the cameras.
        placed: The camera in the vehicle; None where nothing was found.
        optical: Names of the optical frames, left and right.
    """

    names: FrameNames
    infos: InfoFrames
    placed: PlacedCamera | None
    optical: tuple[str, str]

    @property
    def camera_frame(self) -> str:
        """Name of the camera's frame."""
        return CAMERA_FRAME if self.placed is None else self.placed.child


def write_recording(path: Path, source: FrameSource, replay: Replay, names: FrameNames) -> None:
    """Write images, poses, transforms, markers and diagnostics as one MCAP file of ROS 2 messages.

    Of a damaged recording there is no result in it, as ``--output`` writes none, but the frames are.

    Args:
        path: The file, which must not exist; it is there when all of it is written.
        source: The recording, open.
        replay: What was found in it.
        names: The frames as they are asked for.

    Raises:
        OutputError: It exists already, or cannot be written.
        SelfcalError: The recording cannot be read a second time.
    """
    named = _named(replay, names)
    statuses = _statuses(replay)
    with new_mcap_file(path, TOPICS) as file:
        for number, (row, frame) in enumerate(_frames(source, replay)):
            if number == 0 and replay.damage is None:
                _write_result(file, source, replay, named, row.recorded_ns)
            _write_frame(file, replay, row, frame, named)
            stamp_ns, report = _stamp_ns(row.stamp_s), _frame_status(row)
            told = messages.diagnostics_message([*statuses, report], named.camera_frame, stamp_ns)
            file.add(topics.DIAGNOSTICS, told, row.recorded_ns)


def _frames(source: FrameSource, replay: Replay) -> Iterator[tuple[FrameRow, StereoFrame]]:
    """Yield the frames that were calibrated; what is behind them may be damaged, and is not read."""
    yield from zip(replay.rows, source.frames(), strict=False)


def _named(replay: Replay, names: FrameNames) -> _Named:
    """Return names for all frames: where one may not be used, the default one takes its place."""
    infos = InfoFrames(of_rig=True) if replay.cameras is None else InfoFrames.of(replay.cameras)
    placed = None
    if replay.estimate.accepted:
        placed = place_camera(replay.estimate, replay.rig, names, infos)
        if placed.problem:
            names = replace(names, camera_frame=CAMERA_FRAME)
            placed = place_camera(replay.estimate, replay.rig, names, infos)
        placed = replace(placed, parent=bare(placed.parent), child=bare(placed.child), road=bare(placed.road))
    taken = {bare(name) for name in (names.vehicle_frame, names.road_frame)}
    is_optical = placed is not None and placed.camera.axes is CameraAxes.OPTICAL
    if placed is not None and not is_optical:
        taken.add(placed.child)
    told = bare(infos.left), bare(infos.right)
    free = all(told) and told[0] != told[1] and not taken & set(told)
    optical = told if free else _OPTICAL_FRAMES
    return _Named(names, infos, placed, (placed.child, optical[1]) if is_optical and placed else optical)


def _write_result(
    file: McapFile, source: FrameSource, replay: Replay, named: _Named, recorded_ns: int
) -> None:
    """Write what the node latches, at the front."""
    estimate, placed, rig = replay.estimate, named.placed, replay.rig
    if placed is None or estimate.extrinsics is None:
        return
    stamp_ns = _stamp_ns(estimate.stamp_s)
    _, shown = look_again(source, replay.shown, replay.config)
    lanes: tuple[Array, ...] = ()
    if shown.pattern is not None and shown.extrinsics is not None:
        lanes = lanes_on_road(shown.pattern, rig, estimate.extrinsics)
    camera = placed.camera
    parameters = result_parameters(estimate) | yaw_parameters(estimate) | alignment_parameters(estimate)
    parameters |= evidence_parameters(estimate)
    transforms = [*camera_transforms(placed), *optical_transforms(placed, rig, named.optical)]
    latched = [
        (topics.TF_STATIC, messages.transforms_message(transforms, stamp_ns)),
        (topics.POSE, messages.pose_message(camera.transform, camera.covariance, placed.parent, stamp_ns)),
        (
            topics.MARKERS,
            messages.markers_message(
                result_markers(estimate.extrinsics, lanes, camera), placed.parent, stamp_ns
            ),
        ),
        (topics.EXTRINSICS, messages.parameters_message(NODE, parameters, stamp_ns)),
    ]
    if estimate.alignment is not None:
        right = right_in_camera(estimate.alignment, placed, rig)
        covariance = _turn_covariance(estimate.alignment, placed)
        latched.append((topics.ALIGNMENT, messages.pose_message(right, covariance, placed.child, stamp_ns)))
    for topic, message in latched:
        file.add(topic, message, recorded_ns)


def right_in_camera(alignment: Alignment, placed: PlacedCamera, rig: StereoRig) -> RigidTransform:
    """Return the body of the right camera, as it is turned, in the camera's frame.

    An angle that is not known counts as none.
    """
    pitch_rad, roll_rad, yaw_rad = map(float, np.where(alignment.known(), alignment.as_array(), 0.0))
    body_from_right = road_from_camera_rotation(pitch_rad, roll_rad, yaw_rad)
    right_m = -body_from_camera(CameraAxes.OPTICAL, rig).translation_m
    camera_from_body = body_from_camera(placed.camera.axes, rig).inverse()
    return camera_from_body.after(RigidTransform(body_from_right, right_m))


def _turn_covariance(alignment: Alignment, placed: PlacedCamera) -> Array:
    """Return the covariance (6, 6) of the right camera's pose: its place is that of the rig."""
    known = alignment.known()
    of_angles = np.where(np.outer(known, known), alignment.covariance, 0.0)
    of_angles[~known, ~known] = _UNKNOWN_VARIANCE
    order = [1, 0, 2]  # the turns about x, y, z are roll, pitch, yaw
    turns = of_angles[np.ix_(order, order)]
    if placed.camera.axes is CameraAxes.OPTICAL:
        turns = BODY_FROM_OPTICAL.T @ turns @ BODY_FROM_OPTICAL
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = turns
    return covariance


def _write_frame(file: McapFile, replay: Replay, row: FrameRow, frame: StereoFrame, named: _Named) -> None:
    """Write the images of a frame, and what was found in it."""
    stamp_ns, recorded_ns, rig = _stamp_ns(row.stamp_s), row.recorded_ns, replay.rig_of(row)
    left_frame, right_frame = named.optical
    if not frame.problem and frame.left.size:
        infos = PlainCameraInfo.of_rig(rig)
        for info, name, topic in zip(
            infos, named.optical, (topics.LEFT_INFO, topics.RIGHT_INFO), strict=True
        ):
            file.add(topic, messages.camera_info_message(info, name, stamp_ns), recorded_ns)
        images = (topics.LEFT_IMAGE, frame.left, left_frame), (topics.RIGHT_IMAGE, frame.right, right_frame)
        for topic, image, name in images:
            message = messages.jpeg_message(image, _IMAGE_QUALITY, name, stamp_ns)
            file.add(topic, message, recorded_ns)
        drawn = replay.estimate if replay.estimate.accepted and rig == replay.rig else None
        picture = draw_debug_image(frame.left, rig, drawn, _verdict(row))
        message = messages.jpeg_message(picture, _PICTURE_QUALITY, left_frame, stamp_ns)
        file.add(topics.DEBUG_IMAGE, message, recorded_ns)
    if row.accepted and named.placed is not None:
        moment = replace(replay.estimate, extrinsics=row.extrinsics, covariance=row.covariance)
        placed = place_camera(moment, rig, named.names, named.infos)
        camera, parent = placed.camera, named.placed.parent
        pose = messages.pose_message(camera.transform, camera.covariance, parent, stamp_ns)
        file.add(topics.ROAD_POSE, pose, recorded_ns)


def _verdict(row: FrameRow) -> StripContent:
    """Return what stands over the picture of a frame."""
    if row.extrinsics is None:
        text = "" if row.rejection is None else row.rejection.message
        return StripContent(f"REFUSED: {row.reason}", VERMILION, (text,))
    std = None if row.covariance is None else std_of(row.covariance)
    return StripContent("ACCEPTED", GREEN, (row.extrinsics.describe(std), *row.notes))


def _statuses(replay: Replay) -> list[StatusReport]:
    """Return the reports of what was found, and of the cameras: the same with every frame."""
    estimate, rig = replay.estimate, replay.rig
    accepted = sum(row.accepted for row in replay.rows)
    values = {"state": "calibrated" if estimate.accepted else "uncalibrated"}
    if estimate.accepted:
        values |= estimate_values(estimate) | yaw_values(told_travel(estimate))
    values |= alignment_values(estimate.alignment, rig) | delay_values(estimate.delay)
    values |= {"frames_accepted": str(accepted), "frames_rejected": str(len(replay.rows) - accepted)}
    wrong = report_alignment(estimate.alignment, rig).verdict.is_fault or is_late(estimate.delay)
    good = estimate.accepted and replay.damage is None and not wrong
    message = "; ".join(filter(None, (estimate.message, replay.damage)))
    source = "a rig file" if replay.cameras is None else _source(replay.cameras)
    return [
        StatusReport(StatusLevel.OK if good else StatusLevel.WARN, f"{NODE}: calibration", message, values),
        StatusReport(StatusLevel.OK, f"{NODE}: camera info", describe_rig(rig, source), rig_values(rig)),
    ]


def _source(cameras: StereoRectifier) -> str:
    return "CameraInfo" if cameras.infos is not None else "a rig file"


def _frame_status(row: FrameRow) -> StatusReport:
    """Return the report of one frame; its numbers are of the moment."""
    std = None if row.covariance is None else std_of(row.covariance)
    values = pose_values(row.extrinsics, std) | alignment_numbers("alignment", row.alignment)
    if row.extrinsics is not None:
        return StatusReport(
            StatusLevel.OK, f"{NODE}: frame", f"accepted: {row.extrinsics.describe(std)}", values
        )
    message = f"refused: {row.reason}"
    if row.rejection is not None:
        values |= rejection_values("last_rejection", row.rejection)
        message = f"{message}: {row.rejection.message}"
    return StatusReport(StatusLevel.WARN, f"{NODE}: frame", message, values)


def _stamp_ns(stamp_s: float) -> int:
    """Return a stamp [ns]; seconds since 1970 have 0.2 microseconds left of them."""
    return round(stamp_s * _NS_PER_S)
