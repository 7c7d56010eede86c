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

"""How real and rendered roads of others are judged; the pairs where they lie beside the project."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from benchmarks.__main__ import SECTIONS, main
from benchmarks.frames import READABLE
from benchmarks.parts import PARTS, clocked_parts
from benchmarks.road_pairs import ROAD_REFERENCES, ROADS, SOURCES, RoadPair
from benchmarks.road_peer import peer_pose
from benchmarks.road_summary import summary_table
from benchmarks.road_verdicts import RoadVerdict, judge, outside, rms_of, robust_std_of
from benchmarks.table import NothingToMeasureError
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene

LOW, HIGH = np.array([1195.0, 2.02, -0.7]), np.array([1200.0, 2.04, -0.4])
UNKNOWN = np.full(3, np.nan)


def verdict(pose, std=(1.0, 0.01, 0.01), reason="", expected="accepted", low=LOW, high=HIGH, **fields):
    pose, std = (np.array([] if reason else values) for values in (pose, std))
    values = {"source": "roads", "name": "1", "tag": "any", "reference_std": np.zeros(3)} | fields
    return RoadVerdict(expected=expected, reason=reason, pose=pose, std=std, low=low, high=high, **values)


def test_error_is_what_lies_outside_of_the_reference():
    np.testing.assert_allclose(outside(np.array([1190.0, 2.03, -0.3]), LOW, HIGH), [-5.0, 0.0, 0.1])
    assert np.isnan(outside(np.array([1190.0, 2.03, -0.3]), UNKNOWN, UNKNOWN)).all()
    assert not len(outside(np.empty(0), LOW, HIGH))


@pytest.mark.parametrize(
    ("pose", "std", "word"),
    [
        ((1197.0, 2.03, -0.5), (1.0, 0.01, 0.01), "right"),
        ((1202.9, 2.03, -0.5), (1.0, 0.01, 0.01), "right"),
        ((1203.1, 2.03, -0.5), (1.0, 0.01, 0.01), "off"),
        ((1240.0, 2.03, -0.5), (9.0, 0.01, 0.01), "off"),  # 4.4 standard deviations
        ((1240.0, 2.03, -0.5), (7.0, 0.01, 0.01), "wrong"),
        ((1229.0, 2.03, -0.5), (1.0, 0.01, 0.01), "off"),  # far off by its own measure only
        ((1197.0, 2.03, 0.9), (1.0, 0.01, 9.0), "gross"),  # whatever it says of itself
    ],
)
def test_word_of_an_accepted_pair(pose, std, word):
    assert verdict(pose, std).word == word


def test_reference_has_a_standard_deviation_too():
    assert verdict((1204.0, 2.03, -0.5)).word == "off"
    assert verdict((1204.0, 2.03, -0.5), reference_std=np.array([5.0, 0.05, 0.2])).word == "right"


def test_what_has_no_reference_is_accepted_and_not_right():
    assert verdict((1197.0, 2.03, -0.5), low=UNKNOWN, high=UNKNOWN).word == "accepted"
    motion = np.full(3, np.inf)
    assert verdict((1230.0, 2.03, -0.5), reference_std=motion).word == "accepted"
    assert verdict((1300.0, 2.03, -0.5), reference_std=motion).word == "accepted"


def test_part_of_a_reference_is_judged():
    low = np.array([1195.0, 2.02, np.nan])
    assert verdict((1197.0, 2.03, 5.0), low=low, high=low + 5).word == "right"
    assert verdict((1297.0, 2.03, 5.0), low=low, high=low + 5).word == "gross"


@pytest.mark.parametrize(
    ("expected", "reason", "at_fault"),
    [
        ("accepted", "", False),
        ("accepted", "no_lines_found", True),
        ("welcome", "no_lines_found", False),
        ("welcome", "", False),
        ("refused", "no_lines_found", False),
        ("refused", "", True),
    ],
)
def test_fault_is_what_was_not_expected(expected, reason, at_fault):
    assert verdict((1197.0, 2.03, -0.5), reason=reason, expected=expected).at_fault is at_fault


def test_scatter_leaves_out_what_is_unknown():
    values = np.array([[3.0, np.nan], [-4.0, 2.0]])
    np.testing.assert_allclose(rms_of(values), [np.sqrt(12.5), 2.0])
    np.testing.assert_allclose(robust_std_of(values), [1.4826 * 3.5, 1.4826 * 2.0])


def test_peer_and_calibrator_find_a_rendered_road():
    scene = random_scene(np.random.default_rng(3), 0.005)
    left, right = render(scene, np.random.default_rng(4))
    truth = scene.extrinsics.as_array() * READABLE
    pair = RoadPair("rendered", "3", "any", "accepted", scene.rig, left, right, truth, truth)
    judged = judge(pair)
    assert judged.word == "right"
    np.testing.assert_array_less(np.abs(judged.peer_error), [60.0, 0.2, 0.3])
    assert peer_pose(np.zeros_like(left), np.zeros_like(right), scene.rig) is None


def rows_of(source, verdicts):
    return {row[1]: row[3:] for row in summary_table({source: verdicts}).rows}


def test_summary_counts_what_is_asked():
    right = verdict((1197.0, 2.03, -0.5), tag="straight_lines", peer=np.array([1190.0, 2.0, -0.5]))
    frames = [right] * 37 + [verdict((), reason="no_lines_found", peer=right.peer)] * 5
    assert rows_of("kitti_frames", frames)["accepted, all kinds"] == ("37 of 42", "**no**")
    assert rows_of("kitti_frames", [right, *frames[:-1]])["accepted, all kinds"] == ("38 of 42", "yes")
    gross = replace(right, name="the gross one", pose=np.array([1300.0, 2.03, -0.5]))
    assert rows_of("kitti_frames", [*frames, gross])["gross"] == ("1: the gross one", "**no**")


def test_summary_of_worlds_tells_the_bad_from_the_good():
    bad = verdict((1400.0, 2.03, -0.5), tag="bad", name="kerb")
    turned = verdict((1400.0, 2.03, -0.5), tag="turned")
    good = verdict((1197.0, 2.03, -0.5), tag="good")
    rows = rows_of("worlds", [bad, replace(bad, reason="road_not_flat"), turned, good])
    assert rows["bad ones refused or right"] == ("1 of 2", "**no**")
    assert rows["good ones accepted"] == ("1 of 1", "yes")
    assert rows["a turned camera: accepted and wrong"][1] == "yes"


def test_absent_pairs_are_skipped_with_a_reason(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("benchmarks.road_pairs.ROADS", tmp_path / "elsewhere")
    with pytest.raises(NothingToMeasureError, match=r"elsewhere.*where they lie beside it"):
        next(SOURCES["roads"]())
    assert main(["roads", "--source", "roads", "--processes", "1", "--folder", str(tmp_path / "out")]) == 0
    assert "roads: skipped, there is no" in capsys.readouterr().out
    assert not (tmp_path / "out" / "roads.md").exists()


def test_parts_of_a_calibration_are_functions_of_its_modules():
    with clocked_parts() as spent:
        assert all(callable(getattr(module, name)) for module, name in PARTS.values())
    assert set(spent) == set(PARTS)


def test_sections_of_roads_can_be_measured():
    for name in ("roads", "strips", "steady", "road_times"):
        module, function = SECTIONS[name].split(".")
        assert callable(getattr(import_module(f"benchmarks.{module}"), function))


@pytest.mark.skipif(not ROADS.is_dir(), reason="the real pairs of others are not beside this project")
@pytest.mark.parametrize(
    ("source", "number"),
    [("kitti_frames", 42), ("kitti_odometry02", 20), ("kitti_odometry07", 51), ("worlds", 22)],
)
def test_every_pair_is_read(source, number):
    pairs = list(SOURCES[source]())
    assert len({pair.name for pair in pairs}) == len(pairs) == number
    for pair in pairs:
        assert pair.left.shape == pair.right.shape == (pair.rig.height, pair.rig.width)
        assert (pair.low <= pair.high).all()


@pytest.mark.skipif(not ROADS.is_dir(), reason="the real pairs of others are not beside this project")
def test_every_road_of_other_cameras_has_a_reference():
    read = {pair.name for pair in SOURCES["roads"]()}
    there = {f"{path.parts[-3]}/{path.stem}" for path in ROADS.glob("*/left/*")}
    assert read == there
    assert len(ROAD_REFERENCES) == len(there)
