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

"""Single frames between calls: a call always goes first, and there is a reason when there is no frame."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_graph import image_message, info_message

from stereo_selfcal import RigError
from stereo_selfcal.core.camera.frozen import FrozenImage
from stereo_selfcal.core.camera.pairing import PairCounts, StampedPair
from stereo_selfcal.core.rejection import RejectReason
from stereo_selfcal.ros import live as live_module
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.live import LiveFrame, LiveFrames, NoFrame, known_rig, missing_info
from stereo_selfcal.ros.monitor import Monitor
from stereo_selfcal.ros.pair_source import InputState, Topics
from stereo_selfcal.synth.scenes import PAPER_RIG

CONFIG = NodeConfig.from_values({name: setting.default for name, setting in SETTINGS.items()})
PIXELS = np.arange(480 * 640, dtype=np.uint8).reshape(480, 640)


class Input:
    """An input whose next pairs are those of the list; counts how often it was begun and ended."""

    topics = Topics("/left", "/right", "/left_info", "/right_info")

    def __init__(self, *pairs, infos=None):
        self.pairs, self.stopped, self.begun, self.ended = list(pairs), False, 0, 0
        self.timeouts_s = []
        self.camera_infos = (info_message("left"), info_message("right")) if infos is None else infos
        self.waiting = threading.Event()
        self.state = InputState(PairCounts(), None)

    def camera_infos_of(self, _pair):
        return self.camera_infos

    def publishers(self, topic):
        return 0

    def begin(self):
        self.begun += 1

    def end(self):
        self.ended += 1

    def next_pair(self, timeout_s):
        self.waiting.set()
        self.timeouts_s.append(timeout_s)
        return self.pairs.pop(0) if self.pairs else None


def pair(pixels=PIXELS, encoding="mono8"):
    message = image_message(pixels, encoding)
    return StampedPair(message, message, 5, 5)


def live(source):
    return LiveFrames(source, lambda: CONFIG)


def test_frame_comes_with_its_rig():
    source = Input(pair())
    frame = live(source).one(1.0)
    assert isinstance(frame, LiveFrame)
    np.testing.assert_array_equal(frame.left, PIXELS)
    assert (frame.rig, frame.problem, frame.stamp_ns) == (PAPER_RIG, "", 5)
    assert (source.begun, source.ended) == (1, 1)


def test_silence_has_a_reason():
    source = Input()
    frame = live(source).one(0.0)
    assert isinstance(frame, NoFrame)
    assert "nothing arrives on /left (0 publishers) and /right (0 publishers)" in frame.reason
    assert source.ended == 1


def test_waiting_for_a_frame_is_cut_in_slices(monkeypatch):
    """A call takes over between two of them."""
    source, times_s = Input(), iter(np.arange(0.0, 100.0, 0.25))
    monkeypatch.setattr(live_module.time, "monotonic", lambda: next(times_s))
    assert isinstance(live(source).one(1.0), NoFrame)
    assert len(source.timeouts_s) == 4
    assert 0.0 < max(source.timeouts_s) <= 0.1


def test_no_time_at_all_is_no_division_by_zero(monkeypatch):
    monkeypatch.setattr(live_module.time, "monotonic", lambda: 100.0)
    assert live(Input()).one(0.0).reason.startswith("no pair in 0.0 s: left 0.0 Hz")


def test_image_that_cannot_be_read_is_named():
    frame = live(Input(pair(encoding="yuv422"))).one(1.0)
    assert frame.reason.startswith("/left: image encoding 'yuv422' is not supported")


@pytest.mark.parametrize(
    ("infos", "words"),
    [
        ((None, None), "no CameraInfo on /left_info (publishers: 0) and /right_info (publishers: 0)"),
        ((SimpleNamespace(width=4, height=3, k=[0.0] * 9, p=[0.0] * 12),) * 2, "K[0] = 0"),
    ],
)
def test_frame_without_a_rig_says_why(infos, words):
    frame = live(Input(pair(), infos=infos)).one(1.0)
    assert frame.rig is None and words in frame.problem


def test_call_has_the_input_alone():
    source = Input(pair())
    frames = live(source)
    with frames.all():
        assert frames.one(1.0) is None
        assert (source.begun, source.ended, len(source.pairs)) == (1, 0, 1)
    assert isinstance(frames.one(1.0), LiveFrame)


def test_call_takes_over_from_whoever_waits():
    """Though that one may wait for minutes."""
    source, got = Input(), []
    frames = live(source)
    looker = threading.Thread(target=lambda: got.append(frames.one(600.0)))
    looker.start()
    source.waiting.wait()
    with frames.all():
        looker.join(60.0)
        assert got == [None]
        assert (source.begun, source.ended) == (2, 1)


def test_users_who_wait_at_the_same_time_get_the_same_frame():
    """The watch, the road and the pictures: none of them keeps the others from the images."""
    source, got = Input(), []
    frames = live(source)
    arrived = threading.Event()

    def next_pair(timeout_s):
        source.waiting.set()
        return source.pairs.pop() if arrived.wait(timeout_s) and source.pairs else None

    source.next_pair, source.pairs = next_pair, [pair()]
    lookers = [threading.Thread(target=lambda: got.append(frames.one(60.0))) for _ in range(3)]
    lookers[0].start()
    source.waiting.wait()
    for looker in lookers[1:]:
        looker.start()
    until_waiting(frames, 2)
    arrived.set()
    for looker in lookers:
        looker.join(60.0)
    assert len(got) == 3 and isinstance(got[0], LiveFrame)
    assert got[1] is got[0] and got[2] is got[0]
    assert (source.begun, source.ended) == (1, 1)


def test_a_user_of_more_patience_goes_on_where_another_one_has_given_up(monkeypatch):
    source, got = Input(), []
    frames = live(source)
    impatient = threading.Event()

    def next_pair(timeout_s):
        source.waiting.set()
        impatient.wait(60.0)
        return source.pairs.pop() if source.begun == 2 and source.pairs else None

    source.next_pair, source.pairs = next_pair, [pair()]
    first = threading.Thread(target=lambda: got.append(("first", frames.one(0.0))))
    first.start()
    source.waiting.wait()
    second = threading.Thread(target=lambda: got.append(("second", frames.one(600.0))))
    second.start()
    until_waiting(frames, 1)
    impatient.set()
    for looker in (first, second):
        looker.join(60.0)
    found = dict(got)
    assert isinstance(found["first"], NoFrame) and isinstance(found["second"], LiveFrame)
    assert (source.begun, source.ended) == (2, 2)


def test_a_call_takes_over_from_all_who_wait():
    source, got = Input(), []
    frames = live(source)
    lookers = [threading.Thread(target=lambda: got.append(frames.one(600.0))) for _ in range(2)]
    for looker in lookers:
        looker.start()
    source.waiting.wait()
    until_waiting(frames, 1)
    with frames.all():
        for looker in lookers:
            looker.join(60.0)
        assert got == [None, None]


def test_the_input_goes_on_between_frames_for_who_takes_one_after_the_other():
    source = Input(pair(), pair())
    frames = live(source)
    frames._newest_pair = lambda: source.next_pair(0.0)
    assert isinstance(frames.next(1.0), LiveFrame) and isinstance(frames.next(1.0), LiveFrame)
    assert isinstance(frames.next(0.0), NoFrame)
    assert (source.begun, source.ended) == (1, 0)
    frames.close()
    frames.close()
    assert (source.begun, source.ended) == (1, 1)
    with frames.all():
        assert frames.next(1.0) is None
    assert (source.begun, source.ended) == (2, 2)
    frames.close()
    assert source.ended == 2


def test_who_takes_one_after_the_other_shares_the_next_one():
    """The watch takes no frame away from the road."""
    source, got = Input(pair()), []
    frames = live(source)
    frames.next(1.0)
    watch = threading.Thread(target=lambda: got.append(frames.one(600.0)))
    watch.start()
    until_waiting(frames, 1)
    source.pairs = [pair()]
    shared = frames.next(1.0)
    watch.join(60.0)
    assert got == [shared] and isinstance(shared, LiveFrame)
    assert (source.begun, source.ended) == (1, 0)


def test_a_shutdown_ends_the_waiting_for_another_one_s_frame():
    source, got = Input(pair()), []
    frames = live(source)
    frames.next(1.0)
    watch = threading.Thread(target=lambda: got.append(frames.one(600.0)))
    watch.start()
    until_waiting(frames, 1)
    source.stopped = True
    watch.join(60.0)
    assert got == [None]


@pytest.mark.parametrize("by_call", [False, True])
def test_who_waits_for_another_one_s_frame_is_not_left_alone(by_call):
    source, got = Input(pair()), []
    frames = live(source)
    frames.next(1.0)
    watch = threading.Thread(target=lambda: got.append(frames.one(600.0)))
    watch.start()
    until_waiting(frames, 1)
    source.pairs = [pair()]
    if by_call:
        with frames.all():
            watch.join(60.0)
        assert got == [None]
    else:
        frames.close()
        watch.join(60.0)
        assert isinstance(got[0], LiveFrame)
    assert source.begun == source.ended == 2


def test_of_several_frames_that_have_come_the_newest_is_taken():
    source = Input(pair(), replace(pair(), left_stamp_ns=7, right_stamp_ns=7))
    assert live(source).next(1.0).stamp_ns == 7
    assert source.pairs == []


def until_waiting(frames, number):
    """Wait until so many users share the wait of another one."""
    while frames._wait is None:
        threading.Event().wait(0.001)
    waits = frames._wait.over
    while len(waits._cond._waiters) < number:
        threading.Event().wait(0.001)


def test_call_that_fails_gives_the_input_back():
    source = Input(pair())
    frames = live(source)
    with pytest.raises(ZeroDivisionError), frames.all():
        raise ZeroDivisionError
    assert isinstance(frames.one(1.0), LiveFrame)


def test_shutdown_ends_the_waiting():
    source = Input()
    source.stopped = True
    assert live(source).one(600.0) is None


def test_known_rig():
    assert known_rig(Input(infos=(None, info_message("right"))), CONFIG) is None
    with pytest.raises(RigError, match="baseline of zero"):
        known_rig(Input(infos=(info_message("left"),) * 2), CONFIG)
    assert missing_info(Input()) == ""


def test_a_fault_while_a_frame_is_read_is_a_reason_with_its_traceback(monkeypatch):
    def fail(message, rig_size):
        raise IndexError("a bug")

    monkeypatch.setattr(live_module, "message_to_grey", fail)
    frame = live(Input(pair())).one(1.0)
    assert isinstance(frame, NoFrame)
    assert "IndexError: a bug (test_live.py, line" in frame.reason
    assert "Traceback" in frame.fault.trace
    assert frame.stamp_ns == 5


def test_a_frame_with_a_repeated_image_is_shown_and_not_calibrated():
    """The watch reports why."""
    seen = np.tile(np.arange(PIXELS.shape[1], dtype=np.uint8), (PIXELS.shape[0], 1))
    stale = replace(pair(seen), frozen=FrozenImage("right", 4))
    frame = live(Input(stale)).one(1.0)
    assert frame.refusal.reason is RejectReason.IMAGE_FROZEN and frame.left.shape == PIXELS.shape
    reports = []
    config = SimpleNamespace(monitor_period_s=1.0)
    Monitor(lambda _: frame, lambda: config, lambda: True, reports.append, lambda: True, None).step()
    assert [report.result.reason for report in reports] == [RejectReason.IMAGE_FROZEN]
    assert reports[0].rig == PAPER_RIG and reports[0].stamp_ns == 5
