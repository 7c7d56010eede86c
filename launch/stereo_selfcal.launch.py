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

"""Starts the node beside a running stereo camera; every parameter of the node is an argument.

ros2 launch stereo_selfcal stereo_selfcal.launch.py camera:=/front_stereo output_path:=/data/front.yaml
ros2 launch stereo_selfcal stereo_selfcal.launch.py --show-args
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from stereo_selfcal.files.node_settings import NodeSetting, all_settings

PACKAGE = "stereo_selfcal"

# Launch argument -> the node's topic, description.
TOPICS = {
    "left_image": ("left/image_rect", "Rectified image of the left camera"),
    "right_image": ("right/image_rect", "Rectified image of the right camera"),
    "left_raw_image": ("left/image_raw", "Raw image of the left camera, for rectified:=false"),
    "right_raw_image": ("right/image_raw", "Raw image of the right camera, for rectified:=false"),
    "left_camera_info": ("left/camera_info", "CameraInfo of the left camera"),
    "right_camera_info": ("right/camera_info", "CameraInfo of the right camera"),
}
# Parameters that every node has.
COMMON = {"use_sim_time": (bool, "Whether time comes from /clock")}


def parameters() -> dict[str, tuple[type | None, str]]:
    """Return type and description of every parameter by name: those the node declares."""
    declared = {s.name: (_type(s), f"{s.description}{_range(s)}") for s in all_settings()}
    return {**declared, **COMMON}


def _type(setting: NodeSetting) -> type | None:
    """Return the type of an argument, None for the one it is written as: a switch is 1 or true."""
    return None if setting.is_switch else type(setting.default)


def _range(setting: NodeSetting) -> str:
    if setting.choices:
        return f"; one of {', '.join(setting.choices)}"
    return f"; {setting.range_text}" if setting.range_text else ""


def generate_launch_description() -> LaunchDescription:
    """Return the launch description: one node."""
    params_file = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "stereo_selfcal.yaml"])
    arguments = [
        DeclareLaunchArgument("params_file", default_value=params_file, description="Parameters of the node"),
        DeclareLaunchArgument(
            "camera",
            default_value="",
            description="Namespace of the stereo camera, in front of the topics",
        ),
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the node itself"),
        DeclareLaunchArgument(
            "log_level", default_value="info", description="debug, info, warn, error or fatal"
        ),
    ]
    arguments += [
        DeclareLaunchArgument(name, default_value=topic, description=description)
        for name, (topic, description) in TOPICS.items()
    ]
    # An empty argument leaves the parameter to params_file; an empty word can be given there alone.
    arguments += [
        DeclareLaunchArgument(name, default_value="", description=f"{description} (empty: from params_file)")
        for name, (_, description) in parameters().items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_node)])


def _node(context: LaunchContext) -> list[Node]:
    """Return the node for the arguments as they were given."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    camera = given("camera").rstrip("/")
    remappings = []
    for name, (topic, _) in TOPICS.items():
        target = given(name)
        remappings.append((topic, target if target.startswith("/") or not camera else f"{camera}/{target}"))
    values = [
        {name: ParameterValue(LaunchConfiguration(name), value_type=kind)}
        for name, (kind, _) in parameters().items()
        if given(name)
    ]
    return [
        Node(
            package=PACKAGE,
            executable="node",
            name=PACKAGE,
            namespace=given("namespace"),
            output="screen",
            remappings=remappings,
            parameters=[given("params_file"), *values],
            ros_arguments=["--log-level", given("log_level")],
        )
    ]
