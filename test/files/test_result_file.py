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

"""The result file: a ROS 2 parameter file, whole or not at all, the same bytes for the same result."""

import dataclasses
import math
import os

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from result_making import EXTRINSICS, RIG, a_result, write

from stereo_selfcal import Extrinsics, __version__
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.results import rejected
from stereo_selfcal.files import result_file
from stereo_selfcal.files.result_file import (
    Restored,
    format_result,
    load_result,
    restore,
    restore_old_default,
    result_parameters,
)


def a_rejection():
    return rejected(
        Rejection(RejectReason.NO_LINES_FOUND, "lines found", 0, Bound.LEAST, 2, "", "look at the road")
    )


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_shape_is_that_of_the_contract(tmp_path):
    path = tmp_path / "out.yaml"
    write(path)
    text = path.read_text(encoding="utf-8")
    first, second = text.splitlines()[:2]
    assert first.startswith("# p_road = R_z(0) R_y(pitch) R_x(roll) p_camera + [0, 0, height]")
    assert "REP-103" in first and second == "/**:"
    document = yaml.safe_load(text)
    assert list(document) == ["/**"] and list(document["/**"]) == ["ros__parameters"]
    parameters = document["/**"]["ros__parameters"]
    assert parameters["extrinsics"] == {
        "height_m": 1 / 3,
        "pitch_rad": 1e-05,
        "roll_rad": -2 / 7,
        "height_std_m": math.sqrt(1e-6),
        "pitch_std_rad": math.sqrt(1e-10),
        "roll_std_rad": math.sqrt(4e-8),
    }
    assert all(isinstance(value, float) for value in parameters["extrinsics"].values())
    assert parameters["provenance"] == {
        "schema": 2,
        "stamp": 1_700_000_000.123456789,
        "source": "bags/straight_road",
        "frames": 3,
        "seed": 7,
        "version": __version__,
        "rig": dataclasses.asdict(RIG),
        "covariance": [1e-6, 0.0, 0.0, 0.0, 1e-10, 0.0, 0.0, 0.0, 4e-8],
    }
    assert "      covariance: [1.0e-06, 0.0, 0.0, " in text, "in one line, all of them floats to rcl"


def test_parameters_have_the_names_of_the_contract():
    assert list(result_parameters(a_result())) == [
        "extrinsics.height_m",
        "extrinsics.pitch_rad",
        "extrinsics.roll_rad",
        "extrinsics.height_std_m",
        "extrinsics.pitch_std_rad",
        "extrinsics.roll_std_rad",
    ]


def test_same_result_same_bytes():
    assert format_result(a_result(), RIG, "bag", 0) == format_result(a_result(), RIG, "bag", 0)


angles = st.floats(-1.04, 1.04)


@given(st.floats(0.05, 20), angles, angles, st.floats(1e-20, 1.0), st.text(max_size=20))
def test_round_trip_to_the_last_bit(tmp_path_factory, height, pitch, roll, variance, source):
    path = tmp_path_factory.mktemp("round") / "out.yaml"
    result = a_result(extrinsics=Extrinsics(height, pitch, roll), covariance=np.diag([variance] * 3))
    write(path, result, source)
    saved = load_result(path)
    assert saved.extrinsics == result.extrinsics
    assert saved.std == result.std
    assert saved.rig == RIG
    assert saved.provenance["frames"] == 3
    assert saved.provenance["source"] == source.encode("utf-8", "backslashreplace").decode()


def test_source_of_any_length_can_be_read_again(tmp_path):
    write(tmp_path / "out.yaml", source="\udce9" * 100_000)
    assert load_result(tmp_path / "out.yaml").extrinsics == EXTRINSICS


@pytest.mark.parametrize(
    "source", ["1e5", "true", "null", "a: b", "# x", "a\nb", "~", "caf\udce9", "路", "😀", '"', "'"]
)
def test_any_source_stays_one_line_of_text(tmp_path, source):
    write(tmp_path / "out.yaml", source=source)
    read = load_result(tmp_path / "out.yaml").provenance["source"]
    assert read == source.encode("utf-8", "backslashreplace").decode()
    (line,) = [x for x in (tmp_path / "out.yaml").read_text(encoding="utf-8").splitlines() if "source" in x]
    assert line.split(": ", 1)[1].startswith('"')


@pytest.mark.parametrize(
    "result",
    [
        a_rejection(),
        a_result(extrinsics=Extrinsics(math.nan, 0.0, 0.0)),
        a_result(covariance=np.diag([math.inf, 1, 1])),
        a_result(covariance=None),
        a_result(extrinsics=Extrinsics(21.0, 0.0, 0.0)),
        a_result(extrinsics=Extrinsics(1.4, 0.0, -1.1)),
        a_result(covariance=np.diag([0.0, 1e-10, 1e-10])),
        a_result(covariance=np.full((3, 3), 1e-6) - 2e-6 * (1 - np.eye(3))),
        a_result(n_frames=0),
        a_result(stamp_s=math.nan),
    ],
)
def test_nothing_but_what_can_be_read_again_is_written(tmp_path, result):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    with pytest.raises(OutputError):
        write(path, result)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_file_replaces_the_old_one_and_leaves_nothing_beside_it(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text("old")
    write(path)
    assert load_result(path).extrinsics == EXTRINSICS
    assert list(tmp_path.iterdir()) == [path]


def test_full_disk_leaves_the_last_calibration(tmp_path, monkeypatch):
    def fail(*_args):
        raise OSError(28, "No space left on device")

    write(tmp_path / "out.yaml")
    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OutputError, match=r"out\.yaml cannot be written: no space left"):
        write(tmp_path / "out.yaml", a_result(n_frames=9))
    assert load_result(tmp_path / "out.yaml").n_frames == 3
    assert names(tmp_path) == ["out.yaml"]


def test_another_file_is_replaced_or_kept_aside_as_asked(tmp_path):
    path = tmp_path / "out.yaml"
    path.write_text("/other: {ros__parameters: {}}")
    write(path, keep_others=True)
    assert load_result(path).extrinsics == EXTRINSICS
    assert (tmp_path / "out.yaml.rejected").read_text() == "/other: {ros__parameters: {}}"
    write(path, a_result(n_frames=4), keep_others=True)
    assert load_result(path).n_frames == 4
    assert names(tmp_path) == ["out.yaml", "out.yaml.rejected"]


FRONT = ("/front/left/image_rect", "/front/right/image_rect")
REAR = ("/rear/left/image_rect", "/rear/right/image_rect")


def test_result_of_other_topics_is_not_restored_and_stays_and_both_topics_are_named(tmp_path):
    """Two pairs of one make have the same rig to the last digit."""
    path = tmp_path / "out.yaml"
    write(path, source=" ".join(FRONT))
    restored = restore(path, REAR)
    assert (restored.saved, restored.kept_aside, restored.of_others) == (None, None, True)
    assert all(topic in restored.problem for topic in (*FRONT, *REAR, str(path)))
    assert names(tmp_path) == ["out.yaml"]
    assert restore(path, FRONT).saved.extrinsics == EXTRINSICS


def test_images_and_the_same_ones_compressed_are_the_same_source(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, source=" ".join(f"{topic}/compressed" for topic in FRONT))
    assert restore(path, FRONT).saved is not None


def test_exchanged_topics_are_other_topics(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, source=" ".join(reversed(FRONT)))
    assert restore(path, FRONT).saved is None


@pytest.mark.parametrize("source", ["straight_road", "/data/two words", "", "by hand", "/one_topic"])
def test_result_that_names_no_topics_is_restored(tmp_path, source):
    path = tmp_path / "out.yaml"
    write(path, source=source)
    assert restore(path, FRONT).saved.extrinsics == EXTRINSICS


def test_result_of_other_topics_is_kept_aside_before_another_takes_its_place(tmp_path):
    path = tmp_path / "out.yaml"
    write(path, source=" ".join(FRONT))
    before = path.read_bytes()
    write(path, source=" ".join(REAR), keep_others=True)
    assert (tmp_path / "out.yaml.rejected").read_bytes() == before
    write(path, a_result(n_frames=4), source=" ".join(REAR), keep_others=True)
    assert names(tmp_path) == ["out.yaml", "out.yaml.rejected"]


def test_old_default_file_is_restored_where_it_says_that_it_is_of_these_topics(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert restore_old_default(FRONT) == Restored()
    path = tmp_path / ".ros" / "stereo_selfcal.yaml"
    path.parent.mkdir()
    write(path, source=" ".join(FRONT))
    assert restore_old_default(FRONT).saved.extrinsics == EXTRINSICS
    for source, words in ((" ".join(FRONT), FRONT[0]), ("straight_road", "does not say of which images")):
        write(path, source=source)
        restored = restore_old_default(REAR)
        assert restored.saved is None and words in restored.problem
    path.write_text("not YAML: [")
    assert restore_old_default(FRONT) == Restored()
    assert names(path.parent) == ["stereo_selfcal.yaml"], "it may be another node's"


def test_file_with_a_name_that_is_too_long_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match="name too long"):
        write(tmp_path / f"{'n' * 300}.yaml", keep_others=True)


def test_another_file_that_cannot_be_kept_aside_is_not_replaced(tmp_path, monkeypatch):
    def refuse(path):
        raise OutputError(f"{path} cannot be kept aside")

    (tmp_path / "out.yaml").write_text("somebody's")
    monkeypatch.setattr(result_file, "set_aside", refuse)
    with pytest.raises(OutputError, match="kept aside"):
        write(tmp_path / "out.yaml", keep_others=True)
    assert (tmp_path / "out.yaml").read_text() == "somebody's"


def test_calibration_is_restored(tmp_path):
    write(tmp_path / "out.yaml")
    restored = restore(tmp_path / "out.yaml")
    assert restored.saved.extrinsics == EXTRINSICS
    assert (restored.problem, restored.kept_aside) == ("", None)
    assert names(tmp_path) == ["out.yaml"]


@pytest.mark.parametrize("name", ["out.yaml", "no/such/folder/out.yaml", "link.yaml", "file/out.yaml"])
def test_missing_file_is_no_problem(tmp_path, name):
    (tmp_path / "link.yaml").symlink_to(tmp_path / "nowhere.yaml")
    (tmp_path / "file").write_text("")
    assert restore(tmp_path / name) == Restored()


def test_leftovers_of_a_killed_node_are_removed_at_the_start(tmp_path):
    write(tmp_path / "out.yaml")
    (tmp_path / ".stereo_selfcal.0123456789abcdef.tmp").write_text("half")
    restore(tmp_path / "out.yaml")
    assert names(tmp_path) == ["out.yaml"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (bytes(1000), "is not YAML"),
        (b"\x89PNG\xff", "is not a text file"),
        (b"/**: {ros__parameters: {extrinsics: {height_m: 1.4", "is not YAML in line 1"),
        (b"/amcl: {ros__parameters: {alpha1: 0.2}}", "no parameter file"),
        (b"/**: {ros__parameters: {alpha1: 0.2}}", "no result file of stereo_selfcal"),
        (b"/**: {ros__parameters: {extrinsics: {a: 1}, provenance: {schema: 9}}}", "newer version"),
        (b"a: &a [1]\n/**: *a", "aliases"),
        (b"#" * 65_537, "larger than 65536 bytes"),
    ],
)
def test_file_that_cannot_be_used_is_kept_aside_untouched(tmp_path, content, words):
    path = tmp_path / "out.yaml"
    path.write_bytes(content)
    os.utime(path, ns=(1, 1_234_567_890_123_456_789))
    restored = restore(path)
    assert restored.saved is None
    assert words in restored.problem and "\n" not in restored.problem
    assert restored.problem.startswith(str(path)) and str(restored.kept_aside) in restored.problem
    assert restored.kept_aside == tmp_path / "out.yaml.rejected"
    assert restored.kept_aside.read_bytes() == content
    assert restored.kept_aside.stat().st_mtime_ns == 1_234_567_890_123_456_789
    assert restore(path) == Restored(), "the next start has nothing to complain of"
    write(path)
    assert names(tmp_path) == ["out.yaml", "out.yaml.rejected"]


def test_bad_file_of_a_read_only_folder_stays_and_is_told(tmp_path, monkeypatch):
    def refuse(*_args):
        raise OSError(30, "Read-only file system")

    (tmp_path / "out.yaml").write_text("bad")
    monkeypatch.setattr("stereo_selfcal.files.atomic_file._reserve", refuse)
    restored = restore(tmp_path / "out.yaml")
    assert (restored.saved, restored.kept_aside) == (None, None)
    assert "it stays where it is: " in restored.problem and "read-only file system" in restored.problem
    assert (tmp_path / "out.yaml").read_text() == "bad"


def test_what_cannot_be_read_stays_and_is_told(tmp_path, monkeypatch):
    """It may be a good calibration, on a disk that answers at the next start."""

    def fail(*_args, **_kwargs):
        raise OSError(5, "Input/output error")

    os.mkfifo(tmp_path / "pipe")
    for name, words in ((".", "not a file"), ("pipe", "not a file"), ("a\0b", "null")):
        restored = restore(tmp_path / name)
        assert (restored.saved, restored.kept_aside) == (None, None)
        assert words in restored.problem and "it stays where it is" in restored.problem
    write(tmp_path / "out.yaml")
    monkeypatch.setattr("pathlib.Path.open", fail)
    restored = restore(tmp_path / "out.yaml")
    assert (restored.saved, restored.kept_aside) == (None, None)
    assert "input/output error; it stays where it is" in restored.problem
    assert names(tmp_path) == ["out.yaml", "pipe"]
