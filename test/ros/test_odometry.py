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

"""The node listens to odometry and to a gyroscope while a call runs, and at no other time."""

import pytest

pytest.importorskip("rclpy")

from nav_msgs.msg import Odometry
from node_in_process import NodeInProcess
from sensor_msgs.msg import Imu

from stereo_selfcal.core.errors import ConfigError

ODOMETRY, IMU = "/car/odom", "/car/imu"


def odometry(second=1, rate=0.1):
    message = Odometry()
    message.header.stamp.sec = second
    message.twist.twist.angular.z, message.twist.twist.linear.x = rate, 5.0
    return message


def listened_to(node):
    return {each.topic_name for each in node.node.subscriptions} & {ODOMETRY, IMU}


def test_it_listens_while_a_call_runs_only():
    """Named relative to the node's namespace or in full."""
    during = []

    def sent(number):
        during.append(listened_to(node))
        return [(ODOMETRY, odometry(number))]

    options = {"namespace": "/car"}
    with NodeInProcess(options, odometry_topic="odom", imu_topic=IMU, timeout_s=0.3) as node:
        assert listened_to(node) == set()
        answer = node.calibrate(sent)
        assert {ODOMETRY, IMU} in during
        assert listened_to(node) == set()
        assert not answer.success
        assert f"; no message came on {IMU}, so that nothing is compared with it" in answer.message
        assert ODOMETRY not in answer.message
        assert f"no message came on {ODOMETRY}" in node.calibrate().message, "each call hears for itself"
        node.check()


def test_messages_that_cannot_be_used_harm_nothing():
    unmeasured = Imu()
    unmeasured.angular_velocity_covariance[0] = -1.0
    messages = [(ODOMETRY, odometry(rate=float("nan"))), (IMU, unmeasured)]
    with NodeInProcess(odometry_topic=ODOMETRY, imu_topic=IMU, timeout_s=0.3) as node:
        told = node.calibrate(messages).message
        assert f"messages on {ODOMETRY} are not used: yaw_rate_radps of a turn rate is nan" in told
        assert f"messages on {IMU} are not used: angular_velocity_covariance[0] is -1" in told
        node.check()


def test_without_the_parameters_it_listens_to_none():
    during = []

    def sent(_number):
        during.append({each.msg_type for each in node.node.subscriptions})
        return []

    with NodeInProcess() as node:
        node.calibrate(sent)
    assert not any(types & {Odometry, Imu} for types in during)


@pytest.mark.parametrize("name", ["odometry_topic", "imu_topic"])
def test_a_name_that_no_topic_can_have_is_refused_at_the_start(name):
    with pytest.raises(ConfigError, match=f"{name} is 'no topic': .*give the name of a topic, or leave it"):
        NodeInProcess(**{name: "no topic"}).__enter__()
