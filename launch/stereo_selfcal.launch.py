"""Starts the node beside a running stereo camera.

ros2 launch stereo_selfcal stereo_selfcal.launch.py camera:=/front_stereo output_path:=/data/front.yaml
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = "stereo_selfcal"

# Launch argument -> the node's topic, default, description.
TOPICS = {
    "left_image": ("left/image_rect", "Rectified image of the left camera"),
    "right_image": ("right/image_rect", "Rectified image of the right camera"),
    "left_camera_info": ("left/camera_info", "CameraInfo of the left camera"),
    "right_camera_info": ("right/camera_info", "CameraInfo of the right camera"),
}
# Parameters that are often given on the command line; empty leaves them to params_file.
PARAMETERS = {
    "output_path": (str, "File the result is written to"),
    "image_transport": (str, "raw or compressed"),
    "approximate_sync": (bool, "Whether the stamps of a left and a right image may differ"),
    "approximate_sync_tolerance_seconds": (float, "By how much [s]"),
    "timeout_s": (float, "How long ~/calibrate waits for usable frames [s]"),
    "frames": (int, "Accepted frames that one call of ~/calibrate fuses"),
    "road_frame": (str, "Frame of the road"),
    "camera_frame": (str, "Frame of the camera body"),
    "use_sim_time": (bool, "Whether time comes from /clock"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the launch description: one node."""
    params_file = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "stereo_selfcal.yaml"])
    arguments = [
        DeclareLaunchArgument("params_file", default_value=params_file, description="Parameters of the node"),
        DeclareLaunchArgument(
            "camera",
            default_value="",
            description="Namespace of the stereo camera, in front of the four topics",
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
    arguments += [
        DeclareLaunchArgument(name, default_value="", description=f"{description} (empty: from params_file)")
        for name, (_, description) in PARAMETERS.items()
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
    parameters = [given("params_file")]
    parameters += [
        {name: ParameterValue(LaunchConfiguration(name), value_type=kind)}
        for name, (kind, _) in PARAMETERS.items()
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
            parameters=parameters,
            ros_arguments=["--log-level", given("log_level")],
        )
    ]
