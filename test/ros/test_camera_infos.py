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

"""The CameraInfo that the node has received, and which of it holds for a pair."""

import threading
import time

import pytest
from sensor_msgs.msg import CameraInfo

from stereo_selfcal.core.camera.camera_info import CameraInfoError
from stereo_selfcal.core.camera.pairing import StampedPair
from stereo_selfcal.ros import inputs
from stereo_selfcal.ros.inputs import CameraInfos
from stereo_selfcal.ros.pair_source import Topics

SIDES = ("left", "right")


def message(stamp_s, fx=500.0):
    made = CameraInfo()
    made.header.stamp.sec = stamp_s
    made.k[0] = made.p[0] = fx
    return made


def pair(stamp_s):
    return StampedPair(None, None, stamp_s * 10**9, stamp_s * 10**9)


def kept(*messages):
    infos = CameraInfos()
    for each in messages:
        for side in SIDES:
            infos.keep(side, each)
    return infos


@pytest.fixture
def waits(monkeypatch):
    """Wait for no CameraInfo that may never come."""
    monkeypatch.setattr(inputs, "_LATE_S", 0.0)


def test_a_pair_has_the_camera_info_of_its_stamp(waits):
    first, second = message(1), message(2)
    infos = kept(first, second)
    assert infos.of(pair(1)) == (first, first)
    assert infos.of(pair(2)) == (second, second)
    assert infos.last == (second, second)


def test_before_the_first_calibrated_one_there_is_that(waits):
    calibrated = message(2)
    infos = kept(message(1, fx=0.0), calibrated)
    assert infos.of(pair(1)) == (calibrated, calibrated)


def test_there_may_be_none(waits):
    infos = CameraInfos()
    assert infos.of(pair(1)) == (None, None)
    infos.keep("left", message(1))
    assert infos.of(pair(1))[1] is None and infos.missing == (False, True)
    infos.clear()
    assert infos.missing == (True, True)


def test_a_camera_info_that_comes_after_its_image_is_waited_for(monkeypatch):
    monkeypatch.setattr(inputs, "_LATE_S", 60.0)
    infos, late = kept(message(1)), message(2, fx=600.0)
    thread = threading.Thread(target=lambda: [infos.keep(side, late) for side in SIDES])
    waited = threading.Timer(0.05, thread.start)
    waited.start()
    assert infos.of(pair(2)) == (late, late)
    thread.join()


def test_one_that_is_sent_once_is_not_waited_for_again(monkeypatch):
    monkeypatch.setattr(inputs, "_LATE_S", 0.2)
    only = message(1)
    infos = kept(only)
    assert infos.of(pair(2)) == (only, only)
    start_s = time.monotonic()
    for stamp_s in range(3, 103):
        assert infos.of(pair(stamp_s)) == (only, only)
    assert time.monotonic() - start_s < 100 * 0.2 / 2


def test_two_publishers_on_one_topic_are_refused_with_its_name(waits):
    infos = kept(*(message(i, fx=500.0 + 100 * (i % 2)) for i in range(4)))
    topics = Topics("/left/image", "/right/image", "/left/camera_info", "/right/camera_info")
    with pytest.raises(CameraInfoError, match=r"between fx .* 500 and .* 600, on /left/camera_info"):
        infos.check(topics, True)
    kept(*(message(i, fx=500.0) for i in range(4))).check(topics, True)
