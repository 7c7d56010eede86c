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

"""Heights of the road along the lines: against lines on roads that rise, fall and bend in space."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_camera import CAMERAS, image_line, project
from row_block_making import make_residuals

from stereo_selfcal import Extrinsics
from stereo_selfcal.core.evidence.profile import measure_profile
from stereo_selfcal.core.tolerances import AGREEMENT
from stereo_selfcal.synth.scenes import PAPER_RIG

POSE = Extrinsics(1.4, math.radians(3.0), 0.0)
EDGES_M = np.array([[1.82, 1.67], [-1.67, -1.82]])
BESIDE_M = np.array([[4.0, 3.85], [0.9, 0.75]])
TALL_PIXELS = replace(PAPER_RIG, fy=0.8 * PAPER_RIG.fy)
ROWS = np.arange(226.0, 480.0, 4.0)  # from 28 m ahead to 3 m
NODES_M = np.array([3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0])
ALONG_M = np.geomspace(2.0, 60.0, 4000)
VARIANCE = 4.0


def flat_columns(rig=PAPER_RIG, edges_m=EDGES_M):
    columns = np.empty((2, 2, 2, len(ROWS)))
    for i, stripe, edge in np.ndindex(2, 2, 2):
        slope, at_0 = image_line(rig, POSE, CAMERAS[i], edges_m[stripe, edge])
        columns[i, stripe, edge] = at_0 + slope * ROWS
    return columns


FLAT = flat_columns()
# Of what edges are off where a road rises, (2, L, 1, 2).
SIGNS = np.sign(FLAT[..., -1] - FLAT[..., 0])[:, :, None]


def seen(height=lambda x: 0.0 * x, aside=lambda x: 0.0 * x, rig=PAPER_RIG, edges_m=EDGES_M):
    """Return what edges are off, (2, L, N, 2), on a road of some height and with some bend over x [m]."""
    off, flat = np.empty((2, 2, len(ROWS), 2)), flat_columns(rig, edges_m)
    for i, stripe, edge in np.ndindex(2, 2, 2):
        points = np.stack([ALONG_M, edges_m[stripe, edge] + aside(ALONG_M), height(ALONG_M)], axis=1)
        u, v = project(rig, POSE, CAMERAS[i], points).T
        assert np.all(np.diff(v) < 0)  # nothing is hidden
        off[i, stripe, :, edge] = np.interp(ROWS, v[::-1], u[::-1]) - flat[i, stripe, edge]
    return off


def profile_of(off, wide=False, rig=PAPER_RIG, edges_m=EDGES_M, **known):
    known.setdefault("variance", VARIANCE)
    edges = make_residuals(off, flat_columns(rig, edges_m), ROWS, **known)
    return measure_profile(edges, rig, POSE, wide=wide)


def distances_m():
    """Return how far ahead the rows are."""
    points = np.stack([ALONG_M, 0.0 * ALONG_M, 0.0 * ALONG_M], axis=1)
    v = project(PAPER_RIG, POSE, "left", points)[:, 1]
    return np.interp(ROWS, v[::-1], ALONG_M[::-1])


def kink(slope, at_m):
    return lambda x: slope * np.maximum(x - at_m, 0.0)


# --- what is measured ----------------------------------------------------------------------------------


def test_a_plane_has_no_heights():
    profile = profile_of(seen())
    np.testing.assert_array_equal(profile.at_m, NODES_M)
    np.testing.assert_allclose(profile.heights_m, 0.0, atol=1e-4)
    np.testing.assert_allclose(profile.change, 0.0, atol=1e-4)
    assert not profile.bent and profile.bends_at_m == np.inf
    assert profile.sees_ahead


@pytest.mark.parametrize("rig", [PAPER_RIG, TALL_PIXELS], ids=["square", "tall"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_heights_are_those_of_the_road(sign, rig):
    """A crest or a dip of few millimetres, with nodes where it is measured and lines between them."""
    height = np.array([0.0, 0.0, 2.0, 6.0, 12.0, 15.0, 20.0]) * 1e-3 * sign
    profile = profile_of(seen(lambda x: np.interp(x, NODES_M, height), rig=rig), wide=True, rig=rig)
    # What is known of roads beforehand smooths them.
    np.testing.assert_allclose(profile.heights_m[1:-1], height[1:-1], atol=1.0e-3)


@pytest.mark.parametrize(("up_m", "slope"), [(0.004, 0.0), (0.0, 0.001), (-0.003, 0.0005)])
def test_the_change_is_that_of_the_plane_ahead(up_m, slope):
    """A road that is higher under the camera makes it lower; one that rises ahead pitches it down."""
    profile = profile_of(seen(lambda x: up_m + slope * x), wide=True)
    np.testing.assert_allclose(profile.change[0], -up_m, atol=3e-4)
    np.testing.assert_allclose(profile.change[1], slope, atol=3e-5)


@pytest.mark.parametrize("edges_m", [EDGES_M, BESIDE_M], ids=["lane", "one side"])
@pytest.mark.parametrize("curvature_per_m", [-2e-4, 2e-4])
def test_a_bend_is_no_height(curvature_per_m, edges_m):
    """Lines that leave the straight by 4 cm at 20 m; also where all are on one side, as heights would."""
    off = seen(aside=lambda x: curvature_per_m * x**2 / 2.0, edges_m=edges_m)
    profile = profile_of(off, edges_m=edges_m)
    np.testing.assert_allclose(profile.heights_m[:-1], 0.0, atol=1.5e-3)
    assert not profile.bent


def test_a_road_that_leaves_the_plane_is_told_with_its_place():
    """By 5 cm in the last 5 m that an edge is in reach: far more than four deviations."""
    profile = profile_of(seen(kink(0.01, 10.0)))
    assert profile.bent
    assert profile.bends_at_m == 15.0
    assert profile.seen_share == 0.5
    assert not profile.sees_ahead
    assert profile.change[1] > 0.002


def test_beyond_the_place_where_the_road_leaves_the_plane_nothing_has_a_say():
    """Not even where edges are in reach: with most slopes they soon would not be."""
    step = seen(lambda x: 0.008 * np.clip((x - 7.5) / 2.5, 0.0, 1.0))
    assert np.abs(step).max() < 1.0
    profile, flat = profile_of(step), profile_of(seen())
    assert profile.bends_at_m == 10.0
    assert profile.stds_m[5] > 3.0 * flat.stds_m[5]
    assert profile.stds_m[2] == pytest.approx(flat.stds_m[2], rel=0.1)


def test_another_plane_ahead_is_not_the_one_of_the_fit_however_well_it_is_seen():
    """By more than both may differ: 0.29 deg of pitch."""
    profile = profile_of(seen(lambda x: 0.005 * x), wide=True)
    assert np.all(4.0 * profile.std < 0.5 * AGREEMENT[:2])
    assert not profile.sees_ahead


def test_near_the_camera_a_height_is_none_of_the_road_that_is_meant():
    """A hump under the bonnet bends the road, and not where it is meant."""
    profile = profile_of(seen(lambda x: 0.02 * np.maximum(1.0 - x / 4.5, 0.0)))
    assert profile.bent
    assert profile.bends_at_m == np.inf


# --- what it claims ------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_errors_scatter_by_the_standard_deviations(scale):
    rng = np.random.default_rng(2)
    information = 400.0
    std_px = math.sqrt(VARIANCE / information + 0.1**2)  # edges of paint are straight to a tenth of a pixel
    heights, changes, profiles = [], [], []
    for _ in range(200):
        errors = scale * std_px * rng.normal(size=(2, 2, len(ROWS), 2))
        profiles.append(profile_of(errors, information=information))
        heights.append(profiles[-1].heights_m / profiles[-1].stds_m)
        changes.append(profiles[-1].change / profiles[-1].std)
    # Less than one, as what is known of roads beforehand holds the estimates together, and these are flat.
    at_nodes = np.std(heights, axis=0)
    assert np.all(at_nodes < 1.15) and np.all(at_nodes[1:5] > 0.3)
    assert np.all(np.std(changes, axis=0) < 1.15) and np.all(np.std(changes, axis=0) > 0.3)
    assert sum(profile.bent for profile in profiles) <= 1


def test_standard_deviations_go_by_the_information_and_the_straightness_of_paint():
    """Where hardly anything else is known, as under the camera, of what a block says and no more."""
    stds = [profile_of(seen(), information=each).stds_m[1] for each in (4.0, 400.0, 1e9, 1e12)]
    # variance / information + 0.1^2 px^2: 1.01, 0.02, 0.01, 0.01.
    assert stds[0] / stds[1] == pytest.approx(math.sqrt(1.01 / 0.02), rel=0.25)
    assert stds[1] / stds[2] == pytest.approx(math.sqrt(2.0), rel=0.05)
    assert stds[3] == pytest.approx(stds[2], rel=1e-3)


def test_without_an_edge_nothing_is_known_but_what_roads_are_like():
    profile = profile_of(seen(), usable=np.zeros((2, 2, len(ROWS)), bool))
    np.testing.assert_array_equal(profile.heights_m, 0.0)
    assert np.all(profile.stds_m > 0.1) and np.all(profile.stds_m <= 0.3)
    assert not profile.bent and not profile.sees_ahead


def test_a_road_seen_near_only_is_not_seen_ahead():
    near = np.broadcast_to(distances_m() < 8.0, (2, 2, len(ROWS)))
    profile = profile_of(seen(), usable=near)
    assert profile.stds_m[1] < 0.01 < profile.stds_m[5]
    assert np.any(4.0 * profile.std > AGREEMENT[:2])
    assert not profile.sees_ahead


# --- which edges count ---------------------------------------------------------------------------------


def test_edges_that_are_wrong_are_left_out():
    clean = seen(kink(0.002, 8.0))
    wrong = clean.copy()
    wrong[:, :, 3::7] += 0.8 * SIGNS
    expected, found = profile_of(clean, information=1e4), profile_of(wrong, information=1e4)
    np.testing.assert_array_less(np.abs(found.heights_m - expected.heights_m), 0.5 * expected.stds_m)


@pytest.mark.parametrize("kind", ["unusable", "ramp", "far"])
def test_edges_that_are_not_those_of_the_fit_have_no_say(kind):
    """Two of five: with their sign they would be a road that rises."""
    off, mask = seen(), np.arange(len(ROWS)) % 5 < 2
    off[:, :, mask] += (1.02 if kind == "far" else 0.4) * SIGNS
    known = {}
    if kind == "unusable":
        known["usable"] = np.broadcast_to(~mask, off.shape[:-1])
    elif kind == "ramp":
        known["ramp_sigmas"] = np.broadcast_to(np.where(mask, 3.1, 2.9), off.shape[:-1])
    np.testing.assert_allclose(profile_of(off, **known).heights_m, 0.0, atol=1e-4)


def test_where_most_edges_are_out_of_reach_the_road_is_not_seen():
    """Of those at 15 to 20 m only every third is within a pixel: they are there by chance."""
    off = seen()
    beyond = (distances_m() > 15.0) & (np.arange(len(ROWS)) % 3 > 0)
    off[:, :, beyond] += 2.0
    few = profile_of(off)
    half = off.copy()
    half[:, :, beyond & (np.arange(len(ROWS)) % 6 > 1)] -= 2.0
    assert few.stds_m[5] > 3.0 * profile_of(half).stds_m[5]
    assert few.stds_m[3] == pytest.approx(profile_of(half).stds_m[3], rel=0.05)


def test_a_wide_look_takes_edges_of_a_window():
    """A slope that puts edges off by pixels: narrow, what is seen of the road ends soon after it."""
    off = seen(kink(0.01, 8.0))
    ahead = np.abs(off[:, :, (distances_m() > 15.0) & (distances_m() < 20.0)])
    assert ahead.min() > 1.0 and ahead.max() < 5.0
    narrow, wide = profile_of(off), profile_of(off, wide=True)
    assert wide.bent
    assert wide.heights_m[4] == pytest.approx(0.01 * 7.0, rel=0.15)
    assert narrow.stds_m[4] > 5.0 * wide.stds_m[4]


# --- what it leaves open -------------------------------------------------------------------------------


def stds_of_change(profile):
    return np.sqrt(np.diag(profile.seen_change + profile.unseen_change))


def test_a_road_not_seen_at_all_is_one_of_two_kinds():
    """Its slope changes by 0.1 % a node on nine of ten roads, and by 1 % on the others."""
    profile = profile_of(seen(), usable=np.zeros((2, 2, len(ROWS)), bool))
    gentle, sharp = profile.kinds
    assert (gentle.probability, sharp.probability) == (pytest.approx(0.9), pytest.approx(0.1))
    np.testing.assert_allclose(profile.seen_change, 0.0, atol=1e-15)
    expected = 0.9 * gentle.covariance + 0.1 * sharp.covariance
    np.testing.assert_allclose(profile.unseen_change, expected)
    assert np.all(np.diag(gentle.covariance) < np.diag(sharp.covariance))


def test_a_bend_that_is_seen_tells_the_kind_of_road():
    """A gentle road cannot do that, so what is not seen of it is uncertain as that of a sharp one."""
    flat, bent = profile_of(seen(), information=1e4), profile_of(seen(kink(0.008, 10.0)), information=1e4)
    assert bent.kinds[1].probability > 0.9
    # What is seen to be flat may bend beyond.
    assert flat.kinds[1].probability == pytest.approx(0.1)
    assert bent.seen_change[1, 1] > 0.002**2
    np.testing.assert_allclose(sum(kind.probability for kind in bent.kinds), 1.0)


def test_farther_and_farther_seen_it_is_known_better_without_a_step():
    """Rows are taken away one by one, from those 28 m ahead on."""
    stds = []
    for first in range(len(ROWS) - 10):
        usable = np.ones((2, 2, len(ROWS)), bool)
        usable[..., :first] = False
        stds.append(stds_of_change(profile_of(seen(), usable=usable)))
    assert np.all(np.diff(stds, axis=0) > -1e-6) and np.all(stds[-1] > 5.0 * stds[0])
    # With what else is unknown of a pose from two lines on this rig, there is no step by half.
    whole = np.hypot(stds, [0.012, math.radians(0.12)])
    assert np.all(whole[1:] / whole[:-1] < 1.5)
