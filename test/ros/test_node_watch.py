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

"""The node over its life: restored, suspect, recalibrated, withdrawn; in this process."""

import dataclasses
import re
import threading

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from call_making import ANY_STD, scripted_calls
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from ros_graph import RESULTS, Camera, rendered

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.faults import FaultLog
from stereo_selfcal.core.results import caught
from stereo_selfcal.files.result_file import load_result, write_result
from stereo_selfcal.ros import selfcal as selfcal_module
from stereo_selfcal.ros.calibration import CallOutcome
from stereo_selfcal.ros.record import FrameReport, failed_frame
from stereo_selfcal.ros.selfcal import SelfcalNode

POSE = np.array([1.5, 0.05, -0.01])
COVARIANCE = np.diag([1e-6, 1e-8, 4e-8])
BUMP = np.array([0.0, 0.02, 0.0])
STEP_S = 3.0
OTHER_RIG = dataclasses.replace(ros_graph.RIG, fx=500.0)


def result(pose=POSE, stamp_s=1.7e9):
    return CalibrationResult(
        "calibrated", None, Extrinsics.from_array(pose), COVARIANCE, stamp_s=stamp_s, n_frames=1
    )


GOOD = CallOutcome("calibrated", result(), ros_graph.RIG, 5)


@pytest.fixture
def start(graph):
    """Start the node in this process; nothing is watched unless it is said."""
    running = []

    def start(**parameters):
        values = {"output_path": "", "monitor_period_s": 0.0, **ANY_STD, **parameters}
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        selfcal = SelfcalNode(parameter_overrides=overrides)
        executor = MultiThreadedExecutor(4)
        executor.add_node(selfcal.node)
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        running.append((selfcal, executor, thread))
        return selfcal

    yield start
    for selfcal, executor, thread in running:
        selfcal.stop()
        executor.shutdown()
        thread.join()
        selfcal.node.destroy_node()


@pytest.fixture
def scripted(monkeypatch):
    """Calls of ~/calibrate answer GOOD."""
    monkeypatch.setattr(selfcal_module, "CalibrationCall", scripted_calls(lambda: GOOD))


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "out.yaml"
    write_result(path, result(), ros_graph.RIG, source="/left/image_rect /right/image_rect", seed=3)
    return path


def calibration(graph, state):
    """Wait until the state is reported and return the status and its values."""
    status = graph.wait_for_diagnostics(lambda values, _: values["state"] == state)
    return status, {pair.key: pair.value for pair in status.values}


def drive(selfcal, n, shift=0.0, start_s=0.0):
    """Give n frames to the watch, as its thread does."""
    rng = np.random.default_rng(2)
    for i in range(n):
        pose = POSE + shift + rng.standard_normal(3) * (3e-3, 1e-3, 1e-3)
        frame = result(pose, start_s + i * STEP_S)
        selfcal._on_watched(FrameReport(None, None, ros_graph.RIG, frame, int(frame.stamp_s * 1e9), 0.05))


def test_a_fault_on_a_frame_is_logged_once_counted_and_ends_no_watch(start, monkeypatch):
    logged = []
    monkeypatch.setattr(selfcal_module, "FaultLog", lambda _: FaultLog(logged.append))
    selfcal = start()
    fault = caught(lambda: 1 // 0, 0.0).fault
    for stamp_ns in range(3):
        selfcal._on_watched(failed_frame(fault, stamp_ns))
        selfcal._on_frame(failed_frame(fault, stamp_ns))
    assert selfcal._record.statistics.rejected == {"internal_error": 6}
    assert len(logged) == 1 and "ZeroDivisionError" in logged[0] and "Traceback" in logged[0]


def test_calibration_of_the_last_run_is_there_from_the_start(graph, start, saved):
    start(output_path=str(saved))
    assert graph.parameters(*RESULTS)[:3] == POSE.tolist()
    event = graph.latest(ParameterEvent, "extrinsics")
    assert [p.name for p in event.changed_parameters][:6] == RESULTS
    pose = graph.latest(PoseWithCovarianceStamped, "pose")
    assert (pose.pose.pose.position.z, pose.header.stamp.sec) == (1.5, 1_700_000_000)
    status, values = calibration(graph, "calibrated")
    assert status.level == DiagnosticStatus.OK
    assert values["state_reason"] == values["saved"] == f"restored from {saved}"
    assert values["watch"] == "off: monitor_period_s is 0"
    assert float(values["age_s"]) > 86400.0  # since 2023


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda text: text[: len(text) // 2], "is missing"),
        (lambda text: text.replace("schema: 2", "schema: 7"), "written by a newer version"),
        (lambda text: "a: {b: [1, 2]}\n", "is not"),
        (lambda text: text.replace("height_m: 1.5", "height_m: .nan"), "height_m is nan"),
    ],
    ids=["cut", "future", "foreign", "nan"],
)
def test_file_that_cannot_be_used_is_one_error_and_kept_aside(graph, start, saved, capfd, spoil, words):
    content = spoil(saved.read_text())
    saved.write_text(content)
    start(output_path=str(saved))
    assert graph.parameters(*RESULTS) == [None] * 6
    aside = saved.with_name("out.yaml.rejected")
    assert aside.read_text() == content
    assert not saved.exists()
    _, values = calibration(graph, "uncalibrated")
    assert f"kept aside as {aside}" in values["state_reason"]
    errors = [line for line in capfd.readouterr().err.splitlines() if "[ERROR]" in line]
    assert len(errors) == 1
    assert values["state_reason"] in errors[0]


def test_file_of_another_rig_is_not_used(graph, start, saved):
    before = saved.read_bytes()
    rig = {f"rig.{name}": value for name, value in OTHER_RIG.to_mapping().items()}
    start(output_path=str(saved), **rig)
    assert graph.parameters(*RESULTS) == [None] * 6
    _, values = calibration(graph, "uncalibrated")
    assert values["state_reason"].startswith(
        "the calibration is of other cameras: rig.fx was 516.6, now it is 500"
    )
    assert saved.read_bytes() == before


def test_other_cameras_take_a_calibration_back(graph, start, scripted):
    selfcal = start()
    assert graph.calibrate().success
    calibration(graph, "calibrated")
    for side in ros_graph.SIDES:
        selfcal._input._infos.keep(side, ros_graph.info_message(side, OTHER_RIG))
    status, values = calibration(graph, "uncalibrated")
    assert status.level == DiagnosticStatus.WARN
    assert "of other cameras: rig.fx was 516.6, now it is 500" in status.message
    assert "height_m" not in values
    assert graph.parameters(*RESULTS) == [None] * 6
    event = graph.latest(ParameterEvent, "extrinsics")
    assert [p.name for p in event.deleted_parameters][:6] == RESULTS
    selfcal._input._infos.clear()
    assert graph.calibrate().success  # and the parameters can be set again
    assert graph.parameters(*RESULTS)[:3] == POSE.tolist()


def test_drift_is_told_and_what_was_found_stays_active(graph, start, scripted, capfd):
    selfcal = start()
    assert graph.calibrate().success
    drive(selfcal, 60)
    calibration(graph, "calibrated")
    drive(selfcal, 12, BUMP / 8, start_s=200.0)
    drive(selfcal, 60, BUMP, start_s=300.0)
    status, values = calibration(graph, "invalid")
    assert status.level == DiagnosticStatus.ERROR
    # The dozen frames that show an eighth of it are counted as frames since the change.
    assert re.match(r"invalid: pitch over the road has changed by \+(0\.9|1\.[01])", status.message)
    assert values["state_reason"] in status.message
    assert graph.parameters(*RESULTS)[:3] == POSE.tolist()
    log = capfd.readouterr().err
    assert log.count("suspect: pitch over the road has changed by +") == 1
    assert log.count("invalid: pitch over the road has changed by +") == 1
    drive(selfcal, 200, start_s=600.0)
    calibration(graph, "calibrated")


def test_drift_recalibrates_where_that_is_wanted(graph, start, scripted, tmp_path):
    path = tmp_path / "out.yaml"
    selfcal = start(on_drift="recalibrate", output_path=str(path))
    assert graph.calibrate().success
    drive(selfcal, 60)
    assert graph.parameters(*RESULTS)[:3] == POSE.tolist()
    drive(selfcal, 60, BUMP, start_s=200.0)
    _, values = calibration(graph, "calibrated")
    assert values["state_reason"] == "proven better by the watch"
    found = graph.parameters(*RESULTS)
    np.testing.assert_allclose(found[:3], POSE + BUMP, atol=4e-3)
    assert load_result(path).extrinsics == Extrinsics(*found[:3])
    assert load_result(path).n_frames > 10


def test_without_a_calibration_the_watch_makes_one_where_that_is_wanted(graph, start):
    selfcal = start(on_drift="recalibrate")
    drive(selfcal, 40)
    calibration(graph, "calibrated")
    np.testing.assert_allclose(graph.parameters(*RESULTS)[:3], POSE, atol=4e-3)


def test_watch_looks_at_frames_of_its_own(graph, start):
    start(monitor_period_s=0.2)
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
        status = graph.wait_for_diagnostics(
            lambda values, _: int(values["frames_accepted"]) > 2 and "100%" not in values["watch"]
        )
    assert status.level == DiagnosticStatus.OK


def test_watch_that_is_off_looks_at_nothing(graph, start):
    start()
    with Camera(graph, [rendered()]):
        assert graph.calibrate().success
        for _ in range(3):
            graph.wait_for_diagnostics(lambda values, _: int(values["frames_accepted"]) == 1)
