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

"""The plane of the own lane, predicted from cells: its errors over many roads are those it claims."""

from dataclasses import replace

import numpy as np
import pytest

from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road import surface
from stereo_selfcal.core.road.lane_points import LanePoints
from stereo_selfcal.core.road.surface import CellHeights, road_cells
from stereo_selfcal.core.road.unevenness import RoadUnevenness, unit_covariances

UNEVEN = RoadUnevenness(roughness=1e-5, mismatch_px=0.05, camber=1.0)


def design_at(xy):
    return np.column_stack([np.ones(len(xy)), xy])


def road_of(ahead_m, aside_m):
    """Return cells in a grid over a road that is flat, and the design of a plane there."""
    aside, x = (grid.ravel() for grid in np.meshgrid(np.array(aside_m), np.array(ahead_m)))
    strip = np.searchsorted(-np.array(aside_m), -aside)
    xy, metres = np.column_stack([x, aside]), 0.005 * x
    return CellHeights(np.zeros(len(x)), (0.1 * metres) ** 2, metres, xy, strip), design_at(xy)


STRIPS_M = (2.0, 1.0, 0.0, -1.0, -2.0)
CELLS, DESIGN = road_of(np.geomspace(3.5, 22.0, 9), STRIPS_M)


def lane_of(strips_m=STRIPS_M):
    x, aside = (
        grid.ravel() for grid in np.meshgrid(np.arange(3.0, 20.1, 1.5), (1.75, 0.9, 0.0, -0.9, -1.75))
    )
    xy = np.column_stack([x, aside])
    strip = np.abs(aside[:, None] - np.array(strips_m)).argmin(axis=1)
    return LanePoints(xy, aside, design_at(xy), strip, len(strips_m) // 2)


LANE = lane_of()


def lane_plane(heights):
    """Return the plane of the own lane, by least squares: the mean of those from 3 m and from 5 m on."""
    planes = []
    for begin_m, end_m in ((3.0, 15.0), (5.0, 20.0)):
        inside = (LANE.xy[:, 0] >= begin_m) & (LANE.xy[:, 0] <= end_m)
        planes.append(np.linalg.lstsq(LANE.design[inside], heights[inside], rcond=None)[0])
    return np.mean(planes, axis=0)


def drawn(n, unevenness=UNEVEN, seed=0):
    """Draw n roads: heights at the cells as they are measured, and at the points of the lane as they are."""
    kernel, profile = unit_covariances(np.concatenate([CELLS.xy, LANE.xy]))
    of_road = unevenness.roughness * kernel + unevenness.camber**2 * profile
    rng = np.random.default_rng(seed)
    roads = rng.multivariate_normal(np.zeros(len(kernel)), of_road, size=n, method="eigh")
    errors = np.sqrt(CELLS.variances + (unevenness.mismatch_px * CELLS.metres) ** 2)
    measured = roads[:, : len(CELLS.xy)] + errors * rng.standard_normal((n, len(CELLS.xy)))
    return measured, roads[:, len(CELLS.xy) :]


def fitted(cells, design, lane):
    found = surface_of(cells, design, lane)
    assert not isinstance(found, NotFitted)
    return found


def surface_of(cells, design, lane):
    seen = road_cells(cells, design, lane)
    return seen if isinstance(seen, NotFitted) else seen.surface()


@pytest.fixture
def known(monkeypatch):
    """Let the unevenness of a road be known, as the estimate of it is tested elsewhere."""
    monkeypatch.setattr(surface, "estimate_unevenness", lambda *_: UNEVEN)


# Terms of the error against the plane of the lane; how other parts of the road differ from it is no error.
OF_ERROR = ("noise", "mismatch", "roughness", "camber")


@pytest.mark.parametrize("view", ["all of the lane", "its left half", "its near part"])
def test_errors_over_many_roads_are_those_claimed(known, view):
    """Where a part of the lane is not seen, its unevenness is in the covariance, and no more than that."""
    ahead, aside = CELLS.xy.T
    parts = {"all of the lane": ahead > 0.0, "its left half": aside > -0.1, "its near part": ahead < 11.0}
    measured, truth = drawn(40)
    errors = []
    for heights, lane_heights in zip(measured, truth, strict=True):
        found = fitted(replace(CELLS, heights=np.where(parts[view], heights, np.nan)), DESIGN, LANE)
        errors.append(found.plane - lane_plane(lane_heights))
    claimed = sum(found.covariance_terms[name] for name in OF_ERROR)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.diag(claimed))
    # 40 roads give a standard deviation to 11 %; some cells count as outliers that are none.
    assert np.all((ratio > 0.65) & (ratio < 1.4)), ratio


def test_unevenness_of_a_lane_that_is_seen_is_known(known):
    """The same cells without those of the lane itself: there the heights may be any of a rough road."""
    whole = fitted(CELLS, DESIGN, LANE)
    far = np.abs(CELLS.xy[:, 1]) > 1.5
    beside = fitted(replace(CELLS, heights=np.where(far, CELLS.heights, np.nan)), DESIGN, LANE)
    for name in ("roughness", "camber"):
        seen, unseen = (each.covariance_terms[name][0, 0] for each in (whole, beside))
        assert seen < 0.35 * unseen, name


def test_terms_add_up_and_noise_is_that_of_the_pixels(known):
    found = fitted(CELLS, DESIGN, LANE)
    assert list(found.covariance_terms) == [*OF_ERROR, "part_of_road"]
    np.testing.assert_allclose(sum(found.covariance_terms.values()), found.covariance, rtol=1e-12)
    np.testing.assert_allclose(
        found.covariance_terms["noise"] + found.covariance_terms["mismatch"],
        found.noise_covariance,
        atol=1e-15,
    )
    louder = fitted(replace(CELLS, variances=4.0 * CELLS.variances), DESIGN, LANE)
    assert np.all(np.diag(louder.covariance_terms["noise"]) > np.diag(found.covariance_terms["noise"]))


def test_plane_is_found_and_parts_of_it_do_not_differ(known):
    plane = np.array([0.05, -0.01, 0.02])
    found = fitted(replace(CELLS, heights=DESIGN @ plane), DESIGN, LANE)
    np.testing.assert_allclose(found.plane, plane, atol=1e-9)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-9)
    # What remains is by the noise, and by what lies beyond the cells.
    of_parts = np.sqrt(np.diag(found.covariance_terms["part_of_road"]))
    assert np.all(of_parts < np.sqrt(np.diag(found.covariance))) and np.all(of_parts < [4e-3, 5e-4, 2e-3])
    for half in found.halves:
        np.testing.assert_allclose(half.plane, 0.0, atol=1e-9)


def test_another_slope_ahead_spreads_the_pose(known):
    """The plane lies between those from 3 m and from 5 m on; how these and the nearest differ is a doubt."""
    bent = 0.004 * np.maximum(CELLS.xy[:, 0] - 11.0, 0.0)
    found = fitted(replace(CELLS, heights=bent), DESIGN, LANE)
    x = LANE.xy[:, 0]
    expected = lane_plane(0.004 * np.maximum(x - 11.0, 0.0))
    assert np.all(np.abs(found.plane - expected) < [2e-3, 3e-4, 3e-4])
    spread = np.sqrt(found.covariance_terms["part_of_road"][1, 1])
    stretches = [(x >= begin_m) & (x <= end_m) for begin_m, end_m in ((3.0, 15.0), (5.0, 20.0), (3.0, 10.0))]
    slopes = [np.polyfit(x[of], 0.004 * np.maximum(x[of] - 11.0, 0.0), 1)[0] for of in stretches]
    expected_spread = np.sqrt(np.mean(np.square(np.array(slopes) - np.mean(slopes[:2]))))
    assert spread == pytest.approx(expected_spread, rel=0.25)


def test_halves_of_a_road_that_bends_differ_by_its_bend(known):
    """Near and far by the change of slope; left and right by that across."""
    ahead = fitted(replace(CELLS, heights=0.02 * np.maximum(CELLS.xy[:, 0] - 9.0, 0.0)), DESIGN, LANE)
    across = fitted(replace(CELLS, heights=0.03 * np.maximum(CELLS.xy[:, 1], 0.0)), DESIGN, LANE)
    near_far, left_right = ahead.halves
    assert abs(near_far.plane[1]) == pytest.approx(0.02, abs=0.006)
    assert abs(near_far.plane[1]) > 4.0 * np.sqrt(near_far.covariance[1, 1])
    assert abs(left_right.plane[1]) < 0.2 * abs(near_far.plane[1])
    near_far, left_right = across.halves
    assert abs(left_right.plane[2]) == pytest.approx(0.03, abs=0.008)
    assert abs(near_far.plane[2]) < 0.2 * abs(left_right.plane[2])


def test_first_passes_take_a_usual_road(monkeypatch):
    monkeypatch.setattr(surface, "estimate_unevenness", lambda *_: pytest.fail("not in the first passes"))
    rough = replace(CELLS, heights=drawn(1)[0][0])
    found = road_cells(rough, DESIGN, LANE).plane()
    monkeypatch.setattr(surface, "estimate_unevenness", lambda *_: RoadUnevenness.typical())
    whole = fitted(rough, DESIGN, LANE)
    np.testing.assert_allclose(found.plane, whole.plane, rtol=1e-9)
    np.testing.assert_array_equal(found.weights, whole.weights)


def test_pavement_beside_the_lane_is_not_in_the_plane(known):
    pavement = CELLS.xy[:, 1] > 1.5
    heights = 0.12 * pavement
    found = fitted(replace(CELLS, heights=heights), DESIGN, LANE)
    assert np.all(np.abs(found.plane) < [2e-3, 3e-4, 2e-3])
    np.testing.assert_array_equal(found.on_road, ~pavement)
    assert not found.weights[~found.on_road].any()


@pytest.mark.parametrize("column", [1, 2])
def test_cells_that_do_not_determine_a_plane_have_none(column):
    """All of them straight before the camera, or all as far away."""
    for value in (0.0, 1.0):
        flat = DESIGN.copy()
        flat[:, column] = value
        assert isinstance(surface_of(CELLS, flat, LANE), NotFitted)


def test_few_cells_and_unusable_ones_are_no_plane():
    few = np.full(len(CELLS.heights), np.nan)
    few[:5] = 0.0
    found = surface_of(replace(CELLS, heights=few), DESIGN, LANE)
    assert (
        isinstance(found, NotFitted) and found.reason == "cells whose height is known: 5, at least 6 needed"
    )
    unsure = replace(CELLS, variances=np.full(len(CELLS.heights), 0.31**2))
    assert isinstance(surface_of(unsure, DESIGN, LANE), NotFitted)
