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

"""The node's parameters as one value. Importing this needs no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.camera.rig import StereoRig
from ..core.config import CalibratorConfig
from ..core.drive.targets import Targets
from ..core.errors import ConfigError, RigError
from ..core.geometry.vehicle import PlaceInVehicle
from ..files.exports import parse_exports
from ..files.frames import FRAME_NAMES, PLACE_NAMES, FrameNames
from ..files.node_settings import RIG_PREFIX, all_settings, check_text, is_calibrator_setting

# Parameters that are text and have another type here.
_CONVERTED = ("output_path", "exports")
SETTINGS = {setting.name: setting for setting in all_settings()}


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """The values of the parameters at one moment, under the same names.

    Attributes:
        approximate_sync: Whether the stamps of a pair may differ.
        approximate_sync_tolerance_seconds: Greatest difference of the stamps of a pair [s].
        queue_size: Images of each side that wait for a partner, and pairs for the calibrator.
        image_transport: "raw" or "compressed".
        rectified: Whether the images are rectified. If not, the node undistorts and rectifies them.
        odometry_topic: Topic of nav_msgs/Odometry that says how the car turns, "" for none.
        imu_topic: The same of sensor_msgs/Imu.
        output_path: The result file, None for none.
        timeout_s: How long a call collects frames [s], if the targets are not reached before.
        frames: Least number of accepted frames of a call.
        target_height_std_m: Standard deviation of the height that is good enough [m]; 0: any is.
        target_pitch_std_rad: The same of the pitch [rad].
        target_roll_std_rad: The same of the roll [rad].
        monitor_period_s: Time between two frames of the watch [s], 0 for none.
        on_drift: "warn" or "recalibrate".
        vehicle_frame: Frame of the vehicle.
        road_frame: Frame of the road.
        camera_frame: Frame of the camera, or :data:`.FROM_CAMERA_INFO`.
        mount: Where the camera is in the vehicle's frame.
        exports: Names of the files written beside the result file.
        publish_camera_info: Whether the corrected CameraInfo of the pair is published.
        publish_tf: Whether the result goes to /tf_static as well.
        rig: Values of ``rig.*`` without the prefix, empty when all are 0.
        calibrator: Settings of the calibrator.
    """

    approximate_sync: bool
    approximate_sync_tolerance_seconds: float
    queue_size: int
    image_transport: str
    rectified: bool
    odometry_topic: str
    imu_topic: str
    output_path: Path | None
    timeout_s: float
    frames: int
    target_height_std_m: float
    target_pitch_std_rad: float
    target_roll_std_rad: float
    monitor_period_s: float
    on_drift: str
    vehicle_frame: str
    road_frame: str
    camera_frame: str
    mount: PlaceInVehicle
    exports: tuple[str, ...]
    publish_camera_info: bool
    publish_tf: bool
    rig: Mapping[str, float]
    calibrator: CalibratorConfig

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> NodeConfig:
        """Build from all parameter values by dotted name.

        Raises:
            ConfigError: A value is not one of its choices, is empty where a name is needed, or
                contradicts another.
        """
        for name, setting in SETTINGS.items():
            if isinstance(setting.default, str):
                check_text(name, values[name])
            if setting.choices and values[name] not in setting.choices:
                remedy = "; have others republished as raw" if name == "image_transport" else ""
                raise ConfigError(
                    f"{name} is {values[name]!r}: it must be one of {', '.join(setting.choices)}{remedy}"
                )
        mount = PlaceInVehicle(*(values[name] for name in PLACE_NAMES))
        frames = FrameNames(**{name: values[name] for name in FRAME_NAMES}, place=mount)
        frames.check(for_tf=values["publish_tf"])
        given = sorted(name for name in SETTINGS if name.startswith(RIG_PREFIX) and values[name])
        if given and not values["rectified"]:
            raise ConfigError(
                f"{given[0]} is set, but rectified is false: rig.* describes rectified cameras; leave it 0, "
                "as K, D, R and P of raw ones come from CameraInfo"
            )
        rig = {
            name.removeprefix(RIG_PREFIX): values[name] for name in SETTINGS if name.startswith(RIG_PREFIX)
        }
        settings = {name: value for name, value in values.items() if is_calibrator_setting(name)}
        return cls(
            **{name: values[name] for name in cls.__slots__ if name in values and name not in _CONVERTED},
            output_path=_output_path(values["output_path"]),
            exports=_exports(values["exports"], values["output_path"]),
            mount=mount,
            rig=rig if any(rig.values()) else {},
            calibrator=CalibratorConfig.from_mapping(settings),
        )

    @property
    def targets(self) -> Targets:
        """What is good enough for a call."""
        stds = (self.target_height_std_m, self.target_pitch_std_rad, self.target_roll_std_rad)
        return Targets(*stds, self.frames)

    @property
    def frame_names(self) -> FrameNames:
        """The frames of a transform."""
        return FrameNames(self.vehicle_frame, self.road_frame, self.camera_frame, self.mount)

    def rig_from_parameters(self) -> StereoRig | None:
        """Return the rig of ``rig.*``, None when it is to come from CameraInfo.

        Raises:
            RigError: Some values are given and others not, or they are invalid.
        """
        if not self.rig:
            return None
        missing = [RIG_PREFIX + name for name, value in self.rig.items() if not value]
        if missing:
            raise RigError(
                f"{', '.join(missing)} not set: set all parameters of {RIG_PREFIX}* or none of them"
            )
        return StereoRig.from_mapping(self.rig)


def _exports(text: str, output_path: str) -> tuple[str, ...]:
    try:
        names = parse_exports(text)
    except ConfigError as error:
        raise ConfigError(f"exports is {text!r}: {error}") from error
    if names and not output_path.strip():
        raise ConfigError(f"exports is {text!r}, but output_path, beside which they are written, is empty")
    return names


def _output_path(text: str) -> Path | None:
    if not text.strip():
        return None
    try:
        return Path(text).expanduser().absolute()
    except RuntimeError as error:  # no home folder
        why = str(error).lower().rstrip(".")
        raise ConfigError(f"output_path is {text!r}: {why}; give the whole path, or set HOME") from error
