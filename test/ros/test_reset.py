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

"""~/reset: the active calibration is gone, now and at the next start, and a running call ends; no graph."""

import threading

import pytest

pytest.importorskip("rclpy")

import numpy as np
from call_making import scripted_calls
from improving_calibrator import reached_by, use_improving
from node_in_process import NodeInProcess
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from result_making import EXTRINSICS, RIG, a_result, write
from ros_graph import NAME, RESULTS, blank, image_message, info_message, wait_until
from std_srvs.srv import Trigger

from stereo_selfcal.core.drive.states import State
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.ros import activation as activation_module
from stereo_selfcal.ros import calibration
from stereo_selfcal.ros import selfcal as selfcal_module
from stereo_selfcal.ros.calibration import RESET, CallOutcome
from stereo_selfcal.ros.record import FrameReport

SOURCE = "/left/image_rect /right/image_rect"
GOOD = CallOutcome("calibrated", a_result(), RIG, 5)
DARK = (np.full((480, 640), 10, np.uint8),) * 2


@pytest.fixture
def start():
    """Start the node in this process; the one before is ended."""
    nodes = []

    def end():
        while nodes:
            nodes[-1].check()
            nodes.pop().__exit__()

    def start(**parameters):
        end()
        nodes.append(NodeInProcess(**parameters).__enter__())
        return nodes[-1]

    yield start
    end()


def set_parameter(node, name, value):
    (outcome,) = node.node.set_parameters([Parameter(name, value=value)])
    assert outcome.successful


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, source=SOURCE)
    return path


def reset(node):
    return node.serve("reset", Trigger.Request(), Trigger.Response())


def results_of(node):
    return [node.node.get_parameter(name).value for name in RESULTS]


def state_of(node):
    return node.selfcal._keeper.state


def diagnostics(node):
    """Return the sentence and the values of the calibration in /diagnostics."""
    node.report()
    message = [each for topic, each in node.sent if topic == "/diagnostics"][-1]
    (status,) = [each for each in message.status if each.name.endswith("calibration")]
    return status.message, {pair.key: pair.value for pair in status.values}


def frames(pixels=None):
    """Return a function of the number of a round that returns its messages."""
    infos = [(f"/{side}/camera_info", info_message(side)) for side in ("left", "right")]

    def messages(number):
        pair = []
        for side, image in zip(("left", "right"), pixels or blank(), strict=True):
            message = image_message(image)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(number * 10**8, 10**9)
            pair.append((f"/{side}/image_rect", message))
        return [*infos, *pair]

    return messages


def asking(targets):
    names = ("height_std_m", "pitch_std_rad", "roll_std_rad")
    return {f"target_{n}": float(v) for n, v in zip(names, targets.std.as_array(), strict=True)}


def test_nothing_to_take_back_is_a_success_and_said(start):
    node = start()
    answer = reset(node)
    assert (answer.success, answer.message) == (True, "there was no active calibration")
    assert state_of(node) is State.UNCALIBRATED
    assert not [topic for topic, _ in node.sent if topic == f"{NAME}/extrinsics"]


def test_the_calibration_is_gone_now_and_at_the_next_start(start, saved):
    node = start(output_path=str(saved))
    assert results_of(node)[:3] == list(EXTRINSICS.as_array())
    answer = reset(node)
    assert answer.success
    assert answer.message == f"the calibration is taken back; its file is kept as {saved}.rejected"
    assert results_of(node) == [None] * 6
    event = [message for topic, message in node.sent if topic == f"{NAME}/extrinsics"][-1]
    assert isinstance(event, ParameterEvent)
    assert {p.name for p in event.deleted_parameters} >= set(RESULTS)
    text, values = diagnostics(node)
    assert text.startswith("uncalibrated: taken back by ~/reset; call ~/calibrate")
    assert values["state"] == "uncalibrated" and "height_m" not in values
    assert any(line.startswith("~/reset: the calibration is taken back") for line in node.logged)
    assert reset(node).message == "there was no active calibration"
    again = start(output_path=str(saved))
    assert results_of(again) == [None] * 6
    assert not saved.exists() and saved.with_name("out.yaml.rejected").exists()


def test_the_file_of_a_calibration_is_kept_aside_wherever_it_was_saved(start, tmp_path, monkeypatch):
    monkeypatch.setattr(selfcal_module, "CalibrationCall", scripted_calls(lambda: GOOD))
    node = start(output_path=str(tmp_path / "a.yaml"))
    assert node.calibrate().success
    set_parameter(node, "output_path", "")
    assert reset(node).message.endswith(f"its file is kept as {tmp_path / 'a.yaml'}.rejected")
    assert node.calibrate().message.endswith("; not saved, as output_path is empty")


def test_a_file_that_cannot_be_kept_aside_is_no_success_though_it_is_taken_back(start, saved, monkeypatch):
    node = start(output_path=str(saved))
    monkeypatch.setattr(activation_module, "keep_aside", lambda *_, **__: ("it stays", True))
    answer = reset(node)
    assert (answer.success, answer.message) == (False, "the calibration is taken back; it stays")
    assert results_of(node) == [None] * 6
    monkeypatch.undo()
    assert reset(node).message.endswith(f"; its file is kept as {saved}.rejected"), (
        "the second time it can be"
    )


def test_a_running_call_ends_with_an_answer_of_its_own(start, monkeypatch, saved):
    use_improving(monkeypatch, calibration)
    node = start(output_path=str(saved), timeout_s=60.0, **asking(reached_by(10_000)))
    answers, told = [], []

    def messages(number):
        if node.calibrated_frames >= 3 and not answers:
            told.append(diagnostics(node))
            answers.append(reset(node))
        return frames()(number)

    call = node.calibrate(messages)
    assert (call.success, call.message) == (False, RESET)
    assert answers[0].success
    assert answers[0].message.startswith("the running call is ended; the calibration is taken back; its file")
    assert (state_of(node), results_of(node)) == (State.UNCALIBRATED, [None] * 6)
    text, values = told[0]
    assert text.startswith("calibrating: ") and "; asked 20 mm, " in text
    assert "; active meanwhile: height 0.3333 m" in text
    assert int(values["call_frames_accepted"]) >= 3 and float(values["call_pitch_std_rad"]) > 1e-4
    assert values["call"] in text
    assert "call" not in diagnostics(node)[1]


def test_a_call_that_waits_for_a_camera_ends_at_once(start):
    node = start(timeout_s=3000.0)
    answers = []

    def messages(number):
        if number == 3:
            answers.append(reset(node))
        return []

    assert node.calibrate(messages).message == RESET
    assert answers[0].message == "the running call is ended; there was no active calibration"
    assert len([line for line in node.logged if " frames in " in line]) == 0


def test_a_result_that_is_found_when_the_reset_comes_is_not_put_in_force(start, monkeypatch):
    def found():
        answer = reset(node)
        assert answer.success
        return GOOD

    monkeypatch.setattr(selfcal_module, "CalibrationCall", scripted_calls(found))
    node = start()
    answer = node.calibrate()
    assert (answer.success, answer.message) == (False, RESET)
    assert results_of(node) == [None] * 6 and state_of(node) is State.UNCALIBRATED


def test_a_mean_that_the_watch_found_before_is_not_put_in_force(start, monkeypatch):
    node = start(on_drift="recalibrate")
    keeper = node.selfcal._keeper
    monkeypatch.setattr(keeper, "proposal", lambda _: reset(node) and a_result())
    node.selfcal._on_watched(FrameReport(None, None, RIG, a_result(), 5, 0.1))
    assert results_of(node) == [None] * 6 and keeper.active is None
    monkeypatch.setattr(keeper, "proposal", lambda _: a_result())
    node.selfcal._on_watched(FrameReport(None, None, RIG, a_result(), 5, 0.1))
    assert results_of(node)[:3] == list(EXTRINSICS.as_array())


def test_what_misses_its_targets_is_put_in_force_where_there_is_nothing_better(start, monkeypatch):
    use_improving(monkeypatch, calibration)
    node = start(timeout_s=1.0, **asking(reached_by(10_000)))

    def calibrate(n_frames):
        """Call with so many frames, or a few more that are on their way."""
        before = node.calibrated_frames
        return node.calibrate(lambda i: frames()(i) if node.calibrated_frames < before + n_frames else [])

    first = calibrate(8)
    assert first.success
    assert "; targets not reached with " in first.message and "is motion of the car" in first.message
    assert "; activated all the same, as there was none; " in first.message
    before = results_of(node)
    second = calibrate(1)
    assert not second.success
    assert second.message.startswith("not activated, as the active one is no less certain (std ")
    assert results_of(node) == before and state_of(node) is State.CALIBRATED
    third = calibrate(25)
    assert third.success and "; activated all the same, as the one before is less certain" in third.message
    assert results_of(node)[3] < before[3]
    set_parameter(node, "timeout_s", 0.3)
    dark = node.calibrate(frames(DARK))
    assert not dark.success and dark.message.startswith("no frame accepted, ")
    assert results_of(node)[3] < before[3]


def test_the_file_says_what_was_asked_and_whether_it_was_reached(start, tmp_path, monkeypatch):
    use_improving(monkeypatch, calibration)
    path, targets = tmp_path / "out.yaml", reached_by(3)
    node = start(output_path=str(path), timeout_s=60.0, **asking(targets))
    assert node.calibrate(frames()).success
    saved = load_result(path)
    assert saved.evidence.targets == targets and targets.reached(saved.as_result())
    assert saved.evidence.mount is not None and saved.n_frames == 3
    for name in asking(targets):
        set_parameter(node, name, 0.0)
    assert node.calibrate(frames()).success
    assert load_result(path).evidence.targets is None, "any was good enough"


def test_resets_and_calls_at_once_get_an_answer_each(start, monkeypatch):
    use_improving(monkeypatch, calibration)
    node = start(timeout_s=60.0, **asking(reached_by(10_000)))
    answers = []

    def ask(name):
        answers.append(node.serve(name, Trigger.Request(), Trigger.Response()))

    def messages(number):
        if node.calibrated_frames >= 2 and not threads:
            ask("calibrate")  # answered at once
            threads.extend(threading.Thread(target=ask, args=("reset",)) for _ in range(2))
            for thread in threads:
                thread.start()
        return frames()(number)

    threads = []
    assert node.calibrate(messages).message == RESET
    for thread in threads:
        thread.join(60.0)
    wait_until(lambda: len(answers) == 3, "the answers")
    assert answers[0].message.startswith("busy: ")
    words = ("the running call is ended; there was no active", "there was no active calibration")
    assert all(answer.success and answer.message.startswith(words) for answer in answers[1:])
