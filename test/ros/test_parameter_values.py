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

"""Values of parameters as people and tools write them: taken as they are meant, or refused."""

import pytest
import yaml

pytest.importorskip("rclpy")

from node_in_process import NodeInProcess
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file

from stereo_selfcal.core.errors import ConfigError
from stereo_selfcal.ros.config import SETTINGS


def test_what_param_dump_writes_param_load_can_set(tmp_path):
    """By the steps of ros2cli: values are dumped with PyYAML, and read back by rclpy."""
    with NodeInProcess(**{"genetic.tolerance": 1e-05, "fitness.k": 2.5e-07}) as node:
        given = {name: node.node.get_parameter(name).value for name in SETTINGS}
        path = tmp_path / "dump.yaml"
        path.write_text(yaml.safe_dump({"/stereo_selfcal": {"ros__parameters": given}}))
        loaded = parameter_dict_from_yaml_file(str(path))
        assert isinstance(Parameter.from_parameter_msg(loaded["genetic.tolerance"]).value, str), (
            "no hindrance"
        )
        for name, message in loaded.items():
            (outcome,) = node.node.set_parameters([Parameter.from_parameter_msg(message)])
            assert outcome.successful or SETTINGS[name].fixed, outcome.reason
        assert {name: node.node.get_parameter(name).value for name in SETTINGS} == given


@pytest.mark.parametrize(
    ("name", "given", "taken"),
    [
        ("texture.check", True, 1),
        ("texture.check", False, 0),
        ("genetic.tolerance", "1e-05", 1e-05),
        ("timeout_s", "2.", 2.0),
        ("timeout_s", 5, 5.0),
    ],
)
def test_value_is_taken_as_it_was_meant_at_the_start_and_when_it_is_set(name, given, taken):
    with NodeInProcess(**{name: given}) as node:
        assert node.node.get_parameter(name).value == taken
        assert type(node.node.get_parameter(name).value) is type(taken)
    with NodeInProcess() as node:
        (outcome,) = node.node.set_parameters([Parameter(name, value=given)])
        assert outcome.successful, outcome.reason
        assert node.node.get_parameter(name).value == taken


@pytest.mark.parametrize(
    ("name", "value"),
    [("frames", True), ("timeout_s", "five"), ("timeout_s", "1e-05 s"), ("timeout_s", "nan"), ("seed", "1")],
)
def test_value_of_another_meaning_is_refused(name, value):
    with pytest.raises(ConfigError, match=name), NodeInProcess(**{name: value}):
        pass
