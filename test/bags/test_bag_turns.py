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

"""Odometry and gyroscopes in recordings: each frame has what was recorded since the one before."""

import math

import pytest
from bag_making import FIRST_NS, NS_PER_S, PERIOD_NS, cameras, make_bag
from turn_making import IMU, ODOMETRY, make_turn_bag

from stereo_selfcal.bags import BagError, Selection, StereoBag
from stereo_selfcal.core.camera.pairing import stamp_to_s
from stereo_selfcal.core.drive.turn_rates import TurnRate
from stereo_selfcal.offline import BagSource, open_source

# Of the stamps 100.02 s to 100.48 s; each is recorded a millisecond later.
SAMPLES = [(0.02 + 0.04 * i, 0.01 * i, 5.0 + i) for i in range(12)]
TOPICS = {
    "/odom": (ODOMETRY, SAMPLES),
    "/imu/data": (IMU, [(after, -rate, 0.0) for after, rate, _ in SAMPLES]),
    "/imu/other": (IMU, SAMPLES),
}
N_FRAMES = 6  # at 100.0 s to 100.5 s


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    return make_bag(tmp_path_factory.mktemp("turns") / "images", cameras(), n_frames=N_FRAMES)


@pytest.fixture(scope="module")
def turns(tmp_path_factory):
    return make_turn_bag(tmp_path_factory.mktemp("turns") / "turns", TOPICS)


def expected(topic, start_s, end_s):
    kind, samples = TOPICS[topic]
    return [
        TurnRate(stamp_to_s(FIRST_NS + round(after * NS_PER_S)), rate, speed if kind == ODOMETRY else None)
        for after, rate, speed in samples
        if start_s <= after < end_s
    ]


def rates_of(frame, topic):
    return [message.rate for message in frame.turns if message.topic == topic]


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "mcap-messages", "ros1"])
def test_frames_have_the_messages_since_the_frame_before(tmp_path, kind):
    images = make_bag(tmp_path / "images", cameras(), n_frames=N_FRAMES, kind=kind)
    turns = make_turn_bag(tmp_path / "turns", TOPICS, kind)
    with StereoBag([images, turns], odometry="/odom", imu="imu/data") as bag:
        assert bag.turn_topics == ("/odom", "/imu/data")
        for _ in range(2):  # they can be read again
            frames = list(bag.frames())
            assert len(frames) == N_FRAMES
            assert {message.topic for frame in frames for message in frame.turns} == {"/odom", "/imu/data"}
            for topic in ("/odom", "/imu/data"):
                found = [rate for frame in frames for rate in rates_of(frame, topic)]
                assert found == expected(topic, 0.0, 0.5)
        assert bag.frame_at(frames[2].recorded_ns).turns == ()


def test_messages_come_with_the_next_frame_or_the_one_after(images, turns):
    """One pair is read ahead of each frame; none of them comes late."""
    with StereoBag([images, turns], odometry="/odom") as bag:
        arrived = []
        for frame in bag.frames():
            arrived += rates_of(frame, "/odom")
            assert len(arrived) >= len(expected("/odom", 0.0, frame.stamp_s - 100.0))


def test_they_are_there_where_the_cameras_of_each_frame_are_followed(images, turns):
    with BagSource([images, turns], imu="/imu/data", odometry="/odom") as source:
        assert source.turn_topics == ("/odom", "/imu/data")
        found = [rate for frame in source.frames() for rate in rates_of(frame, "/imu/data")]
    assert found == expected("/imu/data", 0.0, 0.5)


@pytest.mark.parametrize(
    ("selection", "first_s", "n_frames"), [(Selection(every=3), 0.0, 2), (Selection(start_s=0.25), 0.25, 3)]
)
def test_frames_that_are_left_out_leave_no_gap(images, turns, selection, first_s, n_frames):
    with BagSource([images, turns], selection=selection, odometry="/odom") as source:
        frames = list(source.frames())
    assert len(frames) == n_frames
    found = [rate for frame in frames for rate in rates_of(frame, "/odom")]
    needed = expected("/odom", first_s, frames[-1].stamp_s - 100.0)
    assert needed and set(needed) <= set(found) and len(found) == len(set(found))


def test_nobody_who_has_not_asked_gets_them(images, turns):
    with BagSource([images, turns]) as source:
        assert source.turn_topics == ()
        assert all(frame.turns == () for frame in source.frames())


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            {"odometry": "/nowhere"},
            r"--odometry /nowhere: no message on such a topic of nav_msgs/msg/Odometry; "
            "topics of that type: /odom$",
        ),
        (
            {"odometry": "/imu/data"},
            "--odometry /imu/data: it is of sensor_msgs/msg/Imu, nav_msgs/msg/Odometry is "
            "read; topics of that type: /odom$",
        ),
        (
            {"imu": "/odom"},
            "--imu /odom: it is of nav_msgs/msg/Odometry, sensor_msgs/msg/Imu is read; topics of "
            "that type: /imu/data, /imu/other$",
        ),
    ],
)
def test_a_topic_that_is_not_there_is_refused_with_those_that_are(images, turns, asked, message):
    with pytest.raises(BagError, match=message):
        StereoBag([images, turns], **asked)


def test_a_recording_without_any_says_so(images):
    with pytest.raises(BagError, match=r"no message on such a topic .*; topics of that type: none"):
        StereoBag(images, imu="/imu")


def test_a_folder_of_images_has_no_topics(tmp_path):
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        (tmp_path / side / "0.png").touch()
    with pytest.raises(BagError, match="a folder of images has no topics: leave out --odometry and --imu"):
        open_source([tmp_path], odometry="/odom")


def test_a_message_without_numbers_is_none_of_a_rate(images, tmp_path):
    broken = make_turn_bag(tmp_path / "broken", {"/imu": (IMU, [(0.05, math.nan, 0.0), (0.06, 0.1, 0.0)])})
    with StereoBag([images, broken], imu="/imu") as bag:
        messages = [message for frame in bag.frames() for message in frame.turns]
    assert [message.rate is None for message in messages] == [True, False]
    assert "yaw_rate_radps of a turn rate is nan" in messages[0].problem
    assert messages[1].rate.stamp_s == pytest.approx((FIRST_NS + 0.6 * PERIOD_NS) * 1e-9)
