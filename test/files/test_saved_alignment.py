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

"""The alignment of the right camera in the result file: written, checked, restored, or not there."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from result_making import a_result, write

from stereo_selfcal import CalibratorConfig, ConfigError
from stereo_selfcal.core.geometry.alignment import Alignment
from stereo_selfcal.files.parameter_file import load_calibrator_config
from stereo_selfcal.files.result_file import alignment_parameters, load_result, result_parameters

COVARIANCE = np.array([[4e-10, 1e-11, 0.0], [1e-11, 9e-10, -2e-11], [0.0, -2e-11, 3e-8]])
ALIGNMENT = Alignment(1e-4, -1 / 3000, 0.0024, COVARIANCE)


def parameters_in(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))["/**"]["ros__parameters"]


def test_section_has_the_names_of_the_contract(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, a_result(alignment=ALIGNMENT))
    parameters = parameters_in(path)
    assert list(parameters) == ["extrinsics", "alignment", "provenance"]
    assert parameters["alignment"] == {
        "pitch_rad": 1e-4,
        "roll_rad": -1 / 3000,
        "yaw_rad": 0.0024,
        "pitch_std_rad": math.sqrt(4e-10),
        "roll_std_rad": math.sqrt(9e-10),
        "yaw_std_rad": math.sqrt(3e-8),
    }
    assert all(isinstance(value, float) for value in parameters["alignment"].values())
    assert list(alignment_parameters(a_result(alignment=ALIGNMENT))) == [
        f"alignment.{name}" for name in parameters["alignment"]
    ]


@pytest.mark.parametrize("unexplained_rad", [0.0, 1 / 3000])
def test_restored_to_the_last_bit(tmp_path, unexplained_rad):
    path, again = tmp_path / "out.yaml", tmp_path / "again.yaml"
    written = dataclasses.replace(ALIGNMENT, unexplained_rad=unexplained_rad)
    write(path, a_result(alignment=written))
    restored = load_result(path).as_result()
    assert np.array_equal(restored.alignment.as_array(), ALIGNMENT.as_array())
    assert np.array_equal(restored.alignment.covariance, COVARIANCE)
    assert restored.alignment.unexplained_rad == unexplained_rad
    write(again, restored)
    assert again.read_bytes() == path.read_bytes()


def test_file_without_it_is_read(tmp_path):
    write(tmp_path / "out.yaml")
    assert "alignment" not in (tmp_path / "out.yaml").read_text(encoding="utf-8")
    saved = load_result(tmp_path / "out.yaml")
    assert saved.alignment is None
    assert saved.as_result().alignment is None
    assert alignment_parameters(saved.as_result()) == {}


def test_what_is_not_seen_has_no_value(tmp_path):
    covariance = np.diag([4e-10, 9e-10, math.inf])
    write(tmp_path / "out.yaml", a_result(alignment=Alignment(1e-4, 2e-4, 0.0, covariance)))
    section = parameters_in(tmp_path / "out.yaml")["alignment"]
    assert list(section) == ["pitch_rad", "roll_rad", "pitch_std_rad", "roll_std_rad"]
    restored = load_result(tmp_path / "out.yaml").alignment
    assert np.allclose(restored.std, [2e-5, 3e-5, math.inf])


@pytest.mark.parametrize("nothing", [np.diag([math.inf] * 3), np.eye(3), np.full((3, 3), math.nan)])
def test_nothing_known_is_not_written(tmp_path, nothing):
    write(tmp_path / "out.yaml", a_result(alignment=Alignment(0.0, 0.0, 0.0, nothing)))
    assert "alignment" not in (tmp_path / "out.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("      yaw_std_rad: ", "      yaw_std: ", "alignment.yaw_std_rad is missing"),
        ("      yaw_rad: ", "      yaw: ", "alignment.yaw_rad is missing"),
        ("yaw_rad: 0.0024", "yaw_rad: .nan", "alignment.yaw_rad is nan: a finite number"),
        ("yaw_rad: 0.0024", "yaw_rad: 0.6", "alignment.yaw_rad is 0.6: it must lie in -0.5 ... 0.5 rad"),
        ("yaw_rad: 0.0024", "yaw_rad: true", "alignment.yaw_rad is True: a finite number"),
        ("yaw_std_rad: ", "yaw_std_rad: 0.0 #", "alignment.yaw_std_rad is 0.0: it must be greater than 0"),
        ("yaw_std_rad: ", "yaw_std_rad: -", "alignment.yaw_std_rad is -0.0001"),
        ("    alignment:\n", "    alignment: 5\n    other:\n", "alignment is 5: the angles of the right"),
        ("alignment_covariance: [4.0e-10", "alignment_covariance: [5.0e-10", "contradicts the standard"),
        ("alignment_covariance: [", "alignment_covariance: 3 #", "alignment_covariance is 3: a list of 9"),
    ],
)
def test_every_value_is_checked_on_loading(tmp_path, old, new, words):
    path = tmp_path / "out.yaml"
    write(path, a_result(alignment=ALIGNMENT))
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"out\.yaml.*(?:{words})"):
        load_result(path)


def test_it_is_no_setting_of_the_calibrator(tmp_path):
    """A result file beside settings: alignment.correct is one, alignment.yaw_rad is not."""
    path = tmp_path / "out.yaml"
    write(path, a_result(alignment=ALIGNMENT))
    assert load_calibrator_config(path) == CalibratorConfig()
    text = path.read_text(encoding="utf-8").replace(
        "    alignment:\n", "    alignment:\n      correct: all\n"
    )
    path.write_text(text, encoding="utf-8")
    assert load_calibrator_config(path).alignment.correct == "all"
    assert load_result(path).alignment.yaw_rad == 0.0024


def test_extrinsics_are_as_before():
    assert list(result_parameters(a_result(alignment=ALIGNMENT))) == list(result_parameters(a_result()))
