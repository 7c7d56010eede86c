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

"""How a calibration was reached, in the result file: written, checked, restored, or not there."""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from result_making import COVARIANCE, DELAY, MOUNT, RIG, TERMS, TRAVEL, a_mount, a_result, write

from stereo_selfcal import ConfigError
from stereo_selfcal.core.delay_report import describe_delay
from stereo_selfcal.core.drive.targets import Targets
from stereo_selfcal.core.geometry.travel import RightDelay
from stereo_selfcal.core.geometry.uncertainty import TERMS as NAMES
from stereo_selfcal.core.geometry.uncertainty import UncertaintyTerm, total_covariance
from stereo_selfcal.files import result_file, saved_result
from stereo_selfcal.files.result_file import format_result, load_result
from stereo_selfcal.report.mount import how_reached

ASKED = Targets(0.015, 0.0026, 0.0061, 3)


def provenance_in(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))["/**"]["ros__parameters"]["provenance"]


def scalars_and_lists(values, name=""):
    """Yield every parameter of a section by its dotted name."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from scalars_and_lists(value, f"{name}{key}.")
        else:
            yield f"{name}{key}", value


def test_sections_of_a_drive(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, a_mount(travel=TRAVEL), targets=ASKED)
    provenance = provenance_in(path)
    assert provenance["schema"] == 2
    assert list(provenance)[-5:] == ["terms", "mount", "travel", "delay", "targets"]
    assert list(provenance["terms"]) == ["noise", "motion"]
    np.testing.assert_allclose(np.sum(list(provenance["terms"].values()), axis=0), COVARIANCE.ravel())
    assert provenance["mount"] == {
        "duration_s": 100 / 3,
        "outliers": 1,
        "known_starts": 2,
        "stood": False,
        "motion": {"height_std_m": 0.005, "pitch_std_rad": 1 / 300, "roll_std_rad": 0.0035},
        "memory_s": [1.5, 4 / 3, 2.0],
        "looks": [10.0, 11.5, 7.25],
    }
    assert provenance["delay"] == {
        "delay_s": -1 / 3000,
        "delay_std_s": 2e-4,
        "offset_m": 1e-5,
        "offset_std_m": 5e-3,
        "covariance": [4e-8, -1e-8, -1e-8, 2.5e-5],
        "frames": 3,
        "speeds_mps": [2.5, 14 / 3],
    }
    assert provenance["targets"] == {
        "height_std_m": 0.015,
        "pitch_std_rad": 0.0026,
        "roll_std_rad": 0.0061,
        "frames": 3,
        "reached": True,
    }


def test_every_parameter_is_one_that_ros_knows(tmp_path):
    """Scalars, and lists of one kind of them in one line; a float has a point, or rcl takes it for text."""
    path = tmp_path / "out.yaml"
    write(path, a_mount(travel=TRAVEL), targets=ASKED)
    for name, value in scalars_and_lists(provenance_in(path)):
        if isinstance(value, list):
            assert value and all(type(each) is float for each in value), name
        else:
            assert type(value) in (bool, int, float, str), name
    for line in path.read_text(encoding="utf-8").splitlines():
        for word in line.replace("[", " ").replace("]", " ").replace(",", " ").split():
            assert "e" not in word or not word[0].isdigit() or "." in word, f"{word} is text to rcl"


def test_restored_to_the_last_bit(tmp_path):
    path, again = tmp_path / "out.yaml", tmp_path / "again.yaml"
    write(path, a_mount(), targets=ASKED)
    saved = load_result(path)
    assert (saved.schema, saved.is_of_mount, saved.evidence.targets) == (2, True, ASKED)
    restored = saved.as_result()
    assert [term.name for term in restored.uncertainty] == ["noise", "motion"]
    for term, written in zip(restored.uncertainty, TERMS, strict=True):
        np.testing.assert_array_equal(term.covariance, written.covariance)
    assert vars_of(restored.mount) == vars_of(MOUNT)
    assert vars_of(restored.delay) == vars_of(DELAY)
    write(again, restored, targets=ASKED)
    assert again.read_bytes() == path.read_bytes()


def vars_of(value):
    return {
        item.name: np.asarray(found).tolist() if isinstance(found, np.ndarray) else found
        for item in dataclasses.fields(value)
        for found in [getattr(value, item.name)]
    }


def test_file_with_every_term_is_far_below_its_limit():
    std = np.sqrt(np.diagonal(COVARIANCE))
    part = np.outer(std, std) / 3 + np.diag(std**2) * 2 / 3
    terms = tuple(UncertaintyTerm(name, part) for name in NAMES)
    result = a_mount(travel=TRAVEL, uncertainty=terms, covariance=total_covariance(terms))
    size = len(format_result(result, RIG, "/left/image_rect /right/image_rect", 7, ASKED).encode())
    assert size < result_file._MOST_BYTES / 4


@pytest.mark.parametrize(("asked", "reached"), [(Targets(0.0009, 0.0, 0.0), False), (Targets(), True)])
def test_targets_are_said_to_be_reached_or_not(tmp_path, asked, reached):
    path = tmp_path / "out.yaml"
    write(path, a_mount(), targets=asked)
    assert provenance_in(path)["targets"]["reached"] is reached
    assert load_result(path).evidence.targets == asked


def test_what_is_not_known_has_no_section(tmp_path):
    path = tmp_path / "out.yaml"
    endless = dataclasses.replace(MOUNT, memory_s=np.array([1.0, math.inf, 1.0]))
    late = RightDelay(11.0, 0.0, np.diag([1.0, 1.0]), 3, (0.0, 0.0))
    write(path, a_result(mount=endless, delay=late))
    assert not {"terms", "mount", "delay", "targets"} & set(provenance_in(path))
    saved = load_result(path)
    assert not saved.is_of_mount
    restored = saved.as_result()
    assert (restored.uncertainty, restored.mount, restored.delay) == ((), None, None)


def test_schema_1_is_read_and_its_standard_deviations_are_of_what_is_not_known(tmp_path):
    """As written by an earlier version; whatever stands in it under a new name is none of ours."""
    path = tmp_path / "out.yaml"
    write(path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("schema: 2", "schema: 1\n      mount: by hand"), encoding="utf-8")
    saved = load_result(path)
    assert (saved.schema, saved.is_of_mount, saved.provenance["mount"]) == (1, False, "by hand")
    restored = saved.as_result()
    assert restored.mount is None and restored.uncertainty == ()
    np.testing.assert_array_equal(restored.covariance, COVARIANCE)
    assert restored.message.endswith(
        "; written by an earlier version, whose standard deviation may be that of one moment"
    )


def test_a_program_of_schema_1_refuses_schema_2_by_its_number(tmp_path, monkeypatch):
    """The check of an earlier version was the same, with its own number."""
    path = tmp_path / "out.yaml"
    write(path, a_mount())
    monkeypatch.setattr(saved_result, "SCHEMA", 1)
    with pytest.raises(ConfigError, match="its schema is 2, this version reads at most 1; update"):
        load_result(path)


FAULTS = [
    (
        "terms:\n",
        "terms: 3\n      other:\n",
        "provenance.terms is 3: the causes of the uncertainty are needed",
    ),
    ("        noise: [7.5", "        noise: [7.6", "terms is .* they do not add up to provenance.covariance"),
    ("        noise: [", "        noise: 3 #", "provenance.terms.noise is 3: a list of 9 numbers is needed"),
    ("        noise: [7.5", "        noise: [-7.5", "provenance.terms.noise is .* no quantities vary"),
    ("        noise: [7.5e-07", "        noise: [.nan", "provenance.terms.noise is nan: a finite number"),
    ("        noise: ", "        No Ise: ", "name of a cause in provenance.terms is 'No Ise': a word in"),
    (
        "mount:\n",
        "mount: fine\n      other:\n",
        "provenance.mount is 'fine': the facts of the drive are needed",
    ),
    ("duration_s: 33", "duration_s: -33", "provenance.mount.duration_s is -33.3.*: it must lie in 0"),
    ("duration_s: ", "duration: ", "provenance.mount.duration_s is missing"),
    ("outliers: 1", "outliers: 1.5", "provenance.mount.outliers is 1.5: a whole number is needed"),
    ("known_starts: 2", "known_starts: 5", "provenance.mount.known_starts is 5: it must lie in 0 ... 4"),
    ("stood: false", "stood: 0", "provenance.mount.stood is 0: true or false is needed"),
    ("motion:\n", "motion: 3\n        other:\n", "provenance.mount.motion is 3: the standard deviations"),
    (
        "height_std_m: 0.005",
        "height_std_m: 50.0",
        "mount.motion.height_std_m is 50.0: it must lie in 0 ... 20",
    ),
    ("roll_std_rad: 0.0035", "roll: 0.0035", "provenance.mount.motion.roll_std_rad is missing"),
    ("memory_s: [1.5", "memory_s: [-1.5", "provenance.mount.memory_s is -1.5: it must lie in 0"),
    ("memory_s: [1.5, ", "memory_s: [", "provenance.mount.memory_s is .* a list of 3 numbers"),
    ("looks: [10.0", "looks: [ten", "provenance.mount.looks is 'ten': a finite number"),
    ("delay:\n", "delay: 3\n      other:\n", "provenance.delay is 3: the numbers of the delay are needed"),
    ("delay_s: -0.0003", "delay_s: -11.0003", "provenance.delay.delay_s is -11.0.* -10 ... 10 s"),
    ("delay_std_s: ", "delay_std_s: 0.0 #", "provenance.delay.delay_std_s is 0.0: .* greater than 0"),
    ("offset_m: 1.0e-05", "offset_m: 101.0", "provenance.delay.offset_m is 101.0: it must lie in"),
    ("offset_std_m: ", "offset_std_m: 2", "provenance.delay.covariance is .* contradicts the standard"),
    ("covariance: [4.0e-08", "covariance: [4.1e-08", "provenance.delay.covariance is .* contradicts"),
    ("speeds_mps: [2.5", "speeds_mps: [25.0", "provenance.delay.speeds_mps is .* the least and the greatest"),
    ("speeds_mps: [", "speeds_mps: 3 #", "provenance.delay.speeds_mps is 3: a list of 2 numbers"),
    (
        "targets:\n",
        "targets: 3\n      other:\n",
        "provenance.targets is 3: the standard deviations that were asked",
    ),
    ("height_std_m: 0.015", "height_std_m: -0.015", "provenance.targets.height_std_m is -0.015"),
    ("reached: true", "reached: false", "provenance.targets.reached is False: it contradicts the standard"),
    ("reached: true", "reached: 'yes'", "provenance.targets.reached is 'yes': true or false"),
]


@pytest.mark.parametrize(("old", "new", "words"), FAULTS)
def test_every_value_is_checked_on_loading(tmp_path, old, new, words):
    path = tmp_path / "out.yaml"
    write(path, a_mount(), targets=ASKED)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"out\.yaml.*(?:{words}).*calibrate anew") as error:
        load_result(path)
    assert "\n" not in str(error.value)


def test_term_of_a_later_version_is_read(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, a_mount())
    path.write_text(path.read_text(encoding="utf-8").replace("motion: [", "wind: ["), encoding="utf-8")
    assert [term.name for term in load_result(path).as_result().uncertainty] == ["noise", "wind"]


changes = st.tuples(st.integers(0, 3500), st.integers(0, 12), st.binary(max_size=12))


@given(st.lists(changes, min_size=1, max_size=2))
def test_any_damage_is_told_or_harmless(tmp_path_factory, damage):
    """Whatever a few bytes become: evidence that can be told and written again, or one sentence."""
    path = tmp_path_factory.getbasetemp() / "damaged_evidence.yaml"
    content = format_result(a_mount(), RIG, "bag", 7, ASKED).encode()
    for start, length, added in damage:
        content = content[:start] + added + content[start + length :]
    path.write_bytes(content)
    try:
        saved = load_result(path)
    except ConfigError as error:
        assert "damaged_evidence.yaml" in str(error) and "\n" not in str(error)
        return
    result = saved.as_result()
    if result.uncertainty:
        std = result.std.as_array()
        left = total_covariance(result.uncertainty) - result.covariance
        assert np.all(np.abs(left) <= 2e-6 * np.outer(std, std))
    if result.mount is not None:
        how_reached(result.mount, result.n_frames)
        assert min(result.mount.memory_s.min(), result.mount.looks.min(), result.mount.duration_s) >= 0.0
    if result.delay is not None:
        assert describe_delay(result.delay)
    format_result(result, saved.rig, "again", 0, saved.evidence.targets)
