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

"""Recordings of odometry and of gyroscopes, to be read beside the images of another bag."""

import numpy as np
from bag_making import FIRST_NS, NS_PER_S, _writer2
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_typestore

ODOMETRY, IMU = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"


def make_turn_bag(path, topics, kind="mcap", late_ns=1_000_000):
    """Write a recording of topics with turn rates and return what to open.

    Args:
        path: The folder to write.
        topics: By name: the type, and (seconds since the first image, turn rate, speed) of each message.
        kind: As of bag_making.
        late_ns: How much later than its stamp a message is recorded.
    """
    ros1 = kind.startswith("ros1")
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    writer = Writer1(path.with_suffix(".bag")) if ros1 else _writer2(path, kind)
    with writer:
        for name, (msgtype, samples) in topics.items():
            connection = writer.add_connection(name, msgtype, typestore=types)
            for after_s, rate, speed in samples:
                stamp_ns = FIRST_NS + round(after_s * NS_PER_S)
                message = turn_message(types, msgtype, stamp_ns, rate, speed, ros1)
                data = (types.serialize_ros1 if ros1 else types.serialize_cdr)(message, msgtype)
                writer.write(connection, stamp_ns + late_ns, data)
    return path.with_suffix(".bag") if ros1 else path


def turn_message(types, msgtype, stamp_ns, rate, speed, ros1=False):
    def of(name, **fields):
        return types.types[name](**fields)

    def vector(x=0.0, z=0.0):
        return of("geometry_msgs/msg/Vector3", x=x, y=9.0, z=z)

    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    stamp = of("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    seq = {"seq": 0} if ros1 else {}
    header = of("std_msgs/msg/Header", stamp=stamp, frame_id="base_link", **seq)
    turned = of("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    if msgtype == IMU:
        nothing = np.zeros(9)
        return of(
            IMU,
            header=header,
            orientation=turned,
            orientation_covariance=nothing,
            angular_velocity=vector(z=rate),
            angular_velocity_covariance=nothing,
            linear_acceleration=vector(),
            linear_acceleration_covariance=nothing,
        )
    nothing = np.zeros(36)
    pose = of(
        "geometry_msgs/msg/Pose",
        position=of("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0),
        orientation=turned,
    )
    twist = of("geometry_msgs/msg/Twist", linear=vector(x=speed), angular=vector(z=rate))
    return of(
        ODOMETRY,
        header=header,
        child_frame_id="base_link",
        pose=of("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=nothing),
        twist=of("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=nothing),
    )
