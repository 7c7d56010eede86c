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

"""alignment.*: set with the result, unset where an angle is not known, restored, nobody else's to set."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy")

import ros_graph
from node_in_process import NodeInProcess
from rclpy.parameter import Parameter

from stereo_selfcal import CalibrationResult, Extrinsics
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.files.node_settings import ALIGNMENT_RESULTS
from stereo_selfcal.files.result_file import write_result
from stereo_selfcal.files.saved_result import topics_source
from stereo_selfcal.ros.outputs import Publication

STDS = (1e-5, 2e-5, 3e-4)
ALIGNMENT = Alignment(1e-4, -2e-4, 2.4e-3, np.diag(np.square(STDS)))
RESULT = CalibrationResult(
    "good",
    extrinsics=Extrinsics(1.4, 0.05, 0.01),
    covariance=np.eye(3) * 1e-6,
    n_frames=1,
    alignment=ALIGNMENT,
)
EXPECTED = dict(zip(ALIGNMENT_RESULTS, (1e-4, -2e-4, 2.4e-3, *STDS), strict=True))


def values(node):
    return {name: node.node.get_parameter(name).value for name in ALIGNMENT_RESULTS}


def publish(node, result):
    selfcal = node.selfcal
    selfcal._outputs.publish(Publication(result, selfcal._parameters.config, 1_000_000_000))


def test_declared_without_value_and_set_with_the_result():
    with NodeInProcess() as node:
        assert values(node) == dict.fromkeys(ALIGNMENT_RESULTS)
        publish(node, RESULT)
        assert values(node) == pytest.approx(EXPECTED, rel=1e-12)
        for name in ALIGNMENT_RESULTS:
            assert node.node.describe_parameter(name).description.endswith(
                "[rad]; without value until it is known"
            )
        node.selfcal._outputs.withdraw()
        assert values(node) == dict.fromkeys(ALIGNMENT_RESULTS)
        node.selfcal._outputs.withdraw()  # nothing is left to be withdrawn
        assert node.node.get_parameter("extrinsics.height_m").value is None


def test_what_a_later_result_does_not_know_loses_its_value():
    with NodeInProcess() as node:
        publish(node, RESULT)
        unseen = Alignment(1e-4, -2e-4, 0.0, np.diag([*np.square(STDS[:2]), math.inf]))
        publish(node, replace(RESULT, alignment=unseen))
        known = {name: value for name, value in values(node).items() if value is not None}
        assert set(known) == {name for name in ALIGNMENT_RESULTS if "yaw" not in name}
        publish(node, replace(RESULT, alignment=None))
        assert values(node) == dict.fromkeys(ALIGNMENT_RESULTS)
        assert node.node.get_parameter("extrinsics.height_m").value == 1.4
        publish(node, RESULT)
        assert None not in values(node).values()


def test_extrinsics_message_has_the_extrinsics_and_no_alignment():
    with NodeInProcess() as node:
        publish(node, RESULT)
        (event,) = [message for topic, message in node.sent if topic.endswith("/extrinsics")]
        names = [parameter.name for parameter in event.changed_parameters]
        assert all(name.startswith("extrinsics.") for name in names[:6])
        assert names[6:] == ["provenance.frames"]


def test_results_are_the_nodes_and_the_setting_is_the_users():
    with NodeInProcess() as node:
        outcomes = node.node.set_parameters(
            [
                Parameter("alignment.yaw_rad", value=0.1),
                Parameter("alignment.correct", value="all"),
                Parameter("alignment.correct", value="some"),
            ]
        )
        assert [outcome.successful for outcome in outcomes] == [False, True, False]
        assert outcomes[0].reason == "alignment.yaw_rad is a result: it is set by ~/calibrate alone"
        assert "must be one of none, rows, all" in outcomes[2].reason
        assert node.selfcal._parameters.config.calibrator.alignment.correct == "all"


def test_result_file_among_the_parameter_files_sets_no_alignment():
    with NodeInProcess(**{"alignment.yaw_rad": 0.1, "alignment.correct": "none"}) as node:
        (line,) = (text for text in node.logged if "listening to" not in text)
        assert line.startswith("alignment.yaw_rad given at the start")
        assert values(node) == dict.fromkeys(ALIGNMENT_RESULTS)
        assert node.node.get_parameter("alignment.correct").value == "none"


def test_restored_with_the_calibration(tmp_path):
    path = tmp_path / "out.yaml"
    source = topics_source("/left/image_rect", "/right/image_rect")
    write_result(path, RESULT, ros_graph.RIG, source=source, seed=0)
    with NodeInProcess(output_path=str(path)) as node:
        assert values(node) == pytest.approx(EXPECTED, rel=1e-12)
