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

"""Parameters of the node, besides the settings of the calibrator. This module needs no ROS.

This table is the only list of the node's parameters. The node and the launch file declare them from it, and
:mod:`.parameter_file` tells by it a parameter of the node from a setting of the calibrator.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

from ..core.config import CalibratorConfig
from ..core.errors import ConfigError, shortened
from ..core.geometry.alignment import ALIGNMENT_NAMES, ALIGNMENT_STD_NAMES
from ..core.geometry.pose import STD_NAMES
from ..core.tolerances import DEFAULT_HEIGHT_STD_M, DEFAULT_PITCH_STD_RAD, DEFAULT_ROLL_STD_RAD

NODE_NAME = "stereo_selfcal"
VEHICLE_FRAME, ROAD_FRAME, CAMERA_FRAME = "base_footprint", "road", "stereo_camera"
# Value of camera_frame: the name is that of the left CameraInfo.
FROM_CAMERA_INFO = "from_camera_info"
RIG_PREFIX = "rig."
RESULT_PREFIX = "extrinsics."
# Parameters of the standard deviations that are good enough, in the order of a pose.
TARGET_NAMES = tuple(f"target_{name}" for name in STD_NAMES)
ALIGNMENT_PREFIX = "alignment."
# Result parameters that have the prefix of a setting in common, alignment.correct.
ALIGNMENT_RESULTS = tuple(ALIGNMENT_PREFIX + name for name in (*ALIGNMENT_NAMES, *ALIGNMENT_STD_NAMES))

# Parameters that come with every node or with the result file, and that are nobody's setting here.
FOREIGN_PREFIXES = (RESULT_PREFIX, "provenance.", "qos_overrides.", "diagnostic_updater.")
FOREIGN_NAMES = ("use_sim_time", "start_type_description_service", *ALIGNMENT_RESULTS)

# Where earlier versions wrote the result of every node: read still, where it is of the same images.
OLD_OUTPUT_PATH = f"~/.ros/{NODE_NAME}.yaml"

# Limits that no rectified camera of the next decades exceeds; they detect typing errors.
_GREATEST_PIXELS = 100_000
_GREATEST_BASELINE_M = 100.0
_GREATEST_QUEUE = 1000
_GREATEST_MOUNT_M = 100.0
# Far beyond what any calibration has; who asks for nothing gives 0. They detect values in mm or degrees.
_GREATEST_TARGET_M = 1.0
_GREATEST_TARGET_RAD = 1.0

# Characters of a text. ROS allows names of 255; Linux paths of 4096 with the zero at their end (PATH_MAX).
_LONGEST_NAME = 255
_LONGEST_PATH = 4095


def _plain(number: float) -> str:
    """Return a number in the digits people use: 2147483647, not 2.14748e+09."""
    return f"{number:.0f}" if float(number).is_integer() else f"{number:g}"


@dataclass(frozen=True, slots=True)
class NodeSetting:
    """One parameter of the node.

    Attributes:
        name: Dotted name.
        default: Value when nothing is given; its type is the parameter's.
        description: One line for people.
        unit: Unit, "" for words, counts and fractions.
        low: Smallest allowed number, None for words and switches.
        high: Largest allowed number.
        choices: Allowed words, empty when any will do.
        fixed: Whether it can only be given at the start.
    """

    name: str
    default: bool | int | float | str
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    fixed: bool = False

    @property
    def range_text(self) -> str:
        """The range as people write it, with the unit; empty for words and switches of true and false."""
        if self.low is None or self.high is None:
            return ""
        return f"{_plain(self.low)} ... {_plain(self.high)} {self.unit}".rstrip()

    @property
    def is_switch(self) -> bool:
        """Whether it is a number of which 0 means false and 1 true."""
        return type(self.default) is int and (self.low, self.high) == (0, 1)


def check_text(name: str, text: str) -> None:
    """Refuse a text that would forge lines, or is too long for where it ends up: answers, logs and files.

    Args:
        name: Name of the parameter.
        text: Its value.

    Raises:
        ConfigError: It has characters that cannot be printed (line ends, escapes), or is too long.
    """
    longest = _LONGEST_PATH if name == "output_path" else _LONGEST_NAME
    if not text.isprintable():
        raise ConfigError(f"{name} is {shortened(text)}: give it printable characters only")
    if len(text) > longest:
        raise ConfigError(
            f"{name} is {shortened(text)}, {len(text)} characters: give it at most {longest} characters"
        )


NODE_SETTINGS = (
    NodeSetting(
        "approximate_sync",
        False,
        "Whether the stamps of a left and a right image may differ; false: equal only",
    ),
    NodeSetting(
        "approximate_sync_tolerance_seconds",
        0.01,
        "Greatest difference of the stamps of a pair, inclusive, when approximate_sync is true",
        "s",
        0.0,
        1.0,
    ),
    NodeSetting(
        "queue_size",
        5,
        "Images of each side that wait for their partner, and pairs that wait for the calibrator",
        "",
        1,
        _GREATEST_QUEUE,
    ),
    NodeSetting(
        "image_transport",
        "raw",
        "raw: sensor_msgs/Image; compressed: sensor_msgs/CompressedImage on <topic>/compressed",
        choices=("raw", "compressed"),
        fixed=True,
    ),
    NodeSetting(
        "rectified",
        True,
        "true: image_rect of both cameras is read; false: image_raw, which is undistorted and rectified here",
        fixed=True,
    ),
    NodeSetting(
        "odometry_topic",
        "",
        "nav_msgs/Odometry that a call compares the motion in the images with; empty: none",
        fixed=True,
    ),
    NodeSetting(
        "imu_topic",
        "",
        "The same of sensor_msgs/Imu in the axes of the vehicle, z up; empty: none",
        fixed=True,
    ),
    NodeSetting(
        "output_path",
        OLD_OUTPUT_PATH,  # that of a node without namespace; see default_output_path()
        "File the result is written to (~ is the home folder); empty: it is not written; default: "
        "~/.ros/<namespace>/<name of the node>.yaml ($ROS_HOME instead of ~/.ros, where it is set)",
    ),
    NodeSetting(
        "timeout_s",
        60.0,
        "How long ~/calibrate collects frames, if the targets are not reached before",
        "s",
        0.1,
        3600.0,
    ),
    NodeSetting("frames", 1, "Least number of accepted frames that ~/calibrate collects", "", 1, 10_000),
    NodeSetting(
        "target_height_std_m",
        DEFAULT_HEIGHT_STD_M,
        "Standard deviation of the height at which ~/calibrate ends; 0: any is good enough",
        "m",
        0.0,
        _GREATEST_TARGET_M,
    ),
    NodeSetting(
        "target_pitch_std_rad",
        DEFAULT_PITCH_STD_RAD,
        "Standard deviation of the pitch at which ~/calibrate ends; 0: any is good enough",
        "rad",
        0.0,
        _GREATEST_TARGET_RAD,
    ),
    NodeSetting(
        "target_roll_std_rad",
        DEFAULT_ROLL_STD_RAD,
        "Standard deviation of the roll at which ~/calibrate ends; 0: any is good enough",
        "rad",
        0.0,
        _GREATEST_TARGET_RAD,
    ),
    NodeSetting(
        "monitor_period_s",
        2.0,
        "Time between two frames that the watch over the calibration looks at; 0: no watch",
        "s",
        0.0,
        3600.0,
    ),
    NodeSetting(
        "on_drift",
        "warn",
        "What follows from a camera that was moved; warn: the state tells; recalibrate: the mean of the "
        "watch's frames takes over, also where nothing is calibrated yet",
        choices=("warn", "recalibrate"),
    ),
    NodeSetting(
        "vehicle_frame",
        VEHICLE_FRAME,
        "Frame of the vehicle on the road, x along the direction of travel: parent of camera_frame once the "
        "yaw is known; the name of road_frame: the yaw and mount.* are left out",
    ),
    NodeSetting(
        "mount.x_m",
        0.0,
        "How far ahead of the origin of vehicle_frame the middle of the baseline is",
        "m",
        -_GREATEST_MOUNT_M,
        _GREATEST_MOUNT_M,
    ),
    NodeSetting(
        "mount.y_m",
        0.0,
        "How far to the left of it",
        "m",
        -_GREATEST_MOUNT_M,
        _GREATEST_MOUNT_M,
    ),
    NodeSetting(
        "road_frame",
        ROAD_FRAME,
        "Frame of the road under the camera, x along its heading: parent of camera_frame while the yaw is "
        "unknown",
    ),
    NodeSetting(
        "camera_frame",
        CAMERA_FRAME,
        "Frame of the camera body (x forward, y left, z up, mid-baseline); the frame_id of the left "
        f"CameraInfo, or {FROM_CAMERA_INFO}: the optical frame of the left camera",
    ),
    NodeSetting(
        "exports",
        "",
        "Formats written beside output_path, comma separated: urdf, static_transform_publisher, autoware, "
        "homographies, camera_info",
    ),
    NodeSetting(
        "publish_camera_info",
        False,
        "Whether ~/left/camera_info and ~/right/camera_info get the CameraInfo of the pair, corrected where "
        "the right camera is three standard deviations off",
        fixed=True,
    ),
    NodeSetting(
        "publish_tf",
        False,
        "Whether /tf_static gets the transform of camera_frame; needs tf2_ros",
        fixed=True,
    ),
    NodeSetting("rig.width", 0, "Image width; 0: from CameraInfo", "px", 0, _GREATEST_PIXELS),
    NodeSetting("rig.height", 0, "Image height; 0: from CameraInfo", "px", 0, _GREATEST_PIXELS),
    NodeSetting(
        "rig.fx", 0.0, "Horizontal focal length; 0: from CameraInfo", "px", 0.0, float(_GREATEST_PIXELS)
    ),
    NodeSetting(
        "rig.fy", 0.0, "Vertical focal length; 0: from CameraInfo", "px", 0.0, float(_GREATEST_PIXELS)
    ),
    NodeSetting(
        "rig.cx", 0.0, "Column of the principal point; 0: from CameraInfo", "px", 0.0, float(_GREATEST_PIXELS)
    ),
    NodeSetting(
        "rig.cy", 0.0, "Row of the principal point; 0: from CameraInfo", "px", 0.0, float(_GREATEST_PIXELS)
    ),
    NodeSetting(
        "rig.baseline_m", 0.0, "Distance of the cameras; 0: from CameraInfo", "m", 0.0, _GREATEST_BASELINE_M
    ),
)


def ros_home() -> str:
    """Return the folder in which ROS keeps what it writes, as rcl finds it; ``~`` is not expanded."""
    return os.environ.get("ROS_HOME") or "~/.ros"


def default_output_path(full_name: str) -> str:
    """Return where a node writes its result by default: a file of its own, whatever other nodes there are.

    Args:
        full_name: Namespace and name of the node, ``/front/stereo_selfcal``.
    """
    return f"{ros_home()}/{full_name.strip('/')}.yaml"


def all_settings() -> Iterator[NodeSetting]:
    """Yield every parameter the node declares for its user: its own, then the calibrator's."""
    yield from NODE_SETTINGS
    for name, default, setting in CalibratorConfig().settings():
        yield NodeSetting(
            name,
            default,
            setting.description,
            setting.unit,
            None if setting.choices else setting.low,
            None if setting.choices else setting.high,
            setting.choices,
        )


def is_calibrator_setting(name: str) -> bool:
    """Whether a name in a parameter file is meant for the calibrator, be it known to it or not."""
    own = {setting.name for setting in NODE_SETTINGS}
    return not (name in own or name in FOREIGN_NAMES or name.startswith(FOREIGN_PREFIXES))
