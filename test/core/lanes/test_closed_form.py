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

"""Closed form: exact where the lines are, its covariance against many draws, and the second opinion."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import drawn, ideal_pattern

from stereo_selfcal import Extrinsics, StereoRig
from stereo_selfcal.core.lanes.closed_form import contradictions, solve_plane
from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.2, 0.10, -0.03)
YAW = 0.02
OTHER_RIG = StereoRig(800, 600, 700.0, 690.0, 410.0, 290.0, 0.3)


def pattern_of(pose=POSE, yaw=YAW, rig=PAPER_RIG, **kwargs):
    return ideal_pattern(rig, pose, lane_yaw_rad=yaw, **kwargs)


def random_pose(rng):
    return Extrinsics(rng.uniform(0.8, 2.5), *np.radians(rng.uniform(-8.0, 8.0, 2)))


@pytest.mark.parametrize("rig", [PAPER_RIG, OTHER_RIG], ids=["paper", "other"])
def test_exact_on_ideal_lines(rig):
    """To what 64 bits leave of a linear system with a condition of 1e4; yaw and offset do not matter."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        pose = random_pose(rng)
        pattern = pattern_of(pose, rng.uniform(-0.05, 0.05), rig, lateral_m=rng.uniform(-0.5, 0.5))
        closed = solve_plane(pattern, rig)
        np.testing.assert_allclose(closed.extrinsics.as_array(), pose.as_array(), rtol=0, atol=1e-9)


def test_lines_need_not_be_parallel():
    """Only the plane counts: the two boundaries are those of roads that differ in yaw by 3 degrees."""
    one, two = pattern_of(yaw=0.0), pattern_of(yaw=math.radians(3.0))
    rows = np.arange(200.0, 480.0, 10.0)
    lines = [(a[0], b[1]) for a, b in ((one.left, two.left), (one.right, two.right))]
    columns = np.array([[line.column_at(rows) for line in pair] for pair in lines])
    pattern = replace(one, left=lines[0], right=lines[1], rows=rows, columns=columns)
    closed = solve_plane(pattern, PAPER_RIG)
    np.testing.assert_allclose(closed.extrinsics.as_array(), POSE.as_array(), rtol=0, atol=1e-9)


def changed(disparity_px):
    """Return how the solution moves when a function of (columns, rows) is added to the disparity."""
    pattern = pattern_of()
    columns = pattern.columns.copy()
    columns[1] -= disparity_px(columns[0], pattern.rows)
    before, after = (solve_plane(p, PAPER_RIG) for p in (pattern, replace(pattern, columns=columns)))
    return after.extrinsics.as_array() - before.extrinsics.as_array()


def test_more_disparity_everywhere_is_nose_down():
    """The road comes nearer in every row when the camera dips."""
    assert changed(lambda u, _v: np.full_like(u, 0.1))[1] > 0


def test_more_disparity_on_the_right_is_right_side_down():
    """The right side, lowered, has the road nearer on the right."""
    assert changed(lambda u, _v: 1e-3 * (u - PAPER_RIG.cx))[2] > 0


def test_more_disparity_in_proportion_is_lower():
    pattern = pattern_of()
    disparity = pattern.columns[0] - pattern.columns[1]
    change = changed(lambda _u, _v: 0.01 * disparity)
    # Disparity is baseline over height: by 1 % more, 1 % lower, and the angles stay.
    assert change[0] == pytest.approx(POSE.height_m * (1 / 1.01 - 1), rel=1e-2)
    np.testing.assert_allclose(change[1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("pose", [POSE, Extrinsics(1.6, 0.03, 0.02)])
def test_covariance_is_that_of_many_solutions(pose):
    pattern, rng = pattern_of(pose), np.random.default_rng(1)
    claimed = solve_plane(pattern, PAPER_RIG).covariance
    solutions = np.array(
        [solve_plane(drawn(pattern, rng), PAPER_RIG).extrinsics.as_array() for _ in range(600)]
    )
    # 600 draws give a standard deviation to 2.9 % and a correlation to 0.04: four of these.
    np.testing.assert_allclose(solutions.std(axis=0) / np.sqrt(np.diag(claimed)), 1.0, atol=0.12)
    std = np.sqrt(np.diag(claimed))
    np.testing.assert_allclose(np.corrcoef(solutions.T), claimed / np.outer(std, std), atol=0.16)
    bias = (solutions.mean(axis=0) - pose.as_array()) / (solutions.std(axis=0) / np.sqrt(len(solutions)))
    assert np.all(np.abs(bias) < 3.5), bias


def test_covariance_of_each_line_counts():
    """One uncertain line at a time, ten times the others: the claim follows the draws."""
    base = pattern_of()
    for i, j in np.ndindex(2, 2):
        pairs = [list(base.left), list(base.right)]
        pairs[i][j] = replace(pairs[i][j], covariance=100 * pairs[i][j].covariance)
        pattern = replace(base, left=tuple(pairs[0]), right=tuple(pairs[1]))
        claimed = np.sqrt(np.diag(solve_plane(pattern, PAPER_RIG).covariance))
        rng = np.random.default_rng(2)
        solutions = [solve_plane(drawn(pattern, rng), PAPER_RIG).extrinsics.as_array() for _ in range(200)]
        # 200 draws give it to 5 %.
        np.testing.assert_allclose(np.std(solutions, axis=0) / claimed, 1.0, atol=0.2)


def test_covariance_is_symmetric_and_positive():
    covariance = solve_plane(pattern_of(), PAPER_RIG).covariance
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


# --- no plane -------------------------------------------------------------------------------------------


def test_one_line_seen_twice_gives_none():
    rng = np.random.default_rng(3)
    for _ in range(50):
        position = rng.uniform(-2.0, 2.0)
        base = pattern_of(random_pose(rng), positions_m=(position, position - 3.0))
        pattern = replace(base, columns=base.columns[:, [0, 0]])
        assert isinstance(solve_plane(pattern, PAPER_RIG), NotFitted)


def test_one_row_gives_none():
    base = pattern_of()
    pattern = replace(base, rows=base.rows[-1:], columns=base.columns[..., -1:])
    assert isinstance(solve_plane(pattern, PAPER_RIG), NotFitted)


def test_disparity_that_grows_upwards_gives_none():
    """Swapped cameras, equal images, and a plane overhead are no road."""
    base = pattern_of()
    left, right = base.columns
    for columns in ((right, left), (left, left)):
        assert isinstance(solve_plane(replace(base, columns=np.array(columns)), PAPER_RIG), NotFitted)


# --- the second opinion ---------------------------------------------------------------------------------


def claims(pattern):
    """Return a covariance of the genetic result like that of the closed form."""
    return solve_plane(pattern, PAPER_RIG).covariance


def test_agreement_is_silent():
    pattern = pattern_of()
    closed = solve_plane(pattern, PAPER_RIG)
    assert contradictions(closed, POSE, claims(pattern)) == ()
    np.testing.assert_allclose(closed.extrinsics.as_array(), POSE.as_array(), atol=1e-9)


def test_disagreement_within_the_uncertainties_is_silent():
    """Two standard deviations of each, which is 1.4 of both; never more than a word in 15 000 frames."""
    pattern, rng = pattern_of(), np.random.default_rng(4)
    covariance = claims(pattern)
    moved = Extrinsics.from_array(POSE.as_array() + 2.0 * np.sqrt(np.diag(covariance)))
    assert contradictions(solve_plane(pattern, PAPER_RIG), moved, covariance) == ()
    for _ in range(200):
        assert contradictions(solve_plane(drawn(pattern, rng), PAPER_RIG), POSE, covariance) == ()


@pytest.mark.parametrize(
    ("index", "words"), [*enumerate([("height", " m, "), ("pitch", " deg, "), ("roll", " deg, ")])]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_disagreement_is_said_with_name_sign_and_size(index, words, sign):
    pattern = pattern_of()
    covariance = claims(pattern)
    # Ten standard deviations of both together.
    shift = sign * 10.0 * math.sqrt(2.0 * covariance[index, index])
    values = POSE.as_array()
    values[index] += shift
    notes = contradictions(solve_plane(pattern, PAPER_RIG), Extrinsics.from_array(values), covariance)
    shown = -shift if index == 0 else -math.degrees(shift)
    name, unit = words
    said = f"the closed form differs from the genetic algorithm in {name} by {shown:+.4f}{unit}"
    assert [note.sentence for note in notes] == [f"{said}10 standard deviations, at most 4 expected"]


def test_every_quantity_that_disagrees_is_named():
    pattern = pattern_of()
    far = Extrinsics(POSE.height_m + 0.3, POSE.pitch_rad, POSE.roll_rad - 0.1)
    notes = contradictions(solve_plane(pattern, PAPER_RIG), far, claims(pattern))
    assert [note.sentence.split(" by ")[0] for note in notes] == [
        "the closed form differs from the genetic algorithm in height",
        "the closed form differs from the genetic algorithm in roll",
    ]
