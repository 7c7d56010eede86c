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

"""replay with odometry or a gyroscope beside the images."""

import json

import pytest
from bag_making import cameras, make_bag
from fake_calibrator import use_fake
from travel_making import step
from turn_making import IMU, ODOMETRY, make_turn_bag

from stereo_selfcal.cli.replay import main

N_FRAMES = 30
BENDS = [step(i, turn=0.02 if i < 12 else -0.02) for i in range(N_FRAMES - 1)]


@pytest.fixture
def calibrator(monkeypatch):
    """The images say that the car drives through a bend to the left and one to the right."""
    calibrator = use_fake(monkeypatch)
    monkeypatch.setattr(calibrator, "travel_steps", tuple(BENDS))
    return calibrator


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("turns")
    samples = [
        (each.middle_s - 100.0 + part, each.motion.turned_rad[2] / 0.1, 10.0)
        for each in BENDS
        for part in (-0.03, 0.02)
    ]
    topics = {
        "/odom": (ODOMETRY, samples),
        "/imu": (IMU, samples),
        "/imu_upside_down": (IMU, [(after, -rate, 0.0) for after, rate, _ in samples]),
        "/odom_km_per_h": (ODOMETRY, [(after, rate, 36.0) for after, rate, _ in samples]),
    }
    images = make_bag(folder / "images", cameras(), n_frames=N_FRAMES)
    return str(images), str(make_turn_bag(folder / "turns", topics))


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_calibrator_gets_the_turn_rates_before_the_frames_they_belong_to(bags, calibrator, capsys, jobs):
    assert main([*bags, "--odometry", "/odom", "--imu", "/imu", "--json", "--jobs", jobs]) == 0
    (made,) = calibrator.made
    assert len(made.turn_rates) == 4 * len(BENDS)
    assert {each.speed_mps for each in made.turn_rates} == {None, 10.0}
    first = made.turn_rates[0]
    assert (first.stamp_s, first.yaw_rate_radps) == pytest.approx((100.02, 0.2))
    assert "remarks" not in json.loads(capsys.readouterr().out)


def test_without_the_options_it_gets_none(bags, calibrator):
    assert main([*bags]) == 0
    assert calibrator.made[0].turn_rates == []


@pytest.mark.parametrize(
    ("options", "remark"),
    [
        (["--imu", "/imu_upside_down"], "the turn rates of /imu_upside_down do not agree with the images"),
        (["--odometry", "/odom_km_per_h"], "the speeds of /odom_km_per_h do not agree with the images"),
    ],
)
def test_a_topic_that_the_images_contradict_is_told(bags, calibrator, capsys, options, remark):
    assert main([*bags, *options, "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["remarks"]
    assert told.startswith(remark)
    assert main([*bags, *options]) == 0
    assert f"\n{told}\n" in capsys.readouterr().out


def test_a_topic_without_messages_in_the_selected_time_is_told(bags, calibrator, tmp_path, capsys):
    late = make_turn_bag(tmp_path / "late", {"/late": (IMU, [(20.0, 0.0, 0.0)])})
    assert main([*bags, str(late), "--imu", "/late", "--end", "3", "--json"]) == 0
    remarks = json.loads(capsys.readouterr().out)["remarks"]
    assert remarks == ["no message came on /late, so that nothing is compared with it"]


def test_a_topic_that_is_not_there_is_bad_usage(bags, calibrator, capsys):
    assert main([*bags, "--imu", "/odom"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert "--imu /odom: it is of nav_msgs/msg/Odometry, sensor_msgs/msg/Imu is read; topics" in err
