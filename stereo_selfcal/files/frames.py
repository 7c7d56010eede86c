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

"""The frames of the vehicle, the road and the camera by their names, and the camera in them.

The node, the exports and ``replay`` name frames by these rules alone. Which axes a name stands for is never a
guess: a name that CameraInfo gives to the left camera is that of its optical frame, any other is that of the
body, unless it says that it is optical. Where this cannot be told, there is no transform, and a sentence
says why.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..core.camera.rectifier import StereoRectifier
from ..core.camera.rig import StereoRig
from ..core.drive.travel import MOST_STEP_M, MOST_STEP_S
from ..core.errors import ConfigError, shortened
from ..core.geometry.pose import DEGREES, Extrinsics
from ..core.geometry.travel import Travel
from ..core.geometry.vehicle import CameraAxes, CameraInVehicle, PlaceInVehicle, camera_in_vehicle
from ..core.results import CalibrationResult
from .node_settings import CAMERA_FRAME, FROM_CAMERA_INFO, ROAD_FRAME, VEHICLE_FRAME
from .saved_evidence import told_travel

FRAME_NAMES = ("vehicle_frame", "road_frame", "camera_frame")
PLACE_NAMES = ("mount.x_m", "mount.y_m")
_NAME_IT = "set camera_frame to a name of its own for the camera body"
_OPTICAL_ENDINGS = ("_optical", "_optical_frame")  # REP-103, and what drivers make of it


@dataclass(frozen=True, slots=True)
class FrameNames:
    """The frames as they are asked for, under the names of the parameters.

    Attributes:
        vehicle_frame: Frame of the vehicle; equal to ``road_frame``: the yaw is left out.
        road_frame: Frame of the road.
        camera_frame: Frame of the camera, or :data:`FROM_CAMERA_INFO`.
        place: Where the middle of the baseline is in the vehicle's frame.
    """

    vehicle_frame: str = VEHICLE_FRAME
    road_frame: str = ROAD_FRAME
    camera_frame: str = CAMERA_FRAME
    place: PlaceInVehicle = field(default_factory=PlaceInVehicle)

    def check(self, for_tf: bool = False) -> None:
        """Refuse names that no transform can have.

        Args:
            for_tf: Whether they go to ``/tf_static``.

        Raises:
            ConfigError: A name is empty, the camera is its own parent, or tf2 would refuse a name.
        """
        for name in FRAME_NAMES:
            if not bare(getattr(self, name)):
                raise ConfigError(f"{name} is empty: the name of a frame is needed")
        for name in ("vehicle_frame", "road_frame"):
            if bare(self.camera_frame) == bare(getattr(self, name)):
                raise ConfigError(
                    f"camera_frame and {name} are both {bare(self.camera_frame)!r}: no frame is its own "
                    "parent, so they must differ; give camera_frame another name"
                )
        if not for_tf:
            return
        for name in FRAME_NAMES:
            if getattr(self, name).startswith("/"):
                raise ConfigError(
                    f"{name} is {getattr(self, name)!r}: frames of /tf_static do not begin with a slash; "
                    f"leave it out"
                )

    @property
    def pair_name(self) -> str:
        """Name of the pair of cameras, for files that name it."""
        return CAMERA_FRAME if self.camera_frame == FROM_CAMERA_INFO else self.camera_frame


@dataclass(frozen=True, slots=True)
class InfoFrames:
    """What CameraInfo calls the cameras.

    Attributes:
        left: ``frame_id`` of the left CameraInfo; "" where it has none.
        right: The same of the right one.
        of_rig: Whether the rig is given by parameters or a file, so that there is no CameraInfo; the names
            are those of the images then, as far as they are known.
    """

    left: str = ""
    right: str = ""
    of_rig: bool = False

    @classmethod
    def of(cls, cameras: StereoRectifier) -> InfoFrames:
        """Return those of cameras."""
        if cameras.cameras is None or cameras.infos is None:
            return cls(of_rig=True)
        left, right = cameras.infos
        return cls(bare(left.frame_id), bare(right.frame_id))

    @classmethod
    def of_messages(cls, left: Any, right: Any) -> InfoFrames:
        """Return those of two CameraInfo messages."""
        return cls(bare(left.header.frame_id), bare(right.header.frame_id))


@dataclass(frozen=True, slots=True)
class NamedCamera:
    """A frame of the camera.

    Attributes:
        axes: Which one.
        name: Its name; "" where it has none that may be used.
        problem: Why it has none, and what to set; "" where it has one.
    """

    axes: CameraAxes
    name: str
    problem: str = ""


def bare(frame: str) -> str:
    """Return the name of a frame without blanks around it and slashes at its front, as tf2 has it."""
    return frame.strip().lstrip("/")


def name_camera(names: FrameNames, infos: InfoFrames) -> NamedCamera:
    """Return which frame of the camera is meant, and its name.

    Args:
        names: The frames as they are asked for.
        infos: What CameraInfo calls the cameras.
    """
    asked = names.camera_frame
    if asked == FROM_CAMERA_INFO:
        return _left_of_camera_info(names, infos)
    if infos.left and bare(asked) == infos.left:
        return NamedCamera(CameraAxes.OPTICAL, asked)
    if infos.right and bare(asked) == infos.right:
        left = f"{FROM_CAMERA_INFO} (the left one is {_shown(infos.left)})" if infos.left else ""
        return NamedCamera(
            CameraAxes.BODY,
            "",
            f"camera_frame is {_shown(asked)}, which is the right camera by its CameraInfo: the transform is "
            f"that of the left one or of the body; {_NAME_IT}{f', or to {left}' if left else ''}",
        )
    if bare(asked).endswith(_OPTICAL_ENDINGS):
        return NamedCamera(CameraAxes.OPTICAL, "", _doubt_optical(asked, infos))
    return NamedCamera(CameraAxes.BODY, asked)


def _left_of_camera_info(names: FrameNames, infos: InfoFrames) -> NamedCamera:
    """Return the optical frame of the left camera by the name that CameraInfo gives it."""
    if infos.of_rig or not infos.left:
        why, remedy = "that of the left camera has no frame_id", f"{_NAME_IT}, or frame_id in its driver"
        if infos.of_rig:
            why, remedy = "the rig is given, so that there is none", _NAME_IT
        return NamedCamera(CameraAxes.OPTICAL, "", f"camera_frame is {FROM_CAMERA_INFO}, but {why}: {remedy}")
    parents = (bare(names.vehicle_frame), bare(names.road_frame))
    if infos.left in parents:
        return NamedCamera(
            CameraAxes.OPTICAL,
            "",
            f"the CameraInfo of the left camera has the frame_id {_shown(infos.left)}, which is that of "
            "the vehicle or of the road here: give the camera's driver a frame_id of its own",
        )
    return NamedCamera(CameraAxes.OPTICAL, infos.left)


def _doubt_optical(asked: str, infos: InfoFrames) -> str:
    """Return why a name that says it is optical is not taken for that of the left camera."""
    if infos.left:
        why = f"the left {'images have' if infos.of_rig else 'CameraInfo has'} {_shown(infos.left)}"
        remedy = "that name" if infos.of_rig else FROM_CAMERA_INFO
        remedy = f"{_NAME_IT}, or set camera_frame to {remedy}"
    elif infos.of_rig:
        why = "the rig is given, so that there is no CameraInfo to say so, and no image has said so"
        remedy = _NAME_IT
    else:
        why, remedy = (
            "the left CameraInfo has no frame_id to say so",
            f"{_NAME_IT}, or frame_id in its driver",
        )
    return f"camera_frame is {_shown(asked)}, an optical frame by its name, but {why}: {remedy}"


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """The camera in the frame of the vehicle, or of the road, with the names of both.

    Attributes:
        camera: The transform with its covariance.
        pose: The camera over the road.
        parent: Frame it is in.
        child: Its own frame; "" where it cannot be named.
        road: Frame of the road.
        problem: Why it cannot be named; "" where it can.
        yaw_remark: That the yaw is not known, and what to do; "" where it is, or where nobody asks for it.
    """

    camera: CameraInVehicle
    pose: Extrinsics
    parent: str
    child: str
    road: str
    problem: str = ""
    yaw_remark: str = ""

    @property
    def told(self) -> str:
        """What its reader has to know of it, in words; "" where it is nothing."""
        return "; ".join(filter(None, (self.yaw_remark, self.problem)))


def place_camera(
    result: CalibrationResult, rig: StereoRig, names: FrameNames, infos: InfoFrames
) -> PlacedCamera:
    """Return where a calibration has the camera.

    Args:
        result: An accepted result.
        rig: The rig it holds for.
        names: The frames as they are asked for.
        infos: What CameraInfo calls the cameras.
    """
    assert result.extrinsics is not None and result.covariance is not None  # it is accepted
    named = name_camera(names, infos)
    wanted = bare(names.vehicle_frame) != bare(names.road_frame)
    travel = told_travel(result)
    camera = camera_in_vehicle(
        result.extrinsics,
        result.covariance,
        travel if wanted else None,
        rig,
        named.axes,
        names.place,
    )
    return PlacedCamera(
        camera,
        result.extrinsics,
        names.vehicle_frame if camera.yaw_known else names.road_frame,
        named.name,
        names.road_frame,
        named.problem,
        explain_unknown_yaw(travel, names) if wanted and not camera.yaw_known else "",
    )


def unknown_yaw_cause(travel: Travel | None) -> str:
    """Return why the yaw against the direction of travel is not known.

    Args:
        travel: What is known of the direction of travel; it does not tell the yaw.
    """
    if travel is None:
        return (
            "no motion is seen between the frames: the car stood or drove backwards, they are more than "
            f"{MOST_STEP_S:g} s or {MOST_STEP_M:g} m apart, or show too few points beside the road"
        )
    std = DEGREES.text(float(travel.std[0]))
    return f"std {std}, no better than that of any mount: the car drove bends only, or too short a way"


def explain_unknown_yaw(travel: Travel | None, names: FrameNames) -> str:
    """Return that the yaw is not known, why, what follows, and what to do: one sentence.

    Args:
        travel: What is known of the direction of travel.
        names: The frames as they are asked for.
    """
    road, vehicle = _shown(names.road_frame), _shown(names.vehicle_frame)
    return (
        f"the yaw is not known ({unknown_yaw_cause(travel)}), so the camera is in {road}, with yaw 0, and "
        f"not in {vehicle}: drive straight on for half a minute while frames are taken"
    )


def _shown(frame: str) -> str:
    return shortened(frame)
