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

"""Every field of a result file is checked, and a saved result is the one that was written."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from result_making import RIG, a_result, write

from stereo_selfcal import ConfigError, StereoRig, __version__
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.core.reservations import Reservation, ReservationKind
from stereo_selfcal.files.result_file import format_result, load_result, result_parameters
from stereo_selfcal.files.saved_result import check_fits


def a_file(path, old="", new=""):
    """Write a result file with one thing changed in it."""
    write(path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


# What is there, what it becomes, what the sentence says of it.
FAULTS = [
    ("height_m: 0.3", "height: 0.3", "extrinsics.height_m is missing"),
    ("roll_std_rad: ", "roll: ", "extrinsics.roll_std_rad is missing"),
    ("height_m: 0.3", "height_m: .nan #", "extrinsics.height_m is nan: a finite number is needed"),
    ("height_m: 0.3", "height_m: .inf #", "extrinsics.height_m is inf: a finite number"),
    ("height_m: 0.3", "height_m: -0.3", "extrinsics.height_m is -0.33.*must lie in 0.05 ... 20 m"),
    ("height_m: 0.3", "height_m: 20.1 #", "extrinsics.height_m is 20.1: it must lie in"),
    ("height_m: 0.3", "height_m: true #", "extrinsics.height_m is True: a finite number is needed"),
    ("height_m: 0.3", "height_m: [0.3] #", r"extrinsics.height_m is \[0.3\]: a finite number"),
    ("pitch_rad: ", "pitch_rad: 1.05 #", "extrinsics.pitch_rad is 1.05: .* -1.0472 ... 1.0472 rad"),
    ("roll_rad: ", "roll_rad: -1.05 #", "extrinsics.roll_rad is -1.05: it must lie in"),
    ("roll_rad: ", "roll_rad: abc #", "extrinsics.roll_rad is 'abc': a finite number"),
    ("roll_rad: ", "roll_rad: #", "extrinsics.roll_rad is None: a finite number"),
    ("height_std_m: ", "height_std_m: -", "extrinsics.height_std_m is -0.001"),
    ("pitch_std_rad: ", "pitch_std_rad: 0.0 #", "extrinsics.pitch_std_rad is 0.0: .* greater than 0"),
    ("roll_std_rad: ", "roll_std_rad: 2.0 #", "extrinsics.roll_std_rad is 2.0: it must lie in"),
    (
        "schema: 2",
        "schema: 3",
        rf"by a newer version .'{re.escape(__version__)}'.* schema is 3, this version reads at most 2",
    ),
    ("schema: 2", "schema: 0", "provenance.schema is 0: it must lie in 1"),
    ("schema: 2", "schema: '2'", "provenance.schema is '2': a whole number is needed"),
    ("schema: 2", "scheme: 2", "provenance.schema is missing"),
    ("stamp: ", "stamp: .nan #", "provenance.stamp is nan"),
    ("stamp: ", "stamp: .inf #", "provenance.stamp is inf: a finite number is needed"),
    ("stamp: ", "stamp: -.inf #", "provenance.stamp is -inf: a finite number is needed"),
    ("stamp: ", "stamp: nan #", "provenance.stamp is 'nan': a finite number is needed"),
    ("stamp: ", "stamp: '5' #", "provenance.stamp is '5': a finite number is needed"),
    ("stamp: ", "stamp: 2200000000.0 #", "provenance.stamp is 2200000000.0: it must lie in"),
    ("stamp: ", "stamp: 1e300 #", "provenance.stamp is 1e.300: it must lie in"),
    ("frames: 3", "frames: 0", "provenance.frames is 0: it must lie in 1"),
    ("frames: 3", "frames: 3.5", "provenance.frames is 3.5: a whole number is needed"),
    ("seed: 7", "seed: -1", "provenance.seed is -1"),
    ("seed: 7", "seed: true", "provenance.seed is True"),
    ("source: ", "source: 5 #", "provenance.source is 5: text is needed"),
    ("version: ", "versions: ", "provenance.version is missing"),
    ("baseline_m: 0.1481", "baseline_m: 0.0", "provenance.rig.baseline_m is 0.0"),
    ("width: 640", "wide: 640", "provenance.rig lacks width and has unknown wide"),
    ("fx: 516.6", "fx: '516.6'", "provenance.rig.fx is '516.6', a number"),
    ("cx: 319.5", "cx: 700.0", "provenance.principal point .700.0, 239.5. lies outside"),
    ("rig:", "rag:", "provenance.rig is None: the values of the rig are needed"),
    ("covariance: [1.0e-06", "covariance: [1.1e-06", "covariance .* contradicts the standard deviations"),
    ("covariance: [1.0e-06, 0.0", "covariance: [1.0e-06, 1.0e-08", "covariance .* no quantities vary"),
    ("covariance: [1.0e-06", "covariance: [.nan", "provenance.covariance is nan: a finite number"),
    ("covariance: [1.0e-06, ", "covariance: [", "covariance is .* a list of 9 numbers"),
    ("covariance: [", "covariance: 3 #", "covariance is 3: a list of 9 numbers"),
    ("extrinsics:", "[", "not YAML in line"),
    ("extrinsics:", "extrinsic:", "no result file of stereo_selfcal"),
    ("/**:", "/other:", "no parameter file"),
    ("ros__parameters", "parameters", "has no 'ros__parameters:'"),
]


@pytest.mark.parametrize(("old", "new", "words"), FAULTS)
def test_every_value_is_checked_on_loading(tmp_path, old, new, words):
    a_file(tmp_path / "out.yaml", old, new)
    with pytest.raises(ConfigError, match=rf"out\.yaml.*(?:{words})") as error:
        load_result(tmp_path / "out.yaml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("height_m: 0.3333333333333333", "height_m: 0.05"),
        ("height_m: 0.3333333333333333", "height_m: 20"),
        ("pitch_rad: 1.0e-05", "pitch_rad: 1e-05"),  # text to YAML 1.1, a number to rcl
        ("pitch_rad: 1.0e-05", "pitch_rad: -1.0471"),
        ("    provenance:", "      comment: a word\n    provenance:"),
        ("      schema: 2", "      schema: 2\n      operator: somebody"),
    ],
)
def test_values_at_the_edge_and_additions_are_read(tmp_path, old, new):
    a_file(tmp_path / "out.yaml", old, new)
    load_result(tmp_path / "out.yaml")


def test_file_without_covariance_has_that_of_its_standard_deviations(tmp_path):
    """As written before the file had one."""
    a_file(tmp_path / "out.yaml", "covariance: ", "other: ")
    saved = load_result(tmp_path / "out.yaml")
    np.testing.assert_array_equal(saved.covariance, np.diag(saved.std.as_array() ** 2))
    assert saved.as_result().std == saved.std


CORRELATED = np.array([[1e-6, 3e-9, -1e-8], [3e-9, 1e-10, 2e-10], [-1e-8, 2e-10, 4e-8]])


def test_saved_result_is_the_result_that_was_written(tmp_path):
    """Published again after the next start, it must be the same to the last bit."""
    result = a_result(covariance=CORRELATED)
    write(tmp_path / "out.yaml", result)
    saved = load_result(tmp_path / "out.yaml")
    again = saved.as_result()
    assert again.accepted
    assert result_parameters(again) == result_parameters(result)
    np.testing.assert_array_equal(again.covariance, CORRELATED)
    assert (again.stamp_s, again.n_frames) == (result.stamp_s, result.n_frames)
    assert abs(saved.stamp_ns - 1_700_000_000_123_456_789) < 1000
    assert again.message.startswith("calibrated on 2023-11-14 22:13:20 UTC from 3 frames: height 0.3333 m")
    text = (tmp_path / "out.yaml").read_text(encoding="utf-8")
    write(tmp_path / "again.yaml", again)
    assert (tmp_path / "again.yaml").read_text(encoding="utf-8") == text


def test_stamp_of_a_simulation_is_no_date(tmp_path):
    write(tmp_path / "out.yaml", a_result(stamp_s=100.4, n_frames=1))
    message = load_result(tmp_path / "out.yaml").as_result().message
    assert message.startswith("calibrated at 100.400 s from 1 frame: height")


def test_rig_that_is_the_same_but_for_rounding_fits(tmp_path):
    write(tmp_path / "out.yaml")
    saved = load_result(tmp_path / "out.yaml")
    check_fits(saved.rig, RIG)
    check_fits(saved.rig, StereoRig(640, 480, 516.6009, 516.5991, 319.5009, 239.4991, 0.148114))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 641}, "rig.width was 640, now it is 641 .a difference of at most 0 is"),
        ({"height": 479}, "rig.height was 480, now it is 479"),
        ({"fx": 516.611}, "rig.fx was 516.6, now it is 516.611 .a difference of at most 0.01 is"),
        ({"fy": 516.589}, "rig.fy was 516.6, now it is 516.589"),
        ({"cx": 319.511}, "rig.cx was"),
        ({"cy": 239.489}, "rig.cy was"),
        ({"baseline_m": 0.14812}, "rig.baseline_m was 0.1481, now it is 0.14812"),
        ({"baseline_m": 0.14808}, "rig.baseline_m was 0.1481, now it is 0.14808"),
    ],
)
def test_other_cameras_are_told_with_both_values(tmp_path, change, words):
    write(tmp_path / "out.yaml")
    with pytest.raises(ConfigError, match=f"of other cameras: {words}.*; calibrate anew"):
        check_fits(load_result(tmp_path / "out.yaml").rig, dataclasses.replace(RIG, **change))


changes = st.tuples(st.integers(0, 1000), st.integers(0, 20), st.binary(max_size=20))


@given(st.lists(changes, min_size=1, max_size=3))
def test_any_damage_is_told_or_harmless(tmp_path_factory, damage):
    """Whatever a few bytes become: a calibration within its ranges, or one sentence."""
    path = tmp_path_factory.getbasetemp() / "damaged.yaml"
    content = format_result(a_result(), RIG, "bag", 7).encode()
    for start, length, added in damage:
        content = content[:start] + added + content[start + length :]
    path.write_bytes(content)
    try:
        saved = load_result(path)
    except ConfigError as error:
        assert "damaged.yaml" in str(error) and "\n" not in str(error)
    else:
        assert 0.05 <= saved.extrinsics.height_m <= 20.0
        assert all(abs(angle) < math.pi / 3 for angle in saved.extrinsics.as_array()[1:])
        assert np.all(saved.std.as_array() > 0)
        result_parameters(saved.as_result())


@pytest.mark.parametrize("stamp_s", [math.nan, math.inf, -math.inf, 1e300])
def test_a_stamp_that_is_none_is_not_written(tmp_path, stamp_s):
    write(tmp_path / "out.yaml")
    before = (tmp_path / "out.yaml").read_bytes()
    with pytest.raises(OutputError, match=r"not written: provenance\.stamp is"):
        write(tmp_path / "out.yaml", a_result(stamp_s=stamp_s))
    assert (tmp_path / "out.yaml").read_bytes() == before


def test_reservations_are_kept_with_the_frames_they_hold_for(tmp_path):
    path = tmp_path / "result.yaml"
    kept = (
        Reservation(ReservationKind.NOT_CHECKED_BY_TEXTURE, "too little texture", 3),
        Reservation(ReservationKind.KERB_NOT_EXCLUDED),
    )
    path.write_text(
        format_result(dataclasses.replace(a_result(), reservations=kept), RIG, "bag", 7), encoding="utf-8"
    )
    again = load_result(path).as_result()
    assert again.reservations == kept and again.with_reservations
    assert again.message.endswith(f"; {kept[0].sentence} (3 of 3 frames); {kept[1].sentence} (1 of 3 frames)")
    path.write_text(path.read_text().replace("kerb_not_excluded", "of_no_kind"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"provenance\.reservations: 'of_no_kind' .* none that is known"):
        load_result(path)
