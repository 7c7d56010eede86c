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

"""Parameter files: which settings are read, and what is refused in one sentence."""

import os
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereo_selfcal import CalibratorConfig, ConfigError
from stereo_selfcal.core.geometry.vehicle import PlaceInVehicle
from stereo_selfcal.files.frames import FrameNames
from stereo_selfcal.files.parameter_file import load_calibrator_config, load_frames, node_parameters

# Nine lines that stand for 3^20 words.
BOMB = "a0: &a0 [lol, lol, lol]\n" + "".join(
    f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}]\n" for i in range(1, 20)
)

UNUSABLE = {
    "empty": b"",
    "binary": b"\xff\xfe",
    "list": b"[1, 2]",
    "word": b"word",
    "number": b"/**: 3",
    "cut": b"a: [",
    "object": b"!!python/object:os.system {}",
    "nul": b"/**: {ros__parameters: {seed: 1\0}}",
    "zeros": bytes(4096),
    "bomb": BOMB.encode(),
    "alias": b"/**: {ros__parameters: {a: &a 1, b: *a}}",
    "endless": b"/**: &a [*a]",
    "digits": b"/**: {ros__parameters: {seed: " + b"9" * 5000 + b"}}",
    "hexadecimal": b"/**: {ros__parameters: {seed: 0x" + b"f" * 5000 + b"}}",
    "deep": b"[" * 30_000,
    "date": b"/**: {ros__parameters: {seed: 2001-99-99}}",
    "bool": b"!!bool maybe",
    "timestamp": b"!!timestamp soon",
    "unhashable": b"? [1]\n: 2",
    "merge": b"<<: 3",
    "huge": b"#" * 1_000_001,
}


@pytest.mark.parametrize("content", UNUSABLE.values(), ids=UNUSABLE)
def test_what_is_no_parameter_file_is_one_clear_error(tmp_path, content):
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    start_s = time.monotonic()
    with pytest.raises(ConfigError, match=r"x\.yaml") as error:
        load_calibrator_config(path)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300 + len(str(path))
    assert time.monotonic() - start_s < 30.0, "it must not be read for ever"


@pytest.mark.parametrize("text", ["1e-05", "1E-5", "+1e-05", "1.0e-05", "0.00001"])
def test_number_is_read_as_rcl_reads_it(tmp_path, text):
    """YAML 1.1 takes the first three for words."""
    (tmp_path / "x.yaml").write_text(f"/**: {{ros__parameters: {{genetic: {{tolerance: {text}}}}}}}")
    assert load_calibrator_config(tmp_path / "x.yaml").genetic.tolerance == 1e-05


def test_bomb_is_refused_where_it_begins(tmp_path):
    (tmp_path / "x.yaml").write_text(BOMB)
    with pytest.raises(ConfigError, match="not YAML in line 2: aliases"):
        node_parameters(tmp_path / "x.yaml")


def test_larger_file_than_asked_for_is_refused(tmp_path):
    text = "/**: {ros__parameters: {seed: 1}}"
    (tmp_path / "x.yaml").write_text(text)
    assert node_parameters(tmp_path / "x.yaml", len(text)) == {"seed": 1}
    with pytest.raises(ConfigError, match=f"larger than {len(text) - 1} bytes"):
        node_parameters(tmp_path / "x.yaml", len(text) - 1)


@given(st.binary(max_size=200) | st.text(alphabet="[]{}:-?!&*<>|'\"%@#,\n 01a.xe~=", max_size=60))
def test_whatever_is_in_a_file_it_is_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError, match=r"fuzz\.yaml"):
        node_parameters(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [("missing.yaml", "no such file"), (".", "is a directory"), ("a\0b", "null")],
)
def test_file_that_cannot_be_read(tmp_path, name, words):
    with pytest.raises(ConfigError, match=f"cannot be read: .*{words}"):
        load_calibrator_config(tmp_path / name)


def config_from(tmp_path, text):
    path = tmp_path / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return load_calibrator_config(path)


@pytest.mark.parametrize("node", ["/**", "stereo_selfcal", "/stereo_selfcal", "/car/stereo_selfcal"])
def test_calibrator_settings_are_read_and_the_nodes_own_passed_over(tmp_path, node):
    config = config_from(
        tmp_path,
        f"""
{node}:
  ros__parameters:
    seed: 5
    genetic: {{population: 50}}
    search.height_max_m: 3
    timeout_s: 1.0
    frames: 4
    rig: {{fx: 1.0, baseline_m: 2.0}}
    extrinsics: {{height_m: 1.0}}
    provenance: {{schema: 1}}
    use_sim_time: true
    qos_overrides: {{/left/image_rect: {{subscription: {{reliability: reliable}}}}}}
""",
    )
    assert (config.seed, config.genetic.population, config.search.height_max_m) == (5, 50, 3.0)
    assert config.fitness == CalibratorConfig().fitness


def test_entries_for_the_node_win_over_those_for_any_node(tmp_path):
    config = config_from(
        tmp_path,
        """
stereo_selfcal: {ros__parameters: {genetic: {population: 50}}}
/**: {ros__parameters: {seed: 3, genetic: {population: 60, max_generations: 70}}}
other: {ros__parameters: {seed: 9}}
""",
    )
    assert (config.seed, config.genetic.population, config.genetic.max_generations) == (3, 50, 70)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sed: 1", "unknown setting 'sed'"),
        ("genetic: {population: 0}", "genetic.population is 0"),
        ("genetic: {population: many}", "a whole number is needed"),
        ("search: {height_min_m: 4.0, height_max_m: 1.0}", "must be the smaller"),
    ],
)
def test_wrong_settings_name_the_file(tmp_path, setting, words):
    with pytest.raises(ConfigError) as error:
        config_from(tmp_path, f"/**: {{ros__parameters: {{{setting}}}}}")
    assert words in str(error.value) and "config.yaml: " in str(error.value)


def test_frames_are_those_of_the_file_or_the_nodes_own(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("/**: {ros__parameters: {road_frame: asphalt, mount: {x_m: 2}, mount.y_m: -0.5}}")
    place = PlaceInVehicle(2.0, -0.5)
    assert load_frames(path) == FrameNames("base_footprint", "asphalt", "stereo_camera", place)
    assert load_frames(None) == FrameNames("base_footprint", "road", "stereo_camera", PlaceInVehicle())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("mount.x_m: 1700", "mount.x_m is 1700: it must lie in -100 ... 100 m"),
        ("mount.y_m: left", "mount.y_m is 'left': a number is needed"),
        ("vehicle_frame: stereo_camera", "camera_frame and vehicle_frame are both 'stereo_camera': no frame"),
    ],
)
def test_place_and_frames_that_no_vehicle_has_are_refused(tmp_path, given, words):
    path = tmp_path / "config.yaml"
    path.write_text(f"/**: {{ros__parameters: {{{given}}}}}")
    with pytest.raises(ConfigError) as error:
        load_frames(path)
    assert words in str(error.value) and "config.yaml: " in str(error.value)


@pytest.mark.parametrize("name", ["' '", "5", "[road]"])
def test_frame_without_a_name_is_refused(tmp_path, name):
    path = tmp_path / "config.yaml"
    path.write_text(f"/**: {{ros__parameters: {{camera_frame: {name}}}}}")
    with pytest.raises(ConfigError, match=r"config\.yaml: camera_frame is .* name of a frame"):
        load_frames(path)


CONFIG = "{ros__parameters: {seed: 3}}"


def filled(text):
    """Write the name of the node for NODE, and its parameters for CONFIG."""
    return text.replace("NODE", "stereo_selfcal").replace("CONFIG", CONFIG)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("/front/NODE: CONFIG\n/rear/NODE: CONFIG", "/front/NODE, /rear/NODE"),
        ("front: {NODE: CONFIG}\nrear: {NODE: CONFIG}", "front/NODE, rear/NODE"),
        ("/**: CONFIG\nNODE: CONFIG\n/car/NODE: CONFIG", "NODE, /car/NODE"),
        ("/**: CONFIG\n/*: CONFIG", r"/\*\*, /\*"),
        ("/**: CONFIG\n/car/**: CONFIG", r"/\*\*, /car/\*\*"),
        ("/car/*: CONFIG", r"/car/\*"),
        ("NODE: CONFIG\n/*/NODE: CONFIG", r"NODE, /\*/NODE"),
    ],
)  # fmt: skip
def test_parameters_of_several_such_nodes_are_refused_with_their_names(tmp_path, text, names):
    with pytest.raises(ConfigError, match=rf"config\.yaml has several names .*\({filled(names)}\): give a"):
        config_from(tmp_path, filled(text))


@pytest.mark.parametrize("text", ["car: {NODE: CONFIG}", "/car: {front: {NODE: CONFIG}}", "/*: CONFIG"])
def test_namespaces_may_be_levels_of_their_own_as_in_ros(tmp_path, text):
    assert config_from(tmp_path, filled(text)).seed == 3


def test_a_file_of_other_nodes_names_them(tmp_path):
    with pytest.raises(ConfigError, match=r"'/\*\*:' or .* is needed, and it has front_cal, a/b"):
        config_from(tmp_path, f"front_cal: {CONFIG}\na: {{b: {CONFIG}}}")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/**: CONFIG\n/**: {ros__parameters: {frames: 2}}", r"in line 2: '/\*\*' is there twice"),
        ("/**:\n  ros__parameters:\n    seed: 1\n    seed: 2", "in line 4: 'seed' is there twice"),
        ("/**: {ros__parameters: {fitness: {k: 1}, fitness.k: 2}}", "'fitness.k' is there twice"),
        ("/**: CONFIG\n---\n/**: CONFIG", r"has a second document in line 2 \(---\)"),
        ("/**: {ros__parameters: {<<: {seed: 4}, seed: 3}}", "merge keys"),
    ],
)  # fmt: skip
def test_of_two_values_none_wins_in_silence(tmp_path, text, words):
    with pytest.raises(ConfigError, match=rf"config\.yaml.*{words}"):
        config_from(tmp_path, filled(text))


def test_numbers_are_those_of_ros_which_takes_1e3_for_one(tmp_path):
    config = config_from(tmp_path, "/**: {ros__parameters: {fitness: {k: 1e-05}, search.height_max_m: 3e0}}")
    assert (config.fitness.k, config.search.height_max_m) == (1e-5, 3.0)


def test_a_pipe_is_no_parameter_file(tmp_path):
    os.mkfifo(tmp_path / "x.yaml")
    with pytest.raises(ConfigError, match=r"x\.yaml cannot be read: it is not a file"):
        load_calibrator_config(tmp_path / "x.yaml")
