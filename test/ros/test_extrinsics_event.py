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

"""``~/extrinsics``: the result, and how it was reached by the names of the result file."""

import pytest

pytest.importorskip("rclpy")

import ros_graph
import yaml
from node_in_process import NodeInProcess
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import parameter_value_to_python
from result_making import MOUNT, a_mount, a_result

from stereo_selfcal.core.config import flatten
from stereo_selfcal.files.result_file import format_result
from stereo_selfcal.ros.outputs import Publication


def publish(node, result):
    selfcal = node.selfcal
    selfcal._outputs.publish(Publication(result, selfcal._parameters.config, 1_000_000_000))


def events(node):
    return [message for topic, message in node.sent if topic.endswith("/extrinsics")]


def values(event):
    found = {each.name: parameter_value_to_python(each.value) for each in event.changed_parameters}
    return {name: value if isinstance(value, int | float) else list(value) for name, value in found.items()}


def test_it_says_what_the_file_says_of_the_mount():
    with NodeInProcess() as node:
        publish(node, a_mount())
        (event,) = events(node)
    said = values(event)
    text = format_result(a_mount(), ros_graph.RIG, "source", 7)
    in_file = flatten(yaml.safe_load(text)["/**"]["ros__parameters"])
    assert said == {name: in_file[name] for name in said}
    assert {name for name in in_file if name.startswith(("provenance.mount", "provenance.terms"))} <= set(
        said
    )
    assert said["provenance.mount.duration_s"] == MOUNT.duration_s
    kinds = {each.name: each.value.type for each in event.changed_parameters}
    assert kinds["provenance.mount.stood"] == ParameterType.PARAMETER_BOOL
    assert kinds["provenance.terms.motion"] == ParameterType.PARAMETER_DOUBLE_ARRAY
    assert list(said)[:6] == [name for name in in_file if name.startswith("extrinsics.")]


def test_what_the_next_result_does_not_say_is_deleted():
    with NodeInProcess() as node:
        publish(node, a_mount())
        publish(node, a_result())
        publish(node, a_result())
        node.selfcal._outputs.withdraw()
        first, second, third, last = events(node)
    assert set(values(second)) | {each.name for each in second.deleted_parameters} == set(values(first))
    assert not set(values(second)) & {each.name for each in second.deleted_parameters}
    assert list(third.deleted_parameters) == []
    assert [each.name for each in last.deleted_parameters] == list(values(third))
