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

"""``~/road_pose``: only while somebody listens, with the stamp of the images; and why nothing comes."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.geometry.travel import Travel
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected
from stereo_selfcal.files.frames import InfoFrames, place_camera
from stereo_selfcal.ros import road_pose as road_pose_module
from stereo_selfcal.ros.calibration_keeper import ActiveCalibration
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.live import LiveFrame, NoFrame
from stereo_selfcal.ros.messages import pose_message
from stereo_selfcal.ros.road_pose import NOT_CALIBRATED, SILENT_S, RoadPosePublisher
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

CONFIG = NodeConfig.from_values({name: setting.default for name, setting in SETTINGS.items()})
POSE = named_scene("straight_road").scene.extrinsics
RESULT = CalibrationResult("good", extrinsics=POSE, covariance=np.diag([1e-6, 1e-8, 1e-8]), n_frames=1)
REFUSED = rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines", 0, Bound.LEAST, 2, "", "look at the road"))
IMAGE = np.zeros((480, 640), np.uint8)
LIVE = LiveFrame(IMAGE, IMAGE, PAPER_RIG, "", 9_000_000_007, stamp_difference_s=0.002)


class Publisher:
    def __init__(self):
        self.listeners, self.sent = 1, []

    def get_subscription_count(self):
        return self.listeners

    def publish(self, message):
        self.sent.append(message)


class Tracker:
    """Follows nothing: its results are those that are set, and what it is asked is kept."""

    made, asked, told, result = [], [], [], RESULT

    def __init__(self, rig, config, mount):
        self.made.append((rig, mount))

    def follow(self, left, right, stamp_s, stamp_difference_s):
        self.asked.append((stamp_s, stamp_difference_s))
        if isinstance(Tracker.result, Exception):
            raise Tracker.result
        return Tracker.result

    def compare(self, cold):
        self.told.append(cold)
        return True


class Stage:
    """The road on a node of cardboard, whose time and frames are those that are set."""

    def __init__(self):
        self.now_s, self.frame, self.taken, self.left = 100.0, LIVE, 0, 0
        self.active = ActiveCalibration(RESULT, PAPER_RIG, 90.0)
        self.publisher, self.logged = Publisher(), []
        node = SimpleNamespace(
            create_publisher=lambda kind, topic, qos, **_: self.publisher,
            resolve_topic_name=lambda topic: topic,
            context=SimpleNamespace(ok=lambda: True),
            get_logger=lambda: SimpleNamespace(error=lambda text, **_: self.logged.append(text)),
        )
        active, clock = (lambda: self.active), (lambda: self.now_s)
        self.road = RoadPosePublisher(node, self.take, active, lambda: CONFIG, clock=clock, leave=self.leave)
        self.road._stopped.wait = lambda _s: False  # no time is lost by waiting

    def take(self, timeout_s):
        self.taken += 1
        return self.frame

    def leave(self):
        self.left += 1

    def step(self):
        self.publisher.sent.clear()
        self.road.step()
        return list(self.publisher.sent)


@pytest.fixture
def stage(monkeypatch):
    monkeypatch.setattr(road_pose_module, "RoadTracker", Tracker)
    Tracker.result = RESULT
    for kept in (Tracker.made, Tracker.asked, Tracker.told):
        kept.clear()
    return Stage()


def test_the_message_is_that_of_the_pose_with_the_stamp_of_the_left_image(stage):
    moved = Extrinsics(POSE.height_m + 0.01, POSE.pitch_rad + 0.02, POSE.roll_rad)
    Tracker.result = replace(RESULT, extrinsics=moved)
    (message,) = stage.step()
    placed = place_camera(Tracker.result, PAPER_RIG, CONFIG.frame_names, InfoFrames())
    assert message == pose_message(placed, LIVE.stamp_ns)
    assert message.header.frame_id == CONFIG.frame_names.road_frame  # the yaw of the mount is not known
    assert message.pose.pose.position.z == moved.height_m
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (9, 7)
    assert Tracker.asked == [(pytest.approx(9.000000007), 0.002)]
    assert Tracker.made == [(PAPER_RIG, RESULT)]


def test_the_yaw_is_that_of_the_mount(stage):
    """No frame tells the direction of travel, and the place in the vehicle is a matter of the mount."""
    travel = Travel(np.radians(2.0), 0.0, np.diag(np.radians([0.1, 0.1]) ** 2), 50, 0.0, 30.0)
    stage.active = replace(stage.active, result=replace(RESULT, travel=travel))
    (message,) = stage.step()
    assert message.header.frame_id == CONFIG.frame_names.vehicle_frame
    placed = place_camera(stage.active.result, PAPER_RIG, CONFIG.frame_names, InfoFrames())
    assert message == pose_message(placed, LIVE.stamp_ns)


def test_the_same_frame_is_published_once(stage):
    assert len(stage.step()) == 1 and stage.step() == []
    stage.frame = replace(LIVE, stamp_ns=LIVE.stamp_ns + 10**8)
    assert len(stage.step()) == 1
    assert len(Tracker.made) == 1  # one tracker follows one road


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"active": None}, NOT_CALIBRATED),
        ({"frame": None}, "a call of ~/calibrate has all images"),
        ({"frame": NoFrame("no pair in 1.0 s: nothing arrives")}, "nothing arrives"),
        ({"frame": replace(LIVE, rig=None, problem="no CameraInfo")}, "no CameraInfo"),
        ({"frame": replace(LIVE, refusal=REFUSED.rejection)}, "look at the road"),
        ({"frame": replace(LIVE, rig=replace(PAPER_RIG, fx=700.0))}, "fx"),
    ],
    ids=["not calibrated", "call", "silence", "no rig", "frozen", "other camera"],
)
def test_where_nothing_is_published_the_reason_is_told(stage, changes, words):
    assert len(stage.step()) == 1
    assert stage.road.described == "published"
    for name, value in changes.items():
        setattr(stage, name, value)
    stage.now_s += SILENT_S
    assert stage.step() == []
    assert stage.road.described.startswith("nothing is published: ") and words in stage.road.described
    assert len(Tracker.asked) == 1


def test_a_refused_frame_is_not_published_and_its_reason_is_told_after_a_while(stage):
    stage.step()
    Tracker.result, stage.frame = REFUSED, replace(LIVE, stamp_ns=LIVE.stamp_ns + 10**8)
    assert stage.step() == []
    assert stage.road.described == "published"
    stage.now_s += SILENT_S
    assert stage.road.described == f"nothing is published: {REFUSED.message}"


def test_the_rate_is_told(stage):
    for number in range(5):
        stage.frame = replace(LIVE, stamp_ns=number * 250_000_000)
        stage.step()
        stage.now_s += 0.25
    assert stage.road.described == "published 4.0 times a second"


def test_a_reset_while_a_frame_is_looked_at_takes_its_pose_away(stage, monkeypatch):
    def follow(*_):
        stage.active = None
        return RESULT

    monkeypatch.setattr(Tracker, "follow", follow)
    assert stage.step() == [] and stage.step() == []
    assert stage.road._why == NOT_CALIBRATED
    assert stage.taken == 1  # no images are taken without a calibration


def test_another_calibration_begins_another_road(stage):
    stage.step()
    better = replace(RESULT, message="better")
    stage.active = replace(stage.active, result=better)
    stage.frame = replace(LIVE, stamp_ns=LIVE.stamp_ns + 10**8)
    assert len(stage.step()) == 1
    assert Tracker.made == [(PAPER_RIG, RESULT), (PAPER_RIG, better)]


def test_what_the_watch_has_accepted_is_compared(stage):
    stage.step()
    stage.road.compare(REFUSED)
    stage.road.compare(RESULT)
    stage.frame = replace(LIVE, stamp_ns=LIVE.stamp_ns + 10**8)
    stage.step()
    assert [each.message for each in Tracker.told] == ["good"]


class Clocked:
    """The thread of the road, with time that passes only where it waits."""

    def __init__(self, stage, listeners):
        self.stage, self.delays_s = stage, []
        stage.publisher.get_subscription_count = lambda: listeners(stage.now_s)
        stage.road._stopped.wait = self.wait

    def wait(self, delay_s):
        self.delays_s.append(delay_s)
        self.stage.now_s += delay_s
        return self.stage.now_s > 102.0


@pytest.mark.parametrize("camera_hz", [5.0, 10.0, 30.0, 60.0])
def test_at_most_ten_poses_a_second_and_only_while_somebody_listens(stage, camera_hz):
    def take(timeout_s):
        stage.taken += 1
        stage.now_s += 1.0 / camera_hz
        return replace(LIVE, stamp_ns=round(stage.now_s * 1e9))

    stage.road._take = take
    Clocked(stage, lambda now_s: int(now_s >= 101.0))
    stage.road._run()
    sent = len(stage.publisher.sent)
    assert 0.9 * min(camera_hz, 10.0) <= sent <= 11
    assert stage.left == 1  # as somebody came
    stage.publisher.get_subscription_count = lambda: 0
    assert stage.road.described == "nobody listens"


def test_the_images_are_left_when_nobody_listens_any_more(stage):
    Clocked(stage, lambda now_s: int(now_s < 101.0))

    def take(timeout_s):
        stage.now_s += 0.1
        return replace(LIVE, stamp_ns=round(stage.now_s * 1e9))

    stage.road._take = take
    stage.road._run()
    assert stage.left == 2 and stage.now_s > 102.0
    stage.active = None
    stage.road.step()
    assert stage.left == 3


def test_what_fails_on_a_frame_is_told_and_the_next_ones_go_on(stage):
    def take(timeout_s):
        stage.now_s += 0.1
        return replace(LIVE, stamp_ns=round(stage.now_s * 1e9))

    stage.road._take = take
    Tracker.result = RuntimeError("broken")
    Clocked(stage, lambda now_s: 1)
    stage.road._run()
    assert len(stage.logged) > 5 and all("RuntimeError: broken" in text for text in stage.logged)
    assert stage.road.described == "nothing is published: internal error: RuntimeError: broken"


def test_the_thread_ends_while_it_waits():
    stage = Stage()
    del stage.road._stopped.wait
    stage.publisher.listeners = 0
    stage.road.start()
    ended = threading.Thread(target=stage.road.stop)
    ended.start()
    ended.join(10.0)
    assert not ended.is_alive()
