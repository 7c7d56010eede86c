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

"""The plane of the own lane: a robust fit to the heights of cells, with the unevenness in its covariance.

The pose is that over the plane which fits the own lane best, by least squares over its area. The cells show
that lane with noise, and not everywhere. So the heights of the lane are predicted from those of the cells
(universal kriging: Cressie, Statistics for Spatial Data, 1993, section 3.4), and the plane is fitted to the
prediction. Where the lane is seen, its unevenness is known and is no uncertainty. Where it is not seen, its
unevenness is in the covariance, as far as the roughness of the road allows (`core.road.unevenness`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics.linear import invert, is_covariance, rank_of, solve_linear
from ..rejection import Bound, NotFitted
from ..types import Array, Indices, Mask
from .extent import OUTLIER_WEIGHT, Extent, find_extent
from .lane_points import LanePoints
from .unevenness import (
    TYPICAL_MISMATCH_PX,
    TYPICAL_ROUGHNESS,
    RoadUnevenness,
    estimate_unevenness,
    unit_covariances,
)

_WORST_STD_M = 0.3  # most standard deviation of a usable cell: the height of two kerbs
_DETERMINED = "numbers of the plane that the cells determine"
# Variances of cells so different that rounding decides.
_NOT_INVERTED = NotFitted("covariances of the cells that can be inverted", 0, Bound.LEAST, 1)
_LEAST_CELLS = 6  # twice the number of a plane's parameters


@dataclass(frozen=True, slots=True, eq=False)
class CellHeights:
    """Heights of the cells of a road.

    Attributes:
        heights: (C,) heights over a first plane [m]; NaN where a cell was not measured.
        variances: (C,) variances of the heights caused by the noise of the images [m^2].
        metres: (C,) change of a cell's height for one pixel of disparity [m].
        xy: (C, 2) positions relative to the point under the camera [m].
        strip: (C,) strip along the road in which each cell lies, 0 for the leftmost one.
    """

    heights: Array
    variances: Array
    metres: Array
    xy: Array
    strip: Indices


@dataclass(frozen=True, slots=True, eq=False)
class HalvesDifference:
    """How the planes by two halves of the cells differ, each fitted to one half alone.

    Attributes:
        plane: (3,) difference of the coefficients.
        covariance: (3, 3) of it, by noise and unevenness.
    """

    plane: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class LanePlane:
    """Plane of the own lane, without its uncertainty.

    Attributes:
        plane: (3,) coefficients of the design's columns.
        weights: (C,) robust weights of the cells, 0 ... 1.
    """

    plane: Array
    weights: Array


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Plane through the heights of cells.

    Attributes:
        plane: (3,) coefficients of the design's columns.
        covariance: (3, 3) of the coefficients, caused by noise and unevenness.
        noise_covariance: (3, 3) of the coefficients, caused by the noise and the mismatch alone.
        covariance_terms: Terms of the covariance, (3, 3) each, by name.
        unevenness: Deviation of the road from the plane.
        weights: (C,) robust weights, 0 ... 1.
        residuals: (C,) heights over the plane [m]; NaN where a cell was not measured.
        on_road: (C,) whether a cell lies between the steps at the sides of the road.
        noise_variance: (C,) variances of these heights, caused by the noise and the mismatch [m^2].
        halves: Differences of the planes by the near and the far, and by the left and the right half of the
            cells, without those halves that determine no plane.
    """

    plane: Array
    covariance: Array
    noise_covariance: Array
    covariance_terms: dict[str, Array]
    unevenness: RoadUnevenness
    weights: Array
    residuals: Array
    on_road: Mask
    noise_variance: Array
    halves: tuple[HalvesDifference, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class RoadCells:
    """The S cells whose height is known, and the covariances of a road there and at the T points of the lane.

    Attributes:
        cells: All cells.
        design: (C, 3) derivative of their heights by the parameters of the plane.
        lane: Points of the own lane.
        seen: (C,) which cells these are.
        y: (S,) heights [m].
        x: (S, 3) derivative of the heights by the parameters of the plane.
        noise: (S,) variances of the heights by the noise of the images [m^2].
        metres: (S,) change of a height for one pixel of disparity [m].
        kernel: (S + T, S + T) covariance of the road's heights for unit roughness.
        profile: The same for unit camber.
        extent: The cells that are road.
    """

    cells: CellHeights
    design: Array
    lane: LanePoints
    seen: Mask
    y: Array
    x: Array
    noise: Array
    metres: Array
    kernel: Array
    profile: Array
    extent: Extent

    def weights(self) -> Array:
        """Return the robust weights of all cells, (C,)."""
        weights = np.zeros(len(self.seen))
        weights[self.seen] = self.extent.weights
        return weights

    def variances(self, unevenness: RoadUnevenness) -> Array:
        """Return the variances (S,) of the heights by noise and mismatch, of outliers by their distance."""
        variances: Array = self.extent.variances + (unevenness.mismatch_px * self.metres) ** 2
        return variances

    def road(self, unevenness: RoadUnevenness) -> Array:
        """Return the covariance of the road's heights, of the shape of the kernel."""
        road: Array = unevenness.roughness * self.kernel + unevenness.camber**2 * self.profile
        return road

    def plane(self, unevenness: RoadUnevenness | None = None) -> LanePlane | NotFitted:
        """Fit the plane of the own lane, without its uncertainty.

        Args:
            unevenness: That of the road where it is known; None to take a typical one.
        """
        usual = unevenness or RoadUnevenness.typical()
        n, road = len(self.y), self.road(usual)
        plane_of_lane = self.lane.plane_and_parts(self._lane_strips(), ())[0]
        right = np.column_stack([self.x, road[:n, n:] @ plane_of_lane.T])
        solved = _solve_cells(road[:n, :n], self.variances(usual), self.x, right)
        if isinstance(solved, NotFitted):
            return solved
        to_plane, predicted = solved
        solve = to_plane + predicted - (predicted @ self.x) @ to_plane
        return LanePlane(solve @ self.y, self.weights())

    def surface(self, unevenness: RoadUnevenness | None = None) -> Surface | NotFitted:
        """Fit the plane of the own lane, with the road's unevenness and what other parts of it leave open.

        Args:
            unevenness: That of the road where it is known; None to estimate it from these cells.

        Returns:
            The plane, or the reason why the measured cells do not determine one.
        """
        y, x, extent, noise = self.y, self.x, self.extent, self.noise
        kernel, profile = self.kernel, self.profile
        of_cells = slice(len(y)), slice(len(y))
        try:
            unevenness = unevenness or estimate_unevenness(
                y, x, extent.variances, profile[of_cells], kernel[of_cells], self.metres
            )
        except np.linalg.LinAlgError:
            return _NOT_INVERTED
        variances, road = self.variances(unevenness), self.road(unevenness)
        solved = _solve_lane(road, variances, x, self.lane, self._lane_strips())
        if isinstance(solved, NotFitted):
            return solved
        solve, error, others = solved
        terms = {
            "noise": (solve * noise) @ solve.T,
            "mismatch": (solve * (variances - noise)) @ solve.T,
            "roughness": unevenness.roughness * error @ kernel @ error.T,
            "camber": unevenness.camber**2 * error @ profile @ error.T,
            "part_of_road": _part_of_road(others, y, variances, road),
        }
        covariance = sum(terms.values(), start=np.zeros((3, 3)))
        if not is_covariance(covariance):
            return NotFitted(_DETERMINED, min(rank_of(covariance), 2), Bound.LEAST, len(covariance))
        plane = solve @ y
        heights = road[of_cells] + np.diag(variances)  # their covariance
        return Surface(
            plane=plane,
            covariance=covariance,
            noise_covariance=(solve * variances) @ solve.T,
            covariance_terms=terms,
            unevenness=unevenness,
            weights=self.weights(),
            residuals=self.cells.heights - self.design @ plane,
            on_road=(self.cells.strip >= extent.strips[0]) & (self.cells.strip <= extent.strips[1]),
            noise_variance=self.cells.variances + (unevenness.mismatch_px * self.cells.metres) ** 2,
            halves=_compare_halves(y, x, heights, self.cells, self.seen, extent),
        )

    def _lane_strips(self) -> tuple[int, int]:
        """Return the first and last strip of the road; where no step ends it, unseen ones count too."""
        first, last = self.extent.strips
        seen, lane = self.cells.strip[self.seen], self.lane.strip
        return (
            first if first > seen.min() else int(lane.min()),
            last if last < seen.max() else int(lane.max()),
        )


def road_cells(cells: CellHeights, design: Array, lane: LanePoints) -> RoadCells | NotFitted:
    """Return the cells whose height is known; or why they do not determine a plane.

    Args:
        cells: The measured heights.
        design: (C, 3) derivative of the heights by the parameters of the plane.
        lane: Points of the own lane.
    """
    seen = np.isfinite(cells.heights) & (cells.variances < _WORST_STD_M**2)  # false for NaN as well
    lacking = _too_few(design[seen])
    if lacking is not None:
        return lacking
    y, x, noise, metres = cells.heights[seen], design[seen], cells.variances[seen], cells.metres[seen]
    n_seen = len(y)
    at = np.concatenate([cells.xy[seen], lane.xy])
    kernel, profile = unit_covariances(at)
    usual = TYPICAL_ROUGHNESS * kernel[:n_seen, :n_seen] + profile[:n_seen, :n_seen]
    usual += np.diag((TYPICAL_MISMATCH_PX * metres) ** 2)
    try:
        extent = find_extent(y, x, noise, usual, cells.strip[seen], lane.middle)
    except np.linalg.LinAlgError:
        return _NOT_INVERTED
    if isinstance(extent, NotFitted):
        return extent
    return RoadCells(cells, design, lane, seen, y, x, noise, metres, kernel, profile, extent)


def _part_of_road(others: Array, y: Array, variances: Array, road: Array) -> Array:
    """Return the covariance (3, 3) that the choice of the part of the road leaves in the plane.

    Args:
        others: (K, 3, S + T) deviations of the road at cells and points to the differences of the planes of
            other parts.
        y: (S,) heights of the seen cells [m].
        variances: (S,) of them, by noise and mismatch.
        road: (S + T, S + T) covariance of the road's heights.
    """
    of_cells = others[..., : len(y)]
    apart = of_cells @ y
    covariance = apart.T @ apart
    covariance += np.tensordot(of_cells * variances, of_cells, axes=((0, 2), (0, 2)))
    covariance += np.tensordot(others @ road, others, axes=((0, 2), (0, 2)))
    part: Array = covariance / max(len(others), 1)
    return part


def _compare_halves(
    y: Array, x: Array, covariance: Array, cells: CellHeights, seen: Mask, extent: Extent
) -> tuple[HalvesDifference, ...]:
    """Return how the planes by the near and far, and by the left and right half of the road's cells differ.

    Args:
        y: (S,) heights of the seen cells [m].
        x: (S, 3) derivative of the heights by the parameters of the plane.
        covariance: (S, S) of the heights.
        cells: All cells.
        seen: (C,) which of them were measured.
        extent: The cells that are road.
    """
    ahead_m, strip = cells.xy[seen, 0], cells.strip[seen]
    counted = extent.weights > OUTLIER_WEIGHT
    differences = []
    for first in (ahead_m <= np.median(ahead_m[counted]), 2 * strip < sum(extent.strips)):
        gains = [_plane_gain(x, covariance, half) for half in (first & counted, ~first & counted)]
        if gains[0] is not None and gains[1] is not None:
            apart = gains[0] - gains[1]
            differences.append(HalvesDifference(apart @ y, apart @ covariance @ apart.T))
    return tuple(differences)


def _plane_gain(x: Array, covariance: Array, which: Mask) -> Array | None:
    """Return the matrix (3, S) that gives a plane from the heights of some cells; None where they do not."""
    if not which.any() or _too_few(x[which]) is not None:
        return None
    weighted = solve_linear(covariance[np.ix_(which, which)], x[which], _DETERMINED)
    if isinstance(weighted, NotFitted):
        return None
    own = invert(weighted.T @ x[which], _DETERMINED)
    if isinstance(own, NotFitted):
        return None
    gain = np.zeros((x.shape[1], len(x)))
    gain[:, which] = own @ weighted.T
    return gain


def _too_few(design: Array) -> NotFitted | None:
    """Return what the seen cells (S, 3) lack to determine a plane; None where they do."""
    n_seen, n_numbers = design.shape
    if n_seen < _LEAST_CELLS:
        return NotFitted("cells whose height is known", n_seen, Bound.LEAST, _LEAST_CELLS)
    greatest = np.abs(design).max(axis=0)  # a column is zero where all cells are straight ahead of the camera
    rank = 0 if np.any(greatest == 0.0) else rank_of(design / greatest)
    return NotFitted(_DETERMINED, rank, Bound.LEAST, n_numbers) if rank < n_numbers else None


def _solve_cells(road: Array, noise: Array, x: Array, right: Array) -> tuple[Array, Array] | NotFitted:
    """Return the matrix that gives a plane from the heights of the cells, and what predicts other heights.

    Args:
        road: (S, S) covariance of the road's heights at the cells.
        noise: (S,) variances of the cells' heights besides that.
        x: (S, 3) derivative of the cells' heights by the parameters of the plane.
        right: (S, 3 + K) these, and the covariances of K other heights with those of the cells.

    Returns:
        The matrices (3, S) and (K, S).
    """
    covariance = road.copy()
    covariance[np.diag_indices(len(noise))] += noise
    solved = solve_linear(covariance, right, "heights of the cells that are independent")
    if isinstance(solved, NotFitted):
        return solved
    n_numbers = x.shape[1]
    weighted = solved[:, :n_numbers]
    of_plane = invert(weighted.T @ x, _DETERMINED)
    if isinstance(of_plane, NotFitted):
        return of_plane
    return of_plane @ weighted.T, solved[:, n_numbers:].T


def _solve_lane(
    road: Array, noise: Array, x: Array, lane: LanePoints, strips: tuple[int, int]
) -> tuple[Array, Array, Array] | NotFitted:
    """Return the matrices that give the planes of the parts of the lane from the heights of the cells.

    Args:
        road: (S + T, S + T) covariance of the road's heights at the cells and at the points of the lane.
        noise: (S,) variances of the cells' heights besides that.
        x: (S, 3) derivative of the cells' heights by the parameters of the plane.
        lane: The points of the lane.
        strips: First and last strip of the road.

    Returns:
        Heights of the cells to the plane of the lane (3, S); deviations of the road at cells and points to
        the error of that plane (3, S + T); and the same to the differences of the planes of other parts from
        it (12, 3, S + T), for the predicted differences and for their errors.
    """
    n = len(x)
    solved = _solve_cells(road[:n, :n], noise, x, np.column_stack([x, road[:n, n:]]))
    if isinstance(solved, NotFitted):
        return solved
    to_plane, predicted = solved
    # Heights of the lane over that plane, predicted from what remains of the cells' heights.
    to_lane = predicted - (predicted @ x) @ to_plane
    plane, parts = lane.plane_and_parts(strips)
    apart = parts - plane
    solve: Array = to_plane + plane @ to_lane
    return (
        solve,
        np.concatenate([solve, -plane], axis=1),
        np.concatenate([apart @ to_lane, -apart], axis=2),
    )
