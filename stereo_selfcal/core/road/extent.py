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

"""How far the road extends to either side, and which of its cells are no road surface.

A pavement, a verge or a traffic island beside the lane may hold half of the cells. It is higher than the road
by a step that runs along it. So each side may end at a step: the heights beyond it have an unknown offset.
Of all such extents, the one with the greatest likelihood is taken, with a prior against steps. Within it,
cars and other obstacles are outliers.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from ..numerics.robust import TUKEY_SIGMAS, tukey_weights
from ..numerics.statistics import SIGMA_OVER_MAD
from ..rejection import Bound, NotFitted
from ..types import Array, Indices, Mask

# Standard deviation of the height of what begins at a step: kerbs are 6 to 18 cm high. Each cell beyond it
# deviates further, as verges are no planes.
_STEP_STD_M, _BESIDE_STD_M = 0.15, 0.03
# A step within the few metres beside a lane is taken as rare as one in twenty, so that it needs evidence.
_STEP_LOG_ODDS = math.log(20.0)
_LEAST_STRIPS = 2  # of a road: with one, the roll is open

OUTLIER_WEIGHT = 0.5  # Tukey's weight at 2.5 robust standard deviations
LEAST_WEIGHT = 1e-3  # so the variance of an outlier is at most a thousand times its squared distance
_ROUNDS = 8  # of reweighting
_LEAST_COUNT = LEAST_WEIGHT**2  # least weight in the fit: it keeps the equations regular
# Planes through three cells that are tried: with 60 % of outliers, all but one in 10 000 of such draws hold a
# triple without any.
_N_TRIPLES = 200
_LEAST_SPREAD = 1e-4  # of a triple of cells: the determinant of its rows, each of length 1
# Least scale of the residuals: a road has no cell to a third of what the prior of its unevenness says.
_LEAST_SCALE = 1.0 / 3.0
_BORDER = 1e100  # more than any whitened height
_ENOUGH = "cells of a road of two strips that determine a plane"


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The cells that are road.

    Attributes:
        strips: First and last strip of the road.
        weights: (S,) robust weights, 0 ... 1; 0 beyond the road.
        variances: (S,) variances of the heights by noise; of outliers, and beyond the road, by their distance
            from it [m^2].
    """

    strips: tuple[int, int]
    weights: Array
    variances: Array


def find_extent(
    heights: Array, design: Array, noise: Array, road: Array, strip: Indices, middle: int
) -> Extent | NotFitted:
    """Return which cells are road.

    Args:
        heights: (S,) heights of the cells over a first plane [m].
        design: (S, 3) derivative of the heights by the parameters of a plane.
        noise: (S,) variances of the heights by noise [m^2].
        road: (S, S) covariance of the heights of a usual road.
        strip: (S,) strip along the road in which each cell lies.
        middle: Strip of the camera's path, which is road.
    """
    sigma = np.sqrt(noise + np.diag(road))
    first, last = int(strip.min()), int(strip.max())
    extents = [
        (i, j)
        for i in range(first, middle + 1)
        for j in range(middle, last + 1)
        if j - i + 1 >= _LEAST_STRIPS
    ]
    insides = np.array([(strip >= i) & (strip <= j) for i, j in extents]).reshape(-1, len(strip))
    rows, target = design / sigma[:, None], heights / sigma
    chosen, planes = _most_agreed(rows, target, insides)
    if not len(chosen):
        return NotFitted(_ENOUGH, 0, Bound.LEAST, 1)
    insides = insides[chosen]
    weights, residuals = _robust_fits(rows, target, insides, planes)
    # An outlier gets a larger variance, so that it counts less. The variances of the other cells stay as they
    # are; otherwise unevenness of the road would be treated as noise.
    added = (residuals * sigma) ** 2 / np.maximum(weights, LEAST_WEIGHT)
    variances = noise + np.where(insides & (weights < OUTLIER_WEIGHT), added, 0.0)
    ends = np.array(extents)[chosen]
    likelihoods = _log_likelihoods(heights, design, road + _beyond(strip, ends), variances)
    likelihoods -= _STEP_LOG_ODDS * ((ends[:, 0] > first).astype(float) + (ends[:, 1] < last))
    best = int(np.argmax(likelihoods))
    inside, no_road = insides[best], noise + (_STEP_STD_M / LEAST_WEIGHT) ** 2
    return Extent(
        extents[chosen[best]],
        np.where(inside, weights[best], 0.0),
        np.where(inside, variances[best], no_road),
    )


def _beyond(strip: Indices, ends: Indices) -> Array:
    """Return the covariances (E, S, S) that the steps at the ends (E, 2) of extents add beyond them."""
    left, right = (strip < ends[:, :1]).astype(float), (strip > ends[:, 1:]).astype(float)
    steps = left[:, :, None] * left[:, None] + right[:, :, None] * right[:, None]
    steps *= _STEP_STD_M**2
    np.einsum("eii->ei", steps)[...] += _BESIDE_STD_M**2 * (left + right)
    added: Array = steps
    return added


def _log_likelihoods(heights: Array, design: Array, covariances: Array, variances: Array) -> Array:
    """Return restricted log likelihoods of heights: those of the contrasts which no plane changes.

    Args:
        heights: (S,) heights.
        design: (S, 3) derivative of the heights by the parameters of a plane.
        covariances: (E, S, S) of the heights, without what differs from cell to cell.
        variances: (E, S) of that.
    """
    n, columns = len(heights), np.column_stack([design, heights])
    # The factor of a covariance with more rows below it holds these rows, whitened. Their own part of it is
    # of no use, and as large as keeps the whole positive definite.
    bordered = np.zeros((len(covariances), n + columns.shape[1], n + columns.shape[1]))
    bordered[:, :n, :n] = covariances
    bordered[:, n:, :n] = columns.T
    diagonal = np.einsum("eii->ei", bordered)
    diagonal[:, :n] += variances
    diagonal[:, n:] = _BORDER
    factors = np.linalg.cholesky(bordered)  # of the lower triangles
    whitened = np.swapaxes(factors[:, n:, :n], 1, 2)
    # The last diagonal number of the triangular factor is the contrast's length.
    diagonals = np.abs(np.diagonal(np.linalg.qr(whitened, mode="r"), axis1=1, axis2=2))
    scales = np.maximum(diagonals, np.finfo(float).tiny)
    roots = np.diagonal(factors, axis1=1, axis2=2)[:, :n]
    log_determinants = np.log(roots).sum(axis=1) + np.log(scales[:, :-1]).sum(axis=1)
    likelihoods: Array = -log_determinants - 0.5 * scales[:, -1] ** 2
    return likelihoods


def _robust_fits(rows: Array, target: Array, insides: Mask, planes: Array) -> tuple[Array, Array]:
    """Fit a plane robustly to each extent, from a first one: MM-estimates (Yohai, 1987), all at once.

    Args:
        rows: (S, 3) derivative of the cells' heights by the parameters of a plane, in standard deviations.
        target: (S,) heights, in standard deviations.
        insides: (E, S) cells of each extent.
        planes: (E, 3) first planes.

    Returns:
        Robust weights (E, S), 0 ... 1, and residuals (E, S) in standard deviations.
    """
    n_numbers = rows.shape[1]
    products = (rows[:, :, None] * rows[:, None, :]).reshape(len(rows), -1)
    columns = np.ascontiguousarray(rows.T)
    diagonal = slice(0, None, n_numbers + 1)
    residuals = target - planes @ columns
    scale_of = _Scales(insides)
    scale: Array = np.ones(len(insides))
    for _ in range(_ROUNDS):
        weights = insides * _weights(residuals, scale)
        normal = weights @ products
        traces = normal[:, diagonal].sum(axis=1)
        normal[:, diagonal] += np.finfo(float).eps * traces[:, None]
        right = (weights * target) @ rows
        solved = np.linalg.solve(normal.reshape(-1, n_numbers, n_numbers), right[..., None])
        planes = np.asarray(solved, np.float64)[..., 0]
        residuals = target - planes @ columns
        scale = scale_of(residuals)
    return insides * _weights(residuals, scale), residuals


def _weights(residuals: Array, scale: Array) -> Array:
    """Return Tukey's weights of residuals (E, S), of scales (E,)."""
    relative = residuals / (TUKEY_SIGMAS * scale)[:, None]
    relative *= relative
    weights: Array = tukey_weights(relative, _LEAST_COUNT)
    return weights


def _most_agreed(rows: Array, target: Array, insides: Mask) -> tuple[Indices, Array]:
    """Return for each extent the plane through three of its cells that most of them agree with.

    Args:
        rows: (S, 3) derivative of the cells' heights by the parameters of a plane, in standard deviations.
        target: (S,) heights, in standard deviations.
        insides: (E, S) cells of each extent.

    Returns:
        Which extents have enough cells that determine a plane, (K,), and these planes (K, 3).
    """
    n_numbers = rows.shape[1]
    enough = np.flatnonzero(insides.sum(axis=1) >= 2 * n_numbers)
    cells = [np.flatnonzero(insides[k]) for k in enough]
    chosen = np.array([each[_triples(len(each))] for each in cells], np.intp).reshape(-1, n_numbers).T
    first, second, third = (rows.take(each, axis=0).T for each in chosen)
    # Cramer's rule, as thousands of equations with three unknowns are solved.
    normals = _cross(second, third), _cross(third, first), _cross(first, second)
    determinants = first[0] * normals[0][0] + first[1] * normals[0][1] + first[2] * normals[0][2]
    lengths = np.sqrt(np.einsum("si,si->s", rows, rows)).take(chosen)
    apart = np.abs(determinants) > _LEAST_SPREAD * (lengths[0] * lengths[1] * lengths[2])
    determinants[~apart] = 1.0
    heights = target.take(chosen) / (determinants * TUKEY_SIGMAS)
    tried = heights[0] * normals[0] + heights[1] * normals[1] + heights[2] * normals[2]
    of_target, of_rows = target / TUKEY_SIGMAS, np.ascontiguousarray(rows.T)
    found, planes = [], []
    for index, (k, inside) in enumerate(zip(enough, cells, strict=True)):
        own = slice(index * _N_TRIPLES, (index + 1) * _N_TRIPLES)
        usable = apart[own]
        if usable.any():
            off = of_target[inside] - tried[:, own].T @ of_rows[:, inside]
            off *= off
            misfits = np.minimum(off, 1.0, out=off).sum(axis=1)
            misfits[~usable] = np.inf
            found.append(k)
            planes.append(TUKEY_SIGMAS * tried[:, own][:, int(np.argmin(misfits))])
    return np.array(found, np.intp), np.array(planes).reshape(-1, n_numbers)


@functools.lru_cache(maxsize=256)
def _triples(n_cells: int) -> Indices:
    """Return the triples of so many cells that are tried, (N_TRIPLES, 3): always the same."""
    triples = np.random.default_rng(0).integers(n_cells, size=(_N_TRIPLES, 3))
    triples.flags.writeable = False
    return triples


def _cross(first: Array, second: Array) -> Array:
    """Return the cross products (3, N) of vectors (3, N)."""
    x, y, z = first
    u, v, w = second
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


class _Scales:
    """Scales of residuals of extents: by the median, no more than their standard deviations."""

    def __init__(self, insides: Mask) -> None:
        """Create for the cells (E, S) of each extent."""
        counts, firsts = np.count_nonzero(insides, axis=1), np.arange(len(insides)) * insides.shape[1]
        self._middle = firsts + (counts - 1) // 2, firsts + counts // 2
        self._beyond = np.where(insides, 0.0, np.inf)

    def __call__(self, residuals: Array) -> Array:
        """Return the scale (E,) of residuals (E, S)."""
        ordered = np.abs(residuals)
        ordered += self._beyond
        ordered.sort(axis=1)
        lower, upper = (ordered.ravel().take(each) for each in self._middle)
        scales: Array = (lower + upper) * (0.5 * SIGMA_OVER_MAD)
        return np.minimum(np.maximum(scales, _LEAST_SCALE), 1.0)
