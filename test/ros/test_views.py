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

"""The streamed pictures: what is drawn when, and that nothing is drawn without subscribers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import CalibrationResult, rejected
from stereo_selfcal.pictures.canvas import GREEN, SKY_BLUE, VERMILION, YELLOW
from stereo_selfcal.pictures.verdict import StripContent
from stereo_selfcal.ros import views as views_module
from stereo_selfcal.ros.calibration_keeper import ActiveCalibration
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.live import LiveFrame, NoFrame
from stereo_selfcal.ros.record import FrameReport
from stereo_selfcal.ros.views import HOLD_S, PERIOD_S, Views
from stereo_selfcal.synth.scenes import PAPER_RIG, named_scene

CONFIG = NodeConfig.from_values({name: setting.default for name, setting in SETTINGS.items()})
FRAME = named_scene("straight_road").frame(0)
POSE = named_scene("straight_road").scene.extrinsics
RESULT = CalibrationResult("good", extrinsics=POSE, covariance=np.diag([1e-6, 1e-8, 1e-8]), n_frames=1)
REFUSED = rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines", 0, Bound.LEAST, 2, "", "look at the road"))
REPORT = FrameReport(FRAME.left, FRAME.right, PAPER_RIG, RESULT, 7, 0.05)
LIVE = LiveFrame(FRAME.left, FRAME.right, PAPER_RIG, "", 9)


class Publisher:
    def __init__(self):
        self.listeners, self.sent = 1, []

    def get_subscription_count(self):
        return self.listeners

    def publish(self, message):
        self.sent.append(message)


class Stage:
    """Views on a node of cardboard, whose time and frames are those that are set."""

    def __init__(self):
        self.publishers, self.now_s, self.frame, self.taken = {}, 100.0, LIVE, []
        self.active = None
        node = SimpleNamespace(
            create_publisher=lambda kind, topic, qos, **_: self.publishers.setdefault(topic, Publisher()),
            resolve_topic_name=lambda topic: topic,
            context=SimpleNamespace(ok=lambda: True),
            get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=11)),
        )
        self.views = Views(
            node, self.take, lambda: self.active, lambda: CONFIG, lambda: "zed", lambda: self.now_s
        )
        self.image, self.above = self.publishers["~/debug_image"], self.publishers["~/birds_eye"]

    def take(self, timeout_s):
        self.taken.append(timeout_s)
        return self.frame

    def bars(self):
        """Step once and return the colours of the verdicts of both pictures, None where there is none."""
        for publisher in (self.image, self.above):
            publisher.sent.clear()
        self.views.step()
        return [
            tuple(publisher.sent[-1].data[6:9]) if publisher.sent else None
            for publisher in (self.image, self.above)
        ]


@pytest.fixture
def stage():
    return Stage()


def test_nothing_is_done_while_nobody_looks(stage, monkeypatch):
    for name in ("draw_debug_image", "draw_fringes", "draw_notice", "find_stripe_points"):
        monkeypatch.setattr(views_module, name, lambda *_: pytest.fail("drawn for nobody"))
    stage.image.listeners = stage.above.listeners = 0
    stage.views.show(REPORT)
    assert stage.bars() == [None, None]
    assert stage.taken == [] and stage.views._last is None
    stage.image.listeners = stage.above.listeners = 1  # what nobody saw is not shown later
    stage.frame = None
    assert stage.bars() == [None, None]


@pytest.mark.parametrize("lonely", ["image", "above"])
def test_only_what_is_watched_is_drawn(stage, monkeypatch, lonely):
    other = {"image": "draw_fringes", "above": "draw_debug_image"}[lonely]
    getattr(stage, {"image": "above", "above": "image"}[lonely]).listeners = 0
    monkeypatch.setattr(views_module, other, lambda *_: pytest.fail("drawn for nobody"))
    stage.views.show(REPORT)
    assert sorted(stage.bars(), key=str) == sorted([GREEN, None], key=str)


def test_calibrated_frame_is_shown_for_a_while_then_the_current_one(stage):
    stage.views.show(REPORT)
    stage.active = ActiveCalibration(RESULT, PAPER_RIG, 100.0)
    assert stage.bars() == [GREEN, GREEN]
    assert stage.image.sent[-1].header.stamp.nanosec == 7
    stage.now_s += HOLD_S - 0.1
    assert stage.bars() == [None, None] and stage.taken == []
    stage.now_s += 0.2
    assert stage.bars() == [SKY_BLUE, SKY_BLUE]
    assert stage.taken == [PERIOD_S]
    assert stage.image.sent[-1].header.stamp.nanosec == 9
    assert stage.image.sent[-1].header.frame_id == "zed"


def test_refused_frame_is_shown_with_why(stage):
    stage.views.show(replace(REPORT, result=REFUSED))
    assert stage.bars() == [VERMILION, VERMILION]
    assert stage.above.sent[-1].height < stage.image.sent[-1].height  # a notice: there is no road to lay out


def test_only_the_last_of_many_frames_is_drawn(stage):
    for result in (REFUSED, REFUSED, RESULT):
        stage.views.show(replace(REPORT, result=result))
    assert stage.bars() == [GREEN, GREEN]
    assert len(stage.image.sent) == 1


@pytest.mark.parametrize(
    ("frame", "bar"),
    [
        (LIVE, YELLOW),
        (replace(LIVE, rig=None, problem="no CameraInfo"), VERMILION),
        (NoFrame("no pair in 1.0 s"), VERMILION),
        (replace(LIVE, left=np.zeros((1, 5000), np.uint8)), VERMILION),
        (replace(LIVE, left=np.zeros((2, 2), np.uint8), right=np.zeros((2, 2), np.uint8)), VERMILION),
        (None, None),
    ],
)
def test_what_there_is_before_the_first_calibration(stage, frame, bar):
    stage.frame = frame
    assert stage.bars() == [bar, bar]


@pytest.fixture
def notices(monkeypatch):
    """Keep what is said in each picture that is drawn."""
    said = []
    for name in ("draw_debug_image", "draw_fringes", "draw_notice"):
        draw = getattr(views_module, name)

        def keep(*arguments, draw=draw):
            said.extend(each for each in arguments if isinstance(each, StripContent))
            return draw(*arguments)

        monkeypatch.setattr(views_module, name, keep)
    return said


@pytest.mark.parametrize(
    ("since_s", "now_s", "age"),
    [(100.0, 100.0, "0 s"), (100.0, 412.9, "5 min 12 s"), (-90_000.0, 100.0, "1 d 1 h")],
)
def test_the_age_of_the_active_calibration_is_shown(stage, notices, since_s, now_s, age):
    stage.active = ActiveCalibration(RESULT, PAPER_RIG, since_s)
    stage.now_s = now_s
    stage.views.step()
    assert {notice.title for notice in notices} == {f"CALIBRATION IN FORCE, {age} old"}


def test_what_is_shown_of_another_camera_names_both_sizes(stage, notices):
    stage.active = ActiveCalibration(RESULT, replace(PAPER_RIG, width=320, height=300), 0.0)
    stage.views.step()
    words = "the images have 640 x 480 px, the calibration is for 320 x 300 px: calibrate again"
    assert {(notice.title, notice.lines) for notice in notices} == {("OTHER CAMERA", (words,))}


@pytest.mark.parametrize(
    ("height", "width", "drawn"),
    [(16, 16, True), (16, 128, True), (16, 129, False), (15, 16, False), (128, 16, True)],
)
def test_only_images_of_usual_shape_are_drawn(stage, notices, height, width, drawn):
    image = np.zeros((height, width), np.uint8)
    stage.frame = replace(LIVE, left=image, right=image, rig=None)
    stage.above.listeners = 0
    stage.views.step()
    titles = {notice.title for notice in notices}
    assert titles == {"NOT CALIBRATED" if drawn else "NO PICTURE"}


def test_other_camera_than_the_one_calibrated(stage):
    """The pose says nothing about images of another size."""
    stage.active = ActiveCalibration(RESULT, replace(PAPER_RIG, width=320), 0.0)
    assert stage.bars() == [VERMILION, VERMILION]


def test_calibration_that_became_wrong_shows(stage):
    """The active calibration is drawn over the current image, not the one that would be right for it."""

    def fringes(pose):
        stage.active = ActiveCalibration(replace(RESULT, extrinsics=pose), PAPER_RIG, 0.0)
        assert stage.bars() == [SKY_BLUE, SKY_BLUE]
        message = stage.above.sent[-1]
        picture = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3).astype(int)
        return (np.abs(picture[-380:, :, 2] - picture[-380:, :, 0]) > 40).mean()

    right = fringes(POSE)
    assert fringes(Extrinsics(POSE.height_m * 1.1, POSE.pitch_rad, POSE.roll_rad)) > right
    assert fringes(Extrinsics(POSE.height_m, POSE.pitch_rad + 0.02, POSE.roll_rad)) > right


class Waiting:
    """Stands in for the event that ends the drawing: it ends after three waits."""

    def __init__(self):
        self.delays = []

    def wait(self, delay_s):
        self.delays.append(delay_s)
        return len(self.delays) > 3

    def is_set(self):
        return False


def test_one_picture_a_period_even_if_one_fails(stage, monkeypatch):
    steps, errors = [], []
    stage.views._stopped = Waiting()
    stage.views._node.get_logger = lambda: SimpleNamespace(error=lambda text, **_: errors.append(text))

    def step():
        steps.append(True)
        if len(steps) == 2:
            raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(stage.views, "step", step)
    stage.views._run()
    assert stage.views._stopped.delays == [PERIOD_S] * 4
    assert len(steps) == 3
    assert len(errors) == 1 and "division by zero" in errors[0]
