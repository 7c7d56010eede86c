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

"""Declared parameters, the shipped parameter files and the table of settings are one list."""

import os

import pytest
import yaml

pytest.importorskip("rclpy")

from pathlib import Path

import ros_graph
from call_making import ANY_STD
from ros_graph import NodeProcess

from stereo_selfcal import CalibratorConfig, ConfigError
from stereo_selfcal.core.config import flatten
from stereo_selfcal.core.geometry.travel import YAW_NAMES
from stereo_selfcal.files.exports import EXPORTS
from stereo_selfcal.files.node_settings import (
    ALIGNMENT_RESULTS,
    FOREIGN_NAMES,
    NODE_SETTINGS,
    all_settings,
    is_calibrator_setting,
)
from stereo_selfcal.files.parameter_file import load_calibrator_config
from stereo_selfcal.files.saved_result import RESULT_NAMES
from stereo_selfcal.ros.config import SETTINGS, NodeConfig

CONFIG = ros_graph.ROOT / "config"
SHIPPED = ("stereo_selfcal.yaml", "collado2006.yaml")


def parameters_in(name):
    document = yaml.safe_load((CONFIG / name).read_text(encoding="utf-8"))
    return flatten(document["/**"]["ros__parameters"])


def defaults():
    return {setting.name: setting.default for setting in all_settings()}


@pytest.mark.parametrize("name", SHIPPED)
def test_node_takes_every_shipped_file(graph, tmp_path, name):
    with NodeProcess(tmp_path, arguments=["--params-file", str(CONFIG / name)]) as process:
        given = ("output_path", "timeout_s", *ANY_STD)  # by the harness
        expected = {key: value for key, value in parameters_in(name).items() if key not in given}
        assert graph.parameters(*expected) == list(expected.values())
        assert process.end() == 0


def test_declared_parameters_are_those_of_the_table_and_the_results(graph, tmp_path):
    with NodeProcess(tmp_path):
        declared = {name for name in graph.list_parameters() if not name.startswith("qos_overrides.")}
        assert set(ALIGNMENT_RESULTS) <= declared
        results = {f"extrinsics.{name}" for name in (*RESULT_NAMES, *YAW_NAMES)}
        assert declared - set(FOREIGN_NAMES) == {setting.name for setting in all_settings()} | results
        names = sorted(SETTINGS)
        descriptors = dict(zip(names, graph.describe(*names), strict=True))
    for name, setting in SETTINGS.items():
        descriptor = descriptors[name]
        assert setting.description in descriptor.description
        assert not setting.unit or f"[{setting.unit}]" in descriptor.description
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        numeric = isinstance(setting.default, int | float) and not isinstance(setting.default, bool)
        assert len(ranges) == numeric
        if numeric:
            assert (ranges[0].from_value, ranges[0].to_value) == (setting.low, setting.high)


def test_qos_of_every_subscription_can_be_overridden(graph, tmp_path):
    name = "qos_overrides./left/image_rect.subscription.reliability"
    path = Path(tmp_path, "qos.yaml")
    path.write_text(
        "/**: {ros__parameters: {qos_overrides: {/left/image_rect: {subscription: {reliability: reliable}}}}}"
    )
    with NodeProcess(tmp_path, arguments=["--params-file", str(path)]):
        assert graph.parameters(name) == ["reliable"]
        topics = [f"/{side}/{name}" for side in ("left", "right") for name in ("image_rect", "camera_info")]
        declared = graph.list_parameters()
        assert {f"qos_overrides.{topic}.subscription.depth" for topic in topics} <= declared
        assert graph.parameters("qos_overrides./right/image_rect.subscription.reliability") == ["best_effort"]


def test_reference_file_gives_every_parameter_its_default_and_description():
    # Not output_path: a file that sets it would give all nodes that read it one result file.
    given = {name: value for name, value in defaults().items() if name != "output_path"}
    assert parameters_in("stereo_selfcal.yaml") == given
    text = (CONFIG / "stereo_selfcal.yaml").read_text(encoding="utf-8")
    for setting in all_settings():
        assert f"# {setting.description}" in text, setting.name


def test_paper_file_has_the_papers_numbers():
    parameters = parameters_in("collado2006.yaml")
    assert parameters == {
        "extraction.sample_step_px": 10,
        "extraction.horizon_fraction": 0.9,
        "fitness.k": 1e-4,
        "genetic.population": 100,
        "genetic.parent_fraction": 0.5,
        "genetic.child_fraction": 0.9,
        "genetic.crossover_probability": 0.7,
        "genetic.mutation_probability": 0.1,
        "genetic.max_generations": 500,
        "texture.check": 0,  # the paper knows neither the road surface
        "refinement.stripes": 0,  # nor the grey values of the stripes
        "alignment.correct": "none",  # nor cameras that have turned
        "known.cold_every_s": 0.0,  # nor the frame before
    }
    assert set(parameters) <= set(defaults())


@pytest.mark.parametrize("name", SHIPPED)
def test_replay_reads_the_same_settings(name):
    settings = {key: value for key, value in parameters_in(name).items() if is_calibrator_setting(key)}
    assert load_calibrator_config(CONFIG / name) == CalibratorConfig.from_mapping(settings)


def test_calibrator_settings_are_told_from_the_nodes():
    own = {setting.name for setting in NODE_SETTINGS}
    assert {name for name in defaults() if is_calibrator_setting(name)} == set(defaults()) - own
    assert is_calibrator_setting("no.such.thing")


def config(**changes):
    return NodeConfig.from_values(
        {**defaults(), **{name.replace("__", "."): v for name, v in changes.items()}}
    )


def test_output_path_is_absolute_and_knows_the_home_folder(monkeypatch):
    monkeypatch.setenv("HOME", "/home/somebody")
    assert str(config().output_path) == "/home/somebody/.ros/stereo_selfcal.yaml"
    assert config(output_path="out.yaml").output_path == Path(os.getcwd(), "out.yaml")  # noqa: PTH109
    assert config(output_path=" ").output_path is None


def test_exports_are_a_list_of_names():
    assert config().exports == ()
    assert config(exports="autoware, urdf").exports == ("autoware", "urdf")
    assert all(name in SETTINGS["exports"].description for name in EXPORTS)


def test_rig_is_all_or_nothing():
    assert config().rig_from_parameters() is None
    rig = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "baseline_m": 0.1}
    assert (
        config(**{f"rig__{name}": value for name, value in rig.items()}).rig_from_parameters().to_mapping()
        == rig
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"image_transport": "theora"}, "one of raw, compressed"),
        ({"camera_frame": ""}, "camera_frame is empty"),
        ({"output_path": "~nobody_of_this_name/x"}, "give the whole path"),
        ({"search__height_max_m": 0.1}, "must be the smaller"),
        ({"exports": "urdf,tf"}, "exports is 'urdf,tf': there is no export 'tf': they are urdf, "),
        ({"exports": "urdf", "output_path": " "}, "exports is 'urdf', but output_path, .* is empty"),
    ],
)
def test_impossible_combinations(changes, words):
    with pytest.raises(ConfigError, match=words):
        config(**changes)


def test_texture_cannot_be_required_where_it_is_not_looked_for():
    with pytest.raises(ConfigError, match=r"texture.required is 1, but texture.check is 0"):
        config(texture__required=1, texture__check=0)
