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

"""The images between their arrival and whoever wants them; without ROS and without waiting."""

import threading
from types import SimpleNamespace

import pytest

from stereo_selfcal.core.camera.pairing import PairCounts, StampedPair
from stereo_selfcal.ros.config import SETTINGS, NodeConfig
from stereo_selfcal.ros.intake import ImageFormat, ImageIntake, IntakeWindow, PairQueue
from stereo_selfcal.ros.subscription_schedule import PROBE_S

CAMERA = (1, 1)


def config(**changes):
    return NodeConfig.from_values({**{name: s.default for name, s in SETTINGS.items()}, **changes})


def image(stamp_ms, width=640, encoding="mono8"):
    stamp = SimpleNamespace(sec=stamp_ms // 1000, nanosec=stamp_ms % 1000 * 10**6)
    header = SimpleNamespace(stamp=stamp, frame_id="left_optical")
    return SimpleNamespace(header=header, width=width, height=480, encoding=encoding, data=b"")


def pair(number):
    return StampedPair(number, number, number, number)


class Intake:
    """An intake whose time is set by the test."""

    def __init__(self, **changes):
        self.now_s = 100.0
        self.intake = ImageIntake(config(**changes), lambda: self.now_s)

    def send(self, *stamps_ms, late_ms=0):
        for stamp_ms in stamps_ms:
            self.intake.add("left", image(stamp_ms))
            self.intake.add("right", image(stamp_ms + late_ms))

    def tick(self):
        """Do what the node does once a second; return whether it is subscribed."""
        subscribed, take = self.intake.update_schedule(CAMERA)
        self.intake.open_or_close(take)
        return subscribed

    def finish_probe(self):
        """Have the probe of the start, to its end."""
        self.tick()
        self.send(0)
        self.now_s += PROBE_S
        self.tick()
        assert not self.intake.is_open


@pytest.fixture
def closed():
    made = Intake()
    made.finish_probe()
    return made


def test_queue_drops_the_oldest_pairs():
    queue = PairQueue()
    queue.resize(2)
    queue.put(map(pair, range(5)))
    assert [queue.get(0.0).left for _ in range(2)] == [3, 4]
    assert queue.get(0.0) is None


def test_queue_wakes_whoever_waits():
    queue, got = PairQueue(), []
    waiting = threading.Thread(target=lambda: got.append(queue.get(600.0)))
    waiting.start()
    queue.put([pair(7)])
    waiting.join(60.0)
    assert got == [pair(7)]


def test_closed_queue_hands_nothing_over():
    queue, got = PairQueue(), []
    waiting = threading.Thread(target=lambda: got.append(queue.get(600.0)))
    waiting.start()
    queue.close()
    waiting.join(60.0)
    assert got == [None]
    queue.put([pair(1)])
    assert queue.get(600.0) is None


def test_an_interrupted_queue_hands_nothing_over_until_it_is_cleared():
    queue, got = PairQueue(), []
    waiting = threading.Thread(target=lambda: got.append(queue.get(600.0)))
    waiting.start()
    queue.interrupt()
    waiting.join(60.0)
    assert got == [None]
    queue.put([pair(1)])
    assert queue.get(600.0) is None and not queue.closed
    queue.clear()
    queue.put([pair(2)])
    assert queue.get(600.0).left == 2


def test_pairs_are_kept_only_while_they_are_wanted(closed):
    intake = closed.intake
    closed.send(1000)
    intake.begin()
    assert intake.next_pair(0.0) is None, "it came before"
    closed.send(2000, 3000)
    assert intake.next_pair(0.0).stamp_ns == 2 * 10**9
    intake.end()
    assert intake.next_pair(0.0) is None
    closed.send(4000)
    assert intake.next_pair(0.0) is None


def test_a_pair_that_waits_for_a_nearer_partner_is_handed_over_when_none_comes():
    late = Intake(approximate_sync=True, approximate_sync_tolerance_seconds=0.01)
    late.intake.begin()
    late.send(1000, late_ms=5)
    assert late.intake.next_pair(0.0).right_stamp_ns == 1_005_000_000
    assert late.intake.state.nearest_s == 0.005
    late.intake.begin()
    assert late.intake.state.nearest_s is None


def test_begin_forgets_pairs_from_before():
    late = Intake(approximate_sync=True, approximate_sync_tolerance_seconds=0.01)
    late.tick()
    late.send(1000, late_ms=5)  # in the probe of the start; waits for a nearer partner
    late.intake.begin()
    assert late.intake.next_pair(0.0) is None
    late.send(2000)
    late.intake.begin()
    assert late.intake.next_pair(0.0) is None


def test_images_that_arrive_while_none_are_taken_open_no_window(closed):
    """They do where qos_overrides ask DDS to keep them all."""
    closed.intake.begin()
    closed.send(1000)
    assert not closed.intake.is_open


def test_window_begins_with_the_first_image(closed):
    intake = closed.intake
    before = intake.state.counts
    closed.now_s = 110.0
    intake.begin()
    assert not intake.is_open, "images that DDS has kept are dropped before"
    closed.tick()
    assert intake.window == IntakeWindow(before, 110.0)
    closed.now_s = 111.5
    closed.send(5000)
    assert intake.window.since_s == 111.5
    assert intake.window.counts.since(before) == PairCounts(left=1)
    window = intake.window
    closed.now_s = 112.0
    closed.send(5100)
    closed.tick()
    assert intake.window is window
    intake.end()
    assert intake.window is None and not intake.is_open


def test_end_leaves_a_probe_running():
    probing = Intake()
    assert probing.tick()
    probing.intake.begin()
    probing.send(0)
    probing.intake.end()
    assert probing.intake.is_open
    probing.now_s += PROBE_S
    probing.tick()
    assert not probing.intake.is_open


def test_images_are_not_taken_if_nobody_wants_them_any_more(closed):
    """The wish may end between the decision and the opening, as old images are dropped meanwhile."""
    closed.intake.begin()
    _, take = closed.intake.update_schedule(CAMERA)
    assert take
    closed.send(1000)
    closed.intake.end()
    closed.intake.open_or_close(take)
    assert not closed.intake.is_open


def test_images_that_wait_for_a_partner_are_forgotten_at_the_end(closed):
    closed.intake.begin()
    closed.tick()
    closed.intake.add("left", image(1000))
    closed.intake.end()
    closed.intake.begin()
    closed.intake.add("right", image(1000))
    assert closed.intake.next_pair(0.0) is None
    assert closed.intake.state.counts.dropped_left == 0


def test_queue_size_is_taken_over(closed):
    closed.intake.configure(config(queue_size=1))
    closed.intake.begin()
    closed.send(1000, 2000)
    assert closed.intake.next_pair(0.0).stamp_ns == 2 * 10**9
    assert closed.intake.next_pair(0.0) is None


def test_stop_ends_the_waiting(closed):
    closed.intake.begin()
    closed.send(1000)
    closed.intake.stop()
    assert closed.intake.stopped
    assert closed.intake.next_pair(600.0) is None


def test_formats():
    intake = Intake().intake
    intake.add("left", image(0))
    intake.add("right", image(0, encoding="x" * 1000))
    assert str(intake.formats["left"]) == "640 x 480 mono8"
    assert len(intake.formats["right"].encoding) == 80
    assert intake.formats["left"].frame_id == "left_optical"
    header = SimpleNamespace(frame_id="right_optical")
    compressed = ImageFormat.of(SimpleNamespace(header=header, format="jpeg", data=b""))
    assert (str(compressed), compressed.is_raw) == ("jpeg", False)
    assert compressed.frame_id == "right_optical"


def test_pairs_know_which_camera_repeats_its_last_image_even_across_pauses():
    intake = ImageIntake(config(), lambda: 100.0)

    def send(stamp_ms, left, right):
        for side, content in (("left", left), ("right", right)):
            message = image(stamp_ms)
            message.data = content
            intake.add(side, message)

    intake.begin()
    send(0, b"a", b"e")
    send(33, b"b", b"e")
    assert [intake.next_pair(0).frozen, intake.next_pair(0).frozen] == [None, ("right", 0)]
    intake.end()
    intake.begin()
    send(90_000, b"c", b"e")
    send(90_000, b"c", b"e")
    assert intake.next_pair(0).frozen == ("right", 0) and intake.next_pair(0) is None
    assert intake.state.counts.repeated_right == 1
