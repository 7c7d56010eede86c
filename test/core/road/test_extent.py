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

"""Which cells are road: steps at its sides, obstacles on it, and roads that are merely uneven."""

import numpy as np
import pytest

from stereo_selfcal.core.rejection import NotFitted
from stereo_selfcal.core.road.extent import OUTLIER_WEIGHT, find_extent
from stereo_selfcal.core.road.unevenness import (
    TYPICAL_MISMATCH_PX,
    TYPICAL_ROUGHNESS,
    unit_covariances,
)

N_STRIPS, MIDDLE = 7, 3
AHEAD_M = np.geomspace(4.0, 20.0, 10)
STRIP, X = (grid.ravel() for grid in np.meshgrid(np.arange(N_STRIPS), AHEAD_M))
ASIDE = 0.75 * (MIDDLE - STRIP)  # strip 0 is the leftmost one
DESIGN = np.column_stack([np.ones_like(X), X, ASIDE])
METRES = 0.005 * X
NOISE = (0.1 * METRES) ** 2
KERNEL, PROFILE = unit_covariances(np.column_stack([X, ASIDE]))
ROAD = TYPICAL_ROUGHNESS * KERNEL + PROFILE + np.diag((TYPICAL_MISMATCH_PX * METRES) ** 2)
PLANE = np.array([0.03, -0.004, 0.01])


def heights(seed=0, roughness=TYPICAL_ROUGHNESS):
    """Return the heights of a road that is as rough as it is said to be, over a plane that is off."""
    rng = np.random.default_rng(seed)
    of_road = roughness * KERNEL + np.diag(NOISE)
    return DESIGN @ PLANE + rng.multivariate_normal(np.zeros(len(X)), of_road, method="eigh")


def extent_of(y, which=slice(None)):
    return find_extent(y[which], DESIGN[which], NOISE[which], ROAD[which][:, which], STRIP[which], MIDDLE)


def test_a_road_without_steps_is_all_of_the_cells():
    """Of five roads none is cut, though a random walk of heights may look like a step."""
    for seed in range(5):
        extent = extent_of(heights(seed))
        assert extent.strips == (0, N_STRIPS - 1)
        assert np.all(extent.weights > 0.0)
        np.testing.assert_array_equal(
            extent.variances[extent.weights > OUTLIER_WEIGHT], NOISE[extent.weights > OUTLIER_WEIGHT]
        )


@pytest.mark.parametrize("step_m", [0.1, 0.18, -0.1])
@pytest.mark.parametrize("strips", [(2, 6), (0, 4), (2, 4)])
def test_a_road_ends_at_steps_along_it(step_m, strips):
    """A kerb on the left, on the right, on both sides: up, or down to a verge."""
    first, last = strips
    beyond = (first > STRIP) | (last < STRIP)
    extent = extent_of(heights() + step_m * beyond)
    assert extent.strips == strips
    assert not extent.weights[beyond].any() and extent.weights[~beyond].mean() > 0.7
    # What lies beyond counts for nothing in a fit that weights by these variances.
    assert np.all(extent.variances[beyond] > 1.0)


def test_a_pavement_with_most_of_the_cells_is_not_the_road():
    """The camera drives on the road: the strip in the middle belongs to it."""
    beyond = STRIP < MIDDLE - 0.5
    most = extent_of(heights() + 0.12 * beyond, np.nonzero((STRIP < 5) & ~((STRIP > 2) & (X > 12.0)))[0])
    assert most.strips == (3, 4)


def test_a_car_is_an_outlier_within_the_road():
    car = (STRIP >= 4) & (X > 8.0) & (X < 14.0)
    y = heights() + 0.4 * car
    extent = extent_of(y)
    assert extent.strips == (0, N_STRIPS - 1)
    assert not (extent.weights[car] > OUTLIER_WEIGHT).any()
    # Its variance is its distance from the road, over its weight: it does not draw the plane.
    assert np.all(extent.variances[car] > 0.4**2)
    weights = 1.0 / (extent.variances + np.diag(ROAD))
    plane = np.linalg.solve((DESIGN.T * weights) @ DESIGN, (DESIGN.T * weights) @ y)
    assert np.all(np.abs(plane - PLANE) < [0.02, 0.003, 0.01])


def test_a_step_needs_evidence():
    """A single cell beyond a step, or a step as small as the road is rough, ends no road."""
    assert extent_of(heights() + 0.02 * (STRIP < 2)).strips == (0, N_STRIPS - 1)
    one = np.nonzero((STRIP > 0) | (np.arange(len(STRIP)) == 0))[0]
    y = heights()
    y[0] += 0.05
    assert extent_of(y, one).strips[1] == N_STRIPS - 1


def test_a_road_of_one_strip_leaves_the_roll_open():
    narrow = np.nonzero(STRIP == MIDDLE)[0]
    found = extent_of(heights(), narrow)
    assert isinstance(found, NotFitted) and "two strips" in found.reason


def test_few_cells_are_no_road():
    few = np.nonzero(((STRIP == 3) | (STRIP == 4)) & (X < 5.0))[0]
    assert len(few) < 6
    assert isinstance(extent_of(heights(), few), NotFitted)
