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

"""Whatever cameras and clients send, the node answers, sends only finite numbers, and keeps its log short."""

import array
import copy
import dataclasses
import math
from collections import deque

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from call_making import ANY_STD
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from node_in_process import NodeInProcess
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from ros_graph import RIG, SIDES, image_message, info_message, rendered
from sensor_msgs.msg import CompressedImage, Image

from stereo_selfcal import StereoRig
from stereo_selfcal.core.camera.image_messages import SUPPORTED_ENCODINGS
from stereo_selfcal.core.camera.pairing import PairCounts, StampedPair
from stereo_selfcal.files.node_settings import ALIGNMENT_RESULTS, all_settings
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.files.saved_result import RESULT_NAMES
from stereo_selfcal.ros import views
from stereo_selfcal.ros.calibration import CalibrationCall
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.pair_source import InputState, Topics

INT32, UINT32 = 2**31, 2**32
SECONDS = st.sampled_from([-INT32, -1, 0, 1, 1_700_000_000, INT32 - 1])
NANOSECONDS = st.sampled_from([0, 1, 999_999_999, 1_000_000_000, UINT32 - 1])
LONG_TEXT = "ümläut " * 3000  # texts in messages are of any length
LONGEST_ANSWER = 1000
NUMBERS = st.sampled_from(
    [0.0, -0.0, 1.0, -1.0, RIG.fx, RIG.cx, -RIG.fx * RIG.baseline_m, 1e-300, 1e300, math.nan, -math.inf]
)
CHANNELS = {"mono16": 2, "bgr8": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
CONFIG = NodeConfig.from_values({name: setting.default for name, setting in SETTINGS.items()})


def fuzz(examples):
    """Run so many examples, the same ones each time."""
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[
            Phase.explicit,
            Phase.generate,
        ],  # to shrink what takes a tenth of a second would take minutes
        report_multiple_bugs=False,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    path = tmp_path_factory.mktemp("node") / "out.yaml"
    with (
        pytest.MonkeyPatch.context() as patch,
        NodeInProcess(output_path=str(path), monitor_period_s=0.05) as node,
    ):
        patch.setattr(views, "PERIOD_S", 0.05)  # a picture waits no longer for a frame than a call does
        node.path = path
        yield node


def stamped(message, second, nanosecond):
    message = copy.copy(message)
    message.header = copy.deepcopy(message.header)
    message.header.stamp.sec, message.header.stamp.nanosec = second, nanosecond
    return message


@st.composite
def images(draw):
    """Draw an Image with one fault, or none."""
    encoding = draw(st.sampled_from(SUPPORTED_ENCODINGS))
    height, width = draw(st.sampled_from([1, 2, 3, 5, 48, 101])), draw(st.sampled_from([1, 2, 3, 7, 64]))
    padding = draw(st.sampled_from([0, 0, 1, 3]))
    step = width * CHANNELS.get(encoding, 1) + padding
    pixels = draw(st.sampled_from([0, 1, 127, 255]))
    message = Image(height=height, width=width, encoding=encoding, step=step)
    message.is_bigendian = draw(st.sampled_from([0, 1, 255]))
    message.data = array.array("B", bytes([pixels])) * (step * height)
    fault = draw(st.sampled_from(["none", "none", "step", "size", "data", "encoding"]))
    if fault == "step":
        message.step = draw(st.sampled_from([0, 1, step - padding - 1, step + 1, UINT32 - 1]))
    if fault == "size":
        name = draw(st.sampled_from(["height", "width"]))
        setattr(message, name, draw(st.sampled_from([0, getattr(message, name) + 1, UINT32 - 1])))
    if fault == "data":
        message.data = message.data[: draw(st.sampled_from([0, 1, len(message.data) - 1]))]
    if fault == "encoding":
        message.encoding = draw(st.sampled_from(["", "yuv422", "32FC1", "MONO8", "\0", LONG_TEXT]))
    return message


@st.composite
def compressed_images(draw):
    """Draw a compressed image that was cut, garbled, or is none at all."""
    shape = draw(st.sampled_from([(1, 1), (2, 7), (48, 64)]))
    kind = draw(st.sampled_from([".png", ".jpg"]))
    data = bytearray(cv2.imencode(kind, np.full(shape, 90, np.uint8))[1].tobytes())
    for _ in range(draw(st.integers(0, 3))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    data = draw(st.sampled_from([data, data[: len(data) // 2], b"", b"\xff\xd8\xff", draw(st.binary())]))
    image_format = draw(st.sampled_from(["jpeg", "", "mono8; png compressed ", "bayer_rggb8", LONG_TEXT]))
    return CompressedImage(format=image_format, data=array.array("B", bytes(data)))


@st.composite
def streams(draw, kinds):
    """Draw pairs of messages whose stamps fit more often than not: [(left, right), ...]."""
    pairs = []
    for left, right, same in draw(st.lists(st.tuples(kinds, kinds, st.booleans()), min_size=1, max_size=4)):
        stamp = draw(SECONDS), draw(NANOSECONDS)
        other = draw(st.sampled_from([stamp, stamp, stamp, (draw(SECONDS), draw(NANOSECONDS))]))
        pairs.append((stamped(left, *stamp), stamped(left if same else right, *other)))
    return pairs


@st.composite
def infos(draw, side, rig=RIG):
    """Draw a CameraInfo that is right but for some fields."""
    message = info_message(side, rig)
    for name in draw(st.lists(st.sampled_from(["k", "r", "p"]), max_size=2)):
        values = list(getattr(message, name))
        values[draw(st.integers(0, len(values) - 1))] = draw(NUMBERS)
        setattr(message, name, values)
    if draw(st.booleans()):
        message.d = draw(st.lists(NUMBERS, max_size=14))
        models = ["", "plumb_bob", "rational_polynomial", "equidistant", "fisheye", LONG_TEXT]
        message.distortion_model = draw(st.sampled_from(models))
    if draw(st.integers(0, 4)) == 0:
        message.width, message.height = draw(
            st.sampled_from([(0, 0), (RIG.width, 1), (UINT32 - 1, UINT32 - 1), (64, 48)])
        )
    return message


def info_topics(left=None, right=None):
    return list(
        zip(
            ("/left/camera_info", "/right/camera_info"),
            (left or info_message("left"), right or info_message("right")),
            strict=True,
        )
    )


def image_topics(pairs, suffix=""):
    return [
        (f"/{side}/image_rect{suffix}", image)
        for pair in pairs
        for side, image in zip(SIDES, pair, strict=True)
    ]


def good_frame(second=5, nanosecond=0):
    return [[stamped(GOOD[side], second, nanosecond) for side in SIDES]]


GOOD = {side: image_message(pixels) for side, pixels in zip(SIDES, rendered(), strict=True)}


class Source:
    """What a call takes its frames from, without the waiting."""

    topics = Topics("/left/image_rect", "/right/image_rect", "/left/camera_info", "/right/camera_info")
    stopped = False

    def __init__(self, pairs, camera_infos):
        self.pairs, self.camera_infos = deque(pairs), camera_infos
        self.state = InputState(PairCounts(), None)

    def camera_infos_of(self, _pair):
        return self.camera_infos

    def publishers(self, topic):
        return 1

    def next_pair(self, timeout_s):
        if not self.pairs:
            return None
        left, right = self.pairs.popleft()
        return StampedPair(left, right, left.header.stamp.sec, right.header.stamp.sec)


@st.composite
def cameras(draw):
    """Draw the CameraInfo of both sides, of a rig whose images are among those that are drawn."""
    rig = StereoRig(64, 48, 50.0, 50.0, 31.5, 23.5, 0.15)
    return draw(infos("left", rig)), draw(infos("right", rig))


@fuzz(150)
@given(streams(images() | compressed_images()), cameras(), st.booleans())
def test_a_call_answers_whatever_its_frames_are(pairs, camera_infos, rectified):
    config = dataclasses.replace(CONFIG, rectified=rectified)
    outcome = CalibrationCall(Source(pairs, camera_infos), config).run()
    assert outcome.result is None
    assert 0 < len(outcome.message) < LONGEST_ANSWER


@fuzz(25)
@example([(Image(encoding=LONG_TEXT), Image(encoding=LONG_TEXT))])
@given(streams(images()))
def test_images(node, pairs):
    messages = [*info_topics(), *image_topics(pairs)]
    answer = node.calibrate(messages)
    assert not answer.success and len(answer.message) < LONGEST_ANSWER
    node.draw(messages)
    node.report()
    node.check()


@fuzz(12)
@given(infos("left"), infos("right"))
def test_camera_infos(node, left, right):
    messages = [*info_topics(left, right), *image_topics(good_frame())]
    assert len(node.calibrate(messages).message) < LONGEST_ANSWER
    node.draw(messages)
    node.report()
    node.check()


@fuzz(6)
@example(INT32 - 1, UINT32 - 1)
@example(-INT32, 0)
@given(SECONDS, NANOSECONDS)
def test_stamps_of_good_frames(node, second, nanosecond):
    node.path.unlink(missing_ok=True)
    answer = node.calibrate([*info_topics(), *image_topics(good_frame(second, nanosecond))])
    assert answer.success, answer.message
    if abs(second) < INT32 - 1 or f"saved to {node.path}" in answer.message:
        load_result(node.path)  # what is written can be read
    else:
        assert "in effect, but not saved: " in answer.message
    node.check()


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.sampled_from(["", " ", "~", "~nobody_of_this_name/x", "/", "a\0b", "urdf,", "raw", "ü" * 200]),
    st.lists(st.floats(), max_size=3),
    st.lists(st.text(max_size=3), max_size=3),
)
NAMES = st.sampled_from(
    [setting.name for setting in all_settings()]
    + [f"extrinsics.{name}" for name in RESULT_NAMES]
    + list(ALIGNMENT_RESULTS)
    + ["", "no.such.parameter", "use_sim_time", "qos_overrides./left/image_rect.subscription.depth"]
)


@fuzz(300)
@given(st.lists(st.tuples(NAMES, VALUES), min_size=1, max_size=4), st.booleans())
def test_parameters(node, wanted, at_once):
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in wanted]
    if at_once:
        request, kind = SetParametersAtomically.Request(parameters=parameters), SetParametersAtomically
        results = [node.serve("set_parameters_atomically", request, kind.Response()).result]
    else:
        request, kind = SetParameters.Request(parameters=parameters), SetParameters
        results = node.serve("set_parameters", request, kind.Response()).results
    assert all(result.successful or result.reason for result in results)
    values = {name: node.node.get_parameter(name).value for name in SETTINGS}
    NodeConfig.from_values(values)
    assert all(math.isfinite(value) for value in values.values() if isinstance(value, int | float))
    node.check()


def test_it_calibrates_after_all_that(node):
    defaults = [
        Parameter(name, value=setting.default) for name, setting in SETTINGS.items() if not setting.fixed
    ]
    assert node.node.set_parameters_atomically(
        [
            *(p for p in defaults if p.name not in ("output_path", "timeout_s", *ANY_STD)),
            Parameter("timeout_s", value=60.0),
            *(Parameter(name, value=value) for name, value in ANY_STD.items()),
        ]
    ).successful
    assert node.calibrate([*info_topics(), *image_topics(good_frame())]).success
