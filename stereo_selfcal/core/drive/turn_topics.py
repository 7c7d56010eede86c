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

"""Messages of odometry and of gyroscopes: what they tell of turns of the car, and whether the images agree.

Their axes are those of REP-103 and REP-145: z up. They are of the type nav_msgs/Odometry, whose twist is in
the body of the car, or sensor_msgs/Imu. This module needs no ROS.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ..camera.pairing import message_stamp_ns, stamp_to_s
from .travel import TravelStep
from .turn_rates import TurnRate, TurnRates, speed_differs, turn_differs

_NOT_MEASURED = -1.0  # first element of a covariance of sensor_msgs/Imu
_YAW_RATE = 35  # of a (6, 6) covariance of x, y, z and the turns about them, the last one's variance
_ABOUT_Z = 8  # the same of a (3, 3) one
# So many steps that a source contradicts are no chance; fewer may be of a bump, or of a passing lorry.
_LEAST_STEPS = 5
_MOSTLY = 0.5


@dataclass(frozen=True, slots=True)
class TurnMessage:
    """A message of a topic with turn rates.

    Attributes:
        topic: Full name of its topic.
        rate: What it tells; None where that cannot be used.
        problem: Why it cannot be used; "" where it can.
    """

    topic: str
    rate: TurnRate | None = None
    problem: str = ""

    @classmethod
    def read(cls, topic: str, message: Any) -> TurnMessage:
        """Return what a message tells.

        Args:
            topic: Full name of its topic.
            message: A nav_msgs/Odometry or a sensor_msgs/Imu, of rclpy or of rosbags.
        """
        stamp_s = stamp_to_s(message_stamp_ns(message))
        if hasattr(message, "twist"):
            twist, variance = message.twist.twist, float(message.twist.covariance[_YAW_RATE])
            turn, speed_mps = twist.angular, float(twist.linear.x)
            where = f"twist.covariance[{_YAW_RATE}]"
        else:
            turn, speed_mps = message.angular_velocity, None
            covariance = message.angular_velocity_covariance
            if float(covariance[0]) == _NOT_MEASURED:
                why = "angular_velocity_covariance[0] is -1, as of an IMU without a gyroscope"
                return cls(topic, problem=why)
            variance, where = float(covariance[_ABOUT_Z]), f"angular_velocity_covariance[{_ABOUT_Z}]"
        if not math.isfinite(variance):
            return cls(topic, problem=f"{where} is {variance}")
        try:
            return cls(topic, TurnRate(stamp_s, float(turn.z), speed_mps))
        except ValueError as error:
            return cls(topic, problem=str(error))


@dataclass(slots=True)
class _TurnTopic:
    """What has come on one topic."""

    rates: TurnRates = field(default_factory=TurnRates)
    used: int = 0
    unusable: int = 0
    problem: str = ""


class TurnTopics:
    """Keeps what each topic tells, to compare it with the images. Not thread-safe.

    Args:
        names: Full names of the topics.
    """

    def __init__(self, names: Sequence[str] = ()) -> None:
        self._topics = {name: _TurnTopic() for name in names}

    def note(self, message: TurnMessage) -> None:
        """Take over a message."""
        topic = self._topics.setdefault(message.topic, _TurnTopic())
        if message.rate is None:
            topic.unusable += 1
            topic.problem = topic.problem or message.problem
        else:
            topic.used += 1
            topic.rates.add(message.rate)

    def doubts(self, steps: Sequence[TravelStep]) -> tuple[str, ...]:
        """Return sentences, without a full stop, on what is wrong with topics; none where all is well.

        Args:
            steps: How the images say that the car has moved.
        """
        found: list[str] = []
        for name, topic in self._topics.items():
            if not topic.used + topic.unusable:
                found.append(f"no message came on {name}, so that nothing is compared with it")
            if topic.unusable:
                found.append(
                    f"{topic.unusable} of {topic.used + topic.unusable} messages on {name} are not used: "
                    f"{topic.problem}"
                )
            found += filter(None, (_turn_doubt(name, topic.rates, steps), _speed_doubt(name, topic, steps)))
        return tuple(found)


def _turn_doubt(name: str, rates: TurnRates, steps: Sequence[TravelStep]) -> str:
    """Return a sentence where the turn rates of a topic contradict most steps in which the car turns.

    On a straight road those of every sensor agree, whatever its sign is.
    """
    telling = differing = reversed_too = 0
    for step in steps:
        turn = rates.over(step.stamp_s, step.stamp_s + step.duration_s)
        if turn is None:
            continue
        differs = turn_differs(step, turn.yaw_rate_radps)
        telling += differs or turn_differs(step, 0.0)
        differing += differs
        reversed_too += differs and turn_differs(step, -turn.yaw_rate_radps)
    if differing < _LEAST_STEPS or differing <= _MOSTLY * telling:
        return ""
    why = "is its z axis up, and are they in rad/s, of the car's body?"
    if reversed_too <= _MOSTLY * differing:
        why = "with the other sign they would: is its z axis up?"
    return (
        f"the turn rates of {name} do not agree with the images in {differing} of {telling} steps with a "
        f"turn: {why}"
    )


def _speed_doubt(name: str, topic: _TurnTopic, steps: Sequence[TravelStep]) -> str:
    """Return a sentence where the speeds of a topic contradict most steps."""
    compared = differing = 0
    for step in steps:
        turn = topic.rates.over(step.stamp_s, step.stamp_s + step.duration_s)
        if turn is not None and turn.speed_mps is not None:
            compared += 1
            differing += speed_differs(step, turn.speed_mps)
    if differing < _LEAST_STEPS or differing <= _MOSTLY * compared:
        return ""
    return (
        f"the speeds of {name} do not agree with the images in {differing} of {compared} steps: are they in "
        "m/s, along the x axis of the car's body?"
    )
