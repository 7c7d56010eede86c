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

"""What runs when a signal shuts ROS down: it ends without a word, whatever it asks of rclpy after that."""

import gc
import threading
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

import rclpy
import ros_graph
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from stereo_selfcal.core.faults import Fault
from stereo_selfcal.ros import node as node_program
from stereo_selfcal.ros.demo import packaged_bag
from stereo_selfcal.ros.live import missing_info
from stereo_selfcal.ros.player import BagPlayer
from stereo_selfcal.ros.record import failed_frame
from stereo_selfcal.ros.selfcal import SelfcalNode
from stereo_selfcal.ros.shutdown import silent_after_shutdown

# pytest keeps for itself what Python would print of an error in a thread or in __del__.
pytestmark = [
    pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning"),
    pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture
def selfcal():
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    values = {"output_path": "", "timeout_s": 0.1, "monitor_period_s": 0.0}.items()
    selfcal = SelfcalNode(parameter_overrides=[Parameter(name, value=value) for name, value in values])
    yield selfcal
    selfcal.stop()
    selfcal.node.destroy_node()  # once more does no harm
    rclpy.try_shutdown()


def call(selfcal):
    service = next(s for s in selfcal.node.services if s.srv_name.endswith("/calibrate"))
    return service.callback(Trigger.Request(), Trigger.Response())


def report(selfcal):
    for timer in selfcal.node.timers:
        timer.callback()


def count(selfcal):
    """Ask rcl itself, as any callback of rclpy's own may do."""
    selfcal.node.count_publishers("/left/image_rect")


def subscribe(selfcal):
    selfcal._input._subscriptions.switch(images=True, infos=(True, True))


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("work", [report, call, count, subscribe])
def test_a_callback_that_outlives_ros_says_nothing(selfcal, capfd, monkeypatch, work, late):
    """rclpy prints the error of a callback that nobody has waited for."""
    stopped, done = threading.Event(), threading.Event()

    def callback():
        rclpy.shutdown()
        assert not late or stopped.wait(ros_graph.PATIENCE_S)
        done.set()
        work(selfcal)

    stop = selfcal.stop
    monkeypatch.setattr(selfcal, "stop", lambda: (stop(), stopped.set()))
    capfd.readouterr()  # of the start
    guard = selfcal.node.create_guard_condition(callback)
    guard.trigger()
    node_program._serve(selfcal)
    del guard
    gc.collect()
    assert done.is_set()
    printed = capfd.readouterr()
    interrupted = "interrupted: the node shuts down"  # the answer of a call is always logged
    lines = [line for line in (printed.out + printed.err).splitlines() if interrupted not in line]
    assert lines == []


def test_the_graph_that_nobody_can_ask_any_more_has_no_publishers(selfcal):
    """Else a frame that is read at that moment would be told as a fault of the program, with a traceback."""
    source = selfcal._input
    source.begin()
    rclpy.shutdown()
    assert source.publishers(source.topics.left) == 0
    assert (source.state.mismatches, source.state.info_mismatches) == ((), ())
    assert missing_info(source).startswith("no CameraInfo on /left/camera_info (publishers: 0)")


def test_a_frame_that_was_calibrated_at_that_moment_is_no_fault(selfcal, capfd):
    """The thread of the call asks whether somebody looks at the picture, and logs what has failed."""
    rclpy.shutdown()
    capfd.readouterr()
    error = RuntimeError("publisher's context is invalid")
    selfcal._on_frame(failed_frame(Fault.of(error), 5))
    selfcal._on_watched(failed_frame(Fault.of(error), 6))
    assert capfd.readouterr() == ("", "")
    assert selfcal._record.statistics.total == 2


def test_a_signal_before_there_is_an_executor_ends_the_node(selfcal, capfd):
    rclpy.shutdown()
    capfd.readouterr()
    node_program._serve(selfcal)
    gc.collect()
    assert capfd.readouterr() == ("", "")


def test_a_player_that_outlives_ros_says_nothing(selfcal, capfd, monkeypatch):
    player = BagPlayer(selfcal.node, packaged_bag())
    failed = threading.Event()

    def play_once():
        rclpy.try_shutdown()
        failed.set()
        BagPlayer.play_once(player)

    monkeypatch.setattr(player, "play_once", play_once)
    capfd.readouterr()
    player.start()
    assert failed.wait(ros_graph.PATIENCE_S)
    player._thread.join(ros_graph.PATIENCE_S)
    assert not player._thread.is_alive()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("alive", [True, False])
def test_errors_are_dropped_after_the_shutdown_only(alive):
    context = SimpleNamespace(ok=lambda: alive)
    with pytest.raises(ZeroDivisionError) if alive else nullcontext(), silent_after_shutdown(context):
        raise ZeroDivisionError
