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

"""The camera against the direction of travel in the result file: written, checked, restored, or not there."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from result_making import RIG, TRAVEL, a_mount, a_result, write

from stereo_selfcal import ConfigError
from stereo_selfcal.files.result_file import (
    evidence_parameters,
    format_result,
    load_result,
    result_parameters,
    yaw_parameters,
)

NOT_KNOWN = dataclasses.replace(TRAVEL, covariance=np.diag([math.radians(1.0) ** 2, 9e-6]))
NO_NUMBERS = [
    dataclasses.replace(TRAVEL, yaw_rad=math.nan),
    dataclasses.replace(TRAVEL, yaw_rad=3.0),
    dataclasses.replace(TRAVEL, covariance=np.full((2, 2), math.inf)),
    dataclasses.replace(TRAVEL, covariance=np.diag([0.0, 9e-6])),
    dataclasses.replace(TRAVEL, lever_m=-101.0),
    dataclasses.replace(TRAVEL, driven_s=0.0),
]


def parameters_in(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))["/**"]["ros__parameters"]


def test_parameters_have_the_names_of_the_contract():
    assert yaw_parameters(a_result(travel=TRAVEL)) == {
        "extrinsics.yaw_rad": -1 / 30,
        "extrinsics.yaw_std_rad": 0.002,
    }
    assert list(result_parameters(a_mount(travel=TRAVEL))) == list(result_parameters(a_mount()))


@pytest.mark.parametrize("travel", [None, NOT_KNOWN, *NO_NUMBERS])
def test_yaw_that_is_not_known_has_no_parameters(travel):
    assert yaw_parameters(a_result(travel=travel)) == {}


def test_yaw_is_beside_the_pose_and_how_it_was_reached_in_the_provenance(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, a_mount(travel=TRAVEL))
    parameters = parameters_in(path)
    assert list(parameters["extrinsics"])[-2:] == ["yaw_rad", "yaw_std_rad"]
    assert (parameters["extrinsics"]["yaw_rad"], parameters["extrinsics"]["yaw_std_rad"]) == (-1 / 30, 0.002)
    assert parameters["provenance"]["schema"] == 2
    assert parameters["provenance"]["travel"] == {
        "yaw_rad": -1 / 30,
        "pitch_rad": 1e-05,
        "covariance": [4e-6, -1e-7 / 3, -1e-7 / 3, 9e-6],
        "steps": 41,
        "lever_m": 4 / 3,
        "driven_s": 25.5,
    }
    said = evidence_parameters(a_mount(travel=TRAVEL))
    assert (said["provenance.travel.steps"], said["provenance.travel.yaw_rad"]) == (41, -1 / 30)


def test_equation_of_the_file_has_the_yaw_where_it_is_known():
    known, unknown = (
        format_result(a_mount(travel=travel), RIG, "bag", 7).splitlines()[0] for travel in (TRAVEL, NOT_KNOWN)
    )
    assert known == (
        "# p_vehicle = R_z(yaw) R_y(pitch) R_x(roll) p_camera + [mount.x_m, mount.y_m, height]"
        "   (REP-103: x forward, y left, z up; metres, radians)"
    )
    assert unknown == (
        "# p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height]"
        "   (REP-103: x forward, y left, z up; metres, radians)"
    )


@pytest.mark.parametrize("travel", [TRAVEL, NOT_KNOWN])
def test_restored_to_the_last_bit(tmp_path, travel):
    path, again = tmp_path / "out.yaml", tmp_path / "again.yaml"
    write(path, a_mount(travel=travel))
    restored = load_result(path).as_result()
    assert restored.travel is not None
    for item in dataclasses.fields(travel):
        np.testing.assert_array_equal(getattr(restored.travel, item.name), getattr(travel, item.name))
    assert ("yaw -1.9099 deg (std 0.1146)" in restored.message) is travel.tells_yaw
    write(again, restored)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("travel", [None, *NO_NUMBERS])
def test_what_has_no_numbers_is_not_written(tmp_path, travel):
    path = tmp_path / "out.yaml"
    write(path, a_mount(travel=travel))
    parameters = parameters_in(path)
    assert "travel" not in parameters["provenance"] and "yaw_rad" not in parameters["extrinsics"]
    assert load_result(path).as_result().travel is None


def test_schema_1_knows_no_travel(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, a_mount(travel=TRAVEL))
    path.write_text(path.read_text(encoding="utf-8").replace("schema: 2", "schema: 1"), encoding="utf-8")
    saved = load_result(path)
    assert saved.evidence.travel is None and "yaw" not in saved.as_result().message


FAULTS = [
    ("      yaw_rad: ", "      yaw: ", "extrinsics.yaw_rad is missing"),
    ("      yaw_std_rad: ", "      std: ", "extrinsics.yaw_std_rad is missing"),
    (
        "      yaw_rad: ",
        "      yaw_rad: 1.0 #",
        "extrinsics.yaw_rad is 1.0: it contradicts provenance.travel",
    ),
    ("      yaw_rad: ", "      yaw_rad: .nan #", "extrinsics.yaw_rad is nan: a finite number"),
    ("      yaw_std_rad: ", "      yaw_std_rad: 0.0021 #", "yaw_std_rad is 0.0021: it contradicts"),
    ("      travel:", "      journey:", "extrinsics.yaw_rad is .* provenance.travel does not tell it"),
    ("      travel:\n", "      travel: 3\n      other:\n", "provenance.travel is 3: the numbers of the"),
    ("        yaw_rad: ", "        yaw_rad: -1.6 #", "provenance.travel.yaw_rad is -1.6: it must lie in"),
    ("        yaw_rad: ", "        yaw_rad: .inf #", "provenance.travel.yaw_rad is inf: a finite"),
    ("        yaw_rad: ", "        yaw: ", "provenance.travel.yaw_rad is missing"),
    ("        pitch_rad: ", "        pitch_rad: '0' #", "provenance.travel.pitch_rad is '0': a finite"),
    ("covariance: [4.0e-06", "covariance: [-4.0e-06", "travel.covariance is .* variances greater than 0"),
    ("covariance: [4.0e-06", "covariance: [4.0", "provenance.travel.covariance is .* variances greater"),
    ("covariance: [4.0e-06, -3", "covariance: [4.0e-06, 3", "travel.covariance is .* no quantities vary"),
    ("covariance: [4.0e-06, ", "covariance: [", "travel.covariance is .* a list of 4 numbers"),
    ("covariance: [4.0e-06", "covariance: [4.0e-02", "it contradicts provenance.travel|does not tell it"),
    ("steps: 41", "steps: 0", "provenance.travel.steps is 0: it must lie in 1"),
    ("steps: 41", "steps: 41.5", "provenance.travel.steps is 41.5: a whole number"),
    ("lever_m: 1.3", "lever_m: 101.3", "provenance.travel.lever_m is 101.3.*: it must lie in"),
    ("driven_s: 25.5", "driven_s: 0.0", "provenance.travel.driven_s is 0.0: it must be greater than 0"),
    ("driven_s: 25.5", "driven_s: -1.0", "provenance.travel.driven_s is -1.0: it must lie in 0"),
]


@pytest.mark.parametrize(("old", "new", "words"), FAULTS)
def test_every_value_is_checked_on_loading(tmp_path, old, new, words):
    path = tmp_path / "out.yaml"
    write(path, a_mount(travel=TRAVEL, delay=None))
    text = path.read_text(encoding="utf-8")
    before = "\n" if old.startswith(" ") else ""  # the whole of a line's indentation
    assert before + old in text
    path.write_text(text.replace(before + old, before + new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"out\.yaml.*(?:{words}).*calibrate anew") as error:
        load_result(path)
    assert "\n" not in str(error.value)


changes = st.tuples(st.integers(0, 2500), st.integers(0, 12), st.binary(max_size=12))


@given(st.lists(changes, min_size=1, max_size=2))
def test_any_damage_is_told_or_harmless(tmp_path_factory, damage):
    """Whatever a few bytes become: a direction of travel that can be written again, or one sentence."""
    path = tmp_path_factory.getbasetemp() / "damaged_travel.yaml"
    content = format_result(a_mount(travel=TRAVEL), RIG, "bag", 7).encode()
    for start, length, added in damage:
        content = content[:start] + added + content[start + length :]
    path.write_bytes(content)
    try:
        saved = load_result(path)
    except ConfigError as error:
        assert "damaged_travel.yaml" in str(error) and "\n" not in str(error)
        return
    result = saved.as_result()
    if result.travel is not None:
        assert "yaw_rad" in format_result(result, saved.rig, "again", 0)
