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

"""The launch file against a stand-in for launch: every parameter is an argument and reaches the node."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from stereo_selfcal.files.node_settings import all_settings

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "launch" / "stereo_selfcal.launch.py"
SETTINGS = {setting.name: setting for setting in all_settings()}
SWITCHES = ("texture.check", "texture.required", "refinement.stripes")
OTHERS = {
    "params_file", "camera", "namespace", "log_level", "use_sim_time",
    "left_image", "right_image", "left_raw_image", "right_raw_image", "left_camera_info", "right_camera_info",
}  # fmt: skip


class Configuration:
    """LaunchConfiguration: looks its argument up when the launch file runs."""

    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return context[self.name]


@pytest.fixture
def launch(monkeypatch):
    """Return a function that runs the launch file: (arguments by name, node for the values given)."""

    def module(name, **members):
        found = ModuleType(name)
        vars(found).update(members)
        monkeypatch.setitem(sys.modules, name, found)

    def record(kind):
        return lambda *args, **kwargs: SimpleNamespace(kind=kind, args=args, **kwargs)

    module("launch", LaunchContext=dict, LaunchDescription=list)
    module("launch.actions", DeclareLaunchArgument=record("argument"), OpaqueFunction=record("function"))
    module(
        "launch.substitutions", LaunchConfiguration=Configuration, PathJoinSubstitution=lambda parts: parts
    )
    module("launch_ros")
    module("launch_ros.actions", Node=record("node"))
    module("launch_ros.parameter_descriptions", ParameterValue=record("value"))
    module("launch_ros.substitutions", FindPackageShare=lambda name: f"<share of {name}>")

    def run(**given):
        entities = runpy.run_path(str(FILE))["generate_launch_description"]()
        arguments = {each.args[0]: each for each in entities if each.kind == "argument"}
        (function,) = [each.function for each in entities if each.kind == "function"]
        context = {name: argument.default_value for name, argument in arguments.items()}
        unknown = set(given) - set(context)
        assert not unknown
        (node,) = function({**context, **given})
        return arguments, node

    return run


def test_every_parameter_is_an_argument_with_its_description(launch):
    arguments, _ = launch()
    assert set(arguments) == set(SETTINGS) | OTHERS
    for name, setting in SETTINGS.items():
        assert setting.description in arguments[name].description
        assert arguments[name].default_value == ""
        if setting.low is not None:
            assert setting.range_text and setting.range_text in arguments[name].description
            assert "e+" not in setting.range_text
        assert all(choice in arguments[name].description for choice in setting.choices)


def test_defaults_are_those_of_the_reference_file(launch):
    _, node = launch()
    assert node.parameters == [["<share of stereo_selfcal>", "config", "stereo_selfcal.yaml"]]
    assert (node.package, node.executable, node.name) == ("stereo_selfcal", "node", "stereo_selfcal")


def test_arguments_that_are_given_reach_the_node_with_their_type(launch):
    given = dict.fromkeys(SETTINGS, "1")
    _, node = launch(**given, use_sim_time="true", params_file="/x.yaml")
    first, *values = node.parameters
    assert first == "/x.yaml"
    found = {name: value for each in values for name, value in each.items()}
    assert set(found) == set(SETTINGS) | {"use_sim_time"}
    for name, value in found.items():
        assert value.args[0].name == name
        kind = type(SETTINGS[name].default) if name in SETTINGS else bool
        # A switch of 1 and 0 may be given as true: it gets the type it is written as.
        assert value.value_type is (None if name in SWITCHES else kind)


@pytest.mark.parametrize(
    ("given", "target"),
    [
        ({}, "left/image_rect"),
        ({"camera": "/front/"}, "/front/left/image_rect"),
        ({"camera": "/front", "left_image": "l/rect"}, "/front/l/rect"),
        ({"camera": "/front", "left_image": "/elsewhere"}, "/elsewhere"),
    ],
)
def test_topics(launch, given, target):
    _, node = launch(**given)
    remapped = dict(node.remappings)
    assert remapped["left/image_rect"] == target
    assert set(remapped) == {
        f"{side}/{name}" for side in ("left", "right") for name in ("image_rect", "image_raw", "camera_info")
    }


def test_namespace_and_log_level(launch):
    _, node = launch(namespace="car", log_level="debug")
    assert (node.namespace, node.ros_arguments) == ("car", ["--log-level", "debug"])
