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

"""Messages of odometry and of gyroscopes: what is used of them, and what is told of a topic that is wrong."""

import math
from types import SimpleNamespace as Thing

import numpy as np
import pytest
from travel_making import step

from stereo_selfcal.core.drive.turn_rates import TurnRate
from stereo_selfcal.core.drive.turn_topics import TurnMessage, TurnTopics

STAMP = Thing(stamp=Thing(sec=100, nanosec=250_000_000))
OTHERS = {"x": 7.0, "y": 8.0}  # what must not be taken for the vertical


def odometry(rate=0.1, speed=12.0, variance=0.0):
    covariance = np.full(36, 5.0)
    covariance[35] = variance
    twist = Thing(angular=Thing(z=rate, **OTHERS), linear=Thing(x=speed, y=7.0, z=8.0))
    return Thing(header=STAMP, twist=Thing(twist=twist, covariance=covariance))


def imu(rate=0.1, variance=0.0, first=0.0):
    covariance = np.zeros(9)
    covariance[0], covariance[8] = first, variance
    return Thing(
        header=STAMP, angular_velocity=Thing(z=rate, **OTHERS), angular_velocity_covariance=covariance
    )


def test_turn_about_the_vertical_and_speed_ahead_are_read():
    assert TurnMessage.read("/odom", odometry()) == TurnMessage("/odom", TurnRate(100.25, 0.1, 12.0))
    assert TurnMessage.read("/imu", imu()) == TurnMessage("/imu", TurnRate(100.25, 0.1))


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        (imu(first=-1.0), "angular_velocity_covariance[0] is -1, as of an IMU without a gyroscope"),
        (imu(variance=math.nan), "angular_velocity_covariance[8] is nan"),
        (imu(rate=math.nan), "yaw_rate_radps of a turn rate is nan: a finite number is needed"),
        (imu(rate=math.inf), "yaw_rate_radps of a turn rate is inf: a finite number is needed"),
        (odometry(variance=math.nan), "twist.covariance[35] is nan"),
        (odometry(variance=math.inf), "twist.covariance[35] is inf"),
        (odometry(speed=-math.inf), "speed_mps of a turn rate is -inf: a finite number is needed"),
    ],
)
def test_what_is_not_measured_is_not_used_and_told(message, problem):
    read = TurnMessage.read("/topic", message)
    assert (read.rate, read.problem) == (None, problem)
    topics = TurnTopics(["/topic"])
    topics.note(read)
    topics.note(TurnMessage.read("/topic", imu()))
    assert topics.doubts([]) == (f"1 of 2 messages on /topic are not used: {problem}",)


def test_topics_on_which_nothing_comes_are_told():
    topics = TurnTopics(["/odom", "/imu"])
    topics.note(TurnMessage.read("/imu", imu()))
    assert topics.doubts([]) == ("no message came on /odom, so that nothing is compared with it",)
    topics.note(TurnMessage.read("/odom", odometry()))
    assert topics.doubts([]) == ()


def bend(n=40, turn=0.02):
    """Return steps of a bend to the left and one to the right, with straight road around each."""
    turns = [turn if 10 <= i < 20 else -turn if 25 <= i < 35 else 0.0 for i in range(n)]
    return [step(i, turn=each) for i, each in enumerate(turns)]


def topics_that(say, steps, name="/imu"):
    topics = TurnTopics([name])
    for each in steps:
        for part in (0.25, 0.75):
            rate = each.motion.turned_rad[2] / each.duration_s
            yaw_rate, speed = say(rate, each.speed_mps)
            stamp_s = each.stamp_s + part * each.duration_s
            topics.note(TurnMessage(name, TurnRate(stamp_s, yaw_rate, speed)))
    return topics


def test_a_topic_that_agrees_is_not_doubted():
    steps = bend()
    assert topics_that(lambda rate, speed: (rate, speed), steps).doubts(steps) == ()
    assert topics_that(lambda rate, speed: (1.03 * rate + 0.008, None), steps).doubts(steps) == ()


@pytest.mark.parametrize(
    ("say", "sentence"),
    [
        (
            lambda rate, speed: (-rate, None),
            "the turn rates of /imu do not agree with the images in 20 of 20 steps with a turn: with the "
            "other sign they would: is its z axis up?",
        ),
        (
            lambda rate, speed: (math.degrees(rate), None),  # they reach into the steps beside a bend
            "the turn rates of /imu do not agree with the images in 24 of 24 steps with a turn: is its z "
            "axis up, and are they in rad/s, of the car's body?",
        ),
        (
            lambda rate, speed: (0.0, None),
            "the turn rates of /imu do not agree with the images in 20 of 20 steps with a turn: is its z "
            "axis up, and are they in rad/s, of the car's body?",
        ),
        (
            lambda rate, speed: (rate, 3.6 * speed),
            "the speeds of /imu do not agree with the images in 40 of 40 steps: are they in m/s, along the x "
            "axis of the car's body?",
        ),
        (
            lambda rate, speed: (rate, -speed),
            "the speeds of /imu do not agree with the images in 40 of 40 steps: are they in m/s, along the x "
            "axis of the car's body?",
        ),
    ],
)
def test_a_wrong_sign_a_turned_sensor_and_a_wrong_unit_are_told(say, sentence):
    steps = bend()
    (doubt,) = topics_that(say, steps).doubts(steps)
    assert doubt == sentence


def test_an_offset_that_no_gyroscope_of_a_car_has_is_told_on_a_straight_road():
    steps = bend(turn=0.0)
    (doubt,) = topics_that(lambda rate, speed: (rate + math.radians(5.0), None), steps).doubts(steps)
    assert "40 of 40 steps with a turn: is its z axis up" in doubt


def test_a_wrong_sign_does_not_show_on_a_straight_road():
    steps = bend(turn=0.0)
    assert topics_that(lambda rate, speed: (-rate, None), steps).doubts(steps) == ()


def test_few_steps_that_differ_are_no_matter_of_the_topic():
    """Four steps of the images are wrong, as beside a lorry; or the topic is, in four of its turns."""
    steps = bend()
    wrong = [step(i, turn=0.05) if i in (3, 4, 12, 13) else each for i, each in enumerate(steps)]
    topics = topics_that(lambda rate, speed: (rate, speed), steps)
    assert topics.doubts(wrong) == ()


def test_each_topic_is_judged_by_itself():
    steps = bend()
    topics = topics_that(lambda rate, speed: (rate, speed), steps, "/odom")
    for each in steps:
        rate = each.motion.turned_rad[2] / each.duration_s
        topics.note(TurnMessage("/imu", TurnRate(each.middle_s, -rate)))
    (doubt,) = topics.doubts(steps)
    assert doubt.startswith("the turn rates of /imu do not agree")
