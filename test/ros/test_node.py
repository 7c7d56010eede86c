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

"""What the node makes of outcomes that no real frame gives: in this process, with scripted calls."""

import dataclasses
import math
import threading
from importlib import import_module

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from call_making import scripted_calls
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from ros_graph import RESULTS, wait_for

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.files.result_file import load_result
from stereo_selfcal.ros import selfcal as selfcal_module
from stereo_selfcal.ros.calibration import CallOutcome
from stereo_selfcal.ros.node import main
from stereo_selfcal.ros.selfcal import SelfcalNode

RESULT = CalibrationResult(
    "calibrated", extrinsics=Extrinsics(1.5, 0.05, -0.01), covariance=np.diag([1e-4, 1e-6, 4e-6]), n_frames=1
)
GOOD = CallOutcome("calibrated", RESULT, ros_graph.RIG, 5)
VALUES = [1.5, 0.05, -0.01, 0.01, 0.001, 0.002]


@pytest.fixture
def script(graph, monkeypatch):
    """Start the node; the outcomes put into the list that is returned are those of its calls, in order."""
    outcomes = []

    def next_outcome():
        outcome = outcomes.pop(0)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    monkeypatch.setattr(selfcal_module, "CalibrationCall", scripted_calls(next_outcome))
    unsaved = Parameter("output_path", Parameter.Type.STRING, "")  # and nothing is restored
    selfcal = SelfcalNode(parameter_overrides=[unsaved])
    executor = MultiThreadedExecutor(4)
    executor.add_node(selfcal.node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    yield outcomes
    selfcal.stop()
    executor.shutdown()
    thread.join()
    selfcal.node.destroy_node()


def set_output(graph, path):
    assert graph.set_parameter("output_path", str(path)).successful


def test_exception_is_answered_and_the_next_call_works(graph, script, tmp_path):
    set_output(graph, tmp_path / "out.yaml")
    script += [ZeroDivisionError("division by zero"), GOOD]
    answer = graph.calibrate()
    assert not answer.success
    assert answer.message == "internal error, see the node's log: ZeroDivisionError: division by zero"
    assert graph.parameters(*RESULTS) == [None] * 6
    assert graph.calibrate().success
    assert graph.parameters(*RESULTS) == VALUES


@pytest.mark.parametrize(
    "changes",
    [
        {"extrinsics": Extrinsics(math.nan, 0.0, 0.0)},
        {"covariance": np.diag([math.inf, 1.0, 1.0])},
        {"covariance": None},
        {"extrinsics": None},
    ],
)
def test_what_is_not_finite_is_neither_set_nor_saved(graph, script, tmp_path, changes):
    set_output(graph, tmp_path / "out.yaml")
    script += [GOOD, dataclasses.replace(GOOD, result=dataclasses.replace(RESULT, **changes))]
    assert graph.calibrate().success
    assert not graph.calibrate().success
    assert graph.parameters(*RESULTS) == VALUES
    assert load_result(tmp_path / "out.yaml").extrinsics == RESULT.extrinsics


def test_default_file_is_saved_though_its_folder_is_missing(graph, script, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    set_output(graph, "~/.ros/stereo_selfcal.yaml")
    script.append(GOOD)
    answer = graph.calibrate()
    assert answer.success
    assert answer.message.startswith("calibrated; the yaw is not known (")
    assert answer.message.endswith(f"; saved to {tmp_path}/home/.ros/stereo_selfcal.yaml")
    assert load_result(tmp_path / "home" / ".ros" / "stereo_selfcal.yaml").extrinsics == RESULT.extrinsics


def test_output_path_that_cannot_be_written_is_refused_when_it_is_set(graph, script, tmp_path, monkeypatch):
    (tmp_path / "home").write_text("a file")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    answer = graph.set_parameter("output_path", "~/.ros/stereo_selfcal.yaml")
    assert not answer.successful
    assert answer.reason.startswith(f"output_path: {tmp_path}/home/.ros/stereo_selfcal.yaml cannot be wri")


def test_no_file_without_a_path(graph, script):
    set_output(graph, "")
    script.append(GOOD)
    answer = graph.calibrate()
    assert answer.success
    assert answer.message.endswith("; not saved, as output_path is empty")


def test_severities_of_the_log_may_alternate(graph, script):
    """rclpy raises when one line of code logs with changing severity."""
    set_output(graph, "")
    script += [GOOD, CallOutcome("no frame accepted"), GOOD, CallOutcome("no frame accepted")]
    assert [graph.calibrate().success for _ in range(4)] == [True, False, True, False]


def test_many_calls_at_once_get_an_answer_each(graph, script):
    set_output(graph, "")
    script += [GOOD] * 10
    answers = [wait_for(future) for future in [graph.start_calibrate() for _ in range(10)]]
    assert all(answer.success or answer.message.startswith("busy: ") for answer in answers)
    assert any(answer.success for answer in answers)


def test_help_and_wrong_arguments(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    assert "~/calibrate" in capsys.readouterr().out
    assert main(["surplus"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "surplus" in err and "--help" in err


@pytest.mark.parametrize("module", ["node", "demo"])
def test_what_the_node_does_not_foresee_is_status_3(capsys, monkeypatch, module):
    def fail(*_arguments):
        raise ZeroDivisionError("by nothing")

    name = "_run" if module == "node" else "run_demo"
    monkeypatch.setattr(f"stereo_selfcal.ros.{module}.{name}", fail)
    assert import_module(f"stereo_selfcal.ros.{module}").main([]) == 3
    err = capsys.readouterr().err
    assert "Traceback" in err and "ZeroDivisionError: by nothing" in err and "please report" in err
