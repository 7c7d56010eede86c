"""The result file: a ROS 2 parameter file, whole or not at all, the same bytes for the same result."""

import dataclasses
import math
import os
import stat

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from stereo_selfcal import CalibrationResult, CalibratorConfig, ConfigError, Extrinsics, StereoRig
from stereo_selfcal.core.errors import OutputError
from stereo_selfcal.core.results import Rejection, RejectReason, rejected
from stereo_selfcal.result_file import (
    format_result,
    load_calibrator_config,
    load_result,
    result_parameters,
    write_atomically,
    write_result,
)

RIG = StereoRig(640, 480, 516.6, 516.6, 319.5, 239.5, 0.1481)
# Awkward on purpose: no short decimal, and so small that repr() has an exponent without a point.
EXTRINSICS = Extrinsics(1 / 3, 1e-05, -2 / 7)
COVARIANCE = np.diag([1e-6, 1e-10, 4e-8])


def a_result(**changes):
    result = CalibrationResult(
        "fine", extrinsics=EXTRINSICS, covariance=COVARIANCE, stamp_s=1_700_000_000.123456789, n_frames=3
    )
    return dataclasses.replace(result, **changes)


def a_rejection():
    return rejected(Rejection(RejectReason.NO_LINES_FOUND, "lines found", 0, 2, "", "look at the road"))


def write(path, result=None, source="bags/straight_road"):
    write_result(path, result or a_result(), RIG, source=source, seed=7)


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
        "schema": 1,
        "stamp": 1_700_000_000.123456789,
        "source": "bags/straight_road",
        "frames": 3,
        "seed": 7,
        "version": "0.1.0",
        "rig": dataclasses.asdict(RIG),
    }


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


numbers = st.floats(-1e3, 1e3)


@given(st.floats(0.01, 1e3), numbers, numbers, st.floats(0, 1e3), st.text(max_size=20))
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
    ],
)
def test_nothing_but_a_finite_calibration_is_written(tmp_path, result):
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


def test_file_has_the_rights_of_any_new_file(tmp_path):
    mask = os.umask(0o022)
    try:
        write(tmp_path / "out.yaml")
    finally:
        os.umask(mask)
    assert stat.S_IMODE((tmp_path / "out.yaml").stat().st_mode) == 0o644


def test_link_is_followed(tmp_path):
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.yaml"
    link.symlink_to(tmp_path / "real" / "out.yaml")
    write(link)
    assert link.is_symlink()
    assert load_result(tmp_path / "real" / "out.yaml").extrinsics == EXTRINSICS


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: folder / "missing" / "out.yaml", "no such file or directory"),
        (lambda folder: folder, "is not a file"),
        (lambda folder: folder / ("n" * 300), "name too long"),
        (lambda folder: folder / "a\0b", "null"),
        (lambda _: "/proc/out.yaml", "cannot be written"),
        (lambda _: "/dev/null", "is not a file"),
    ],
)
def test_unwritable_path_is_named_with_the_remedy(tmp_path, make, words):
    path = make(tmp_path)
    with pytest.raises(OutputError) as error:
        write(path)
    assert str(path) in str(error.value) and words in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("call", ["os.fsync", "pathlib.Path.replace"])
def test_full_disk_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, call):
    def fail(*_args):
        raise OSError(28, "No space left on device")

    path = tmp_path / "out.yaml"
    path.write_text("old")
    monkeypatch.setattr(call, fail)
    with pytest.raises(OutputError, match=r"out\.yaml cannot be written: no space left"):
        write_atomically(path, b"new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_file_is_synced_before_and_its_folder_after_the_rename(tmp_path, monkeypatch):
    steps = []
    sync, replace = os.fsync, type(tmp_path).replace
    monkeypatch.setattr(
        os,
        "fsync",
        lambda fd: steps.append("folder" if stat.S_ISDIR(os.fstat(fd).st_mode) else "file") or sync(fd),
    )
    monkeypatch.setattr(
        type(tmp_path), "replace", lambda self, to: steps.append("rename") or replace(self, to)
    )
    write(tmp_path / "out.yaml")
    assert steps == ["file", "rename", "folder"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("height_m: 0.3", "height: 0.3", "no result file"),
        ("schema: 1", "schema: 2", "schema 2"),
        ("height_m: 0.3", "height_m: .nan #", "impossible"),
        ("height_m: 0.3", "height_m: -0.3", "impossible"),
        ("height_std_m: ", "height_std_m: -", "impossible"),
        ("baseline_m: 0.1481", "baseline_m: 0.0", "baseline_m"),
        ("roll_rad: ", "roll_rad: abc", "no result file"),
        ("extrinsics:", "[", "not YAML in line"),
        ("/**:", "/other:", "no parameter file"),
        ("ros__parameters", "parameters", "has no 'ros__parameters:'"),
    ],
)
def test_every_value_is_checked_on_loading(tmp_path, old, new, words):
    path = tmp_path / "out.yaml"
    write(path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ValueError, match=words):  # ConfigError and RigError are ValueErrors
        load_result(path)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe", b"[1, 2]", b"word", b"/**: 3", b"a: [", b"!!python/object:os.system {}"]
)
def test_what_is_no_parameter_file_is_one_clear_error(tmp_path, content):
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    for load in (load_result, load_calibrator_config):
        with pytest.raises(ConfigError, match=r"x\.yaml"):
            load(path)


def test_missing_file():
    with pytest.raises(ConfigError, match=r"missing\.yaml cannot be read: no such file"):
        load_calibrator_config("missing.yaml")


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
