#!/usr/bin/env python3

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

"""Call a running node, and take the camera's pose from it, as a program of your own would.

    ros2 launch stereo_selfcal stereo_selfcal.launch.py camera:=/stereo
    python3 examples/call_node.py

It needs ROS 2 and nothing of stereo_selfcal: services and topics have standard types.
"""

import math
import sys

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

NODE = "/stereo_selfcal"
# A late reader gets the last pose: it is latched.
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Client(Node):
    """Keeps the last pose that the node has published."""

    def __init__(self) -> None:
        super().__init__("call_stereo_selfcal")
        self.pose: PoseWithCovarianceStamped | None = None
        self.create_subscription(PoseWithCovarianceStamped, f"{NODE}/pose", self._keep, LATCHED)
        self.service = self.create_client(Trigger, f"{NODE}/calibrate")

    def _keep(self, pose: PoseWithCovarianceStamped) -> None:
        self.pose = pose


def main() -> int:
    """Calibrate and print; the status is 1 where nothing new is in force, 2 where there is no node."""
    rclpy.init()
    client = Client()
    try:
        if not client.service.wait_for_service(timeout_sec=30.0):
            print(f"no service {NODE}/calibrate: is the node running?", file=sys.stderr)
            return 2
        # Drive while it runs: it ends when the mount is known as well as the node's parameters ask.
        answer = client.service.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(client, answer)
        print(answer.result().message)
        if not answer.result().success:
            return 1
        while client.pose is None:
            rclpy.spin_once(client)
        print_pose(client.pose)
        return 0
    finally:
        client.destroy_node()
        rclpy.try_shutdown()


def print_pose(message: PoseWithCovarianceStamped) -> None:
    """Print where the camera is, in which frame, and how well that is known."""
    place = message.pose.pose.position
    # Rows of the covariance: x, y, z, and the rotations about x (roll), y (pitch), z (yaw).
    z, roll, pitch = (math.sqrt(message.pose.covariance[7 * axis]) for axis in (2, 3, 4))
    print(f"in {message.header.frame_id}: x {place.x:.3f} m, y {place.y:.3f} m, z {place.z:.3f} m")
    print(f"std: z {z:.3f} m, roll {math.degrees(roll):.3f} deg, pitch {math.degrees(pitch):.3f} deg")


if __name__ == "__main__":
    sys.exit(main())
