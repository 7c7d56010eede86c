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

"""One Gauss-Newton step: the road's parameters from the edge displacements of all blocks of rows.

Each block of rows gives the displacements of both edges of a stripe and of the blur. The blocks are weighted
robustly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..numerics.linear import rank_of, solve_linear
from ..numerics.robust import Reweighting, fit_reweighted
from ..numerics.statistics import MEDIAN_CHI2_3, upper_median
from ..rejection import Bound, NotFitted
from ..road.stripe_model import N_POSE
from ..types import Array
from .row_blocks import RowBlocks

# Two stripes in two images have 10 parameters. So many blocks give 36 displacements.
MIN_BLOCKS = 12
# A stripe with fewer blocks is left out of the fit: its own position and width use up two displacements each.
_MIN_STRIPE_BLOCKS = 3

_LEAST_STRIPES = 2  # one stripe on either side of the lane

_DETERMINED = "numbers of the road that the stripes determine"

# Tukey's biweight on the deviance of a block of three displacements: 95 % efficiency for normal errors.
_TUKEY_DEVIANCE = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class RoadPrior:
    """Which parameters of the road are free, and the prior of the stripes' heights.

    Attributes:
        varied: (5 + 3 L,) whether a parameter is free.
        heights_m: (L,) current heights of the stripes over the plane [m].
        height_stds_m: (L,) standard deviations of the prior of these heights about 0 [m]; 0 where a height is
            not free.
    """

    varied: npt.NDArray[np.bool_]
    heights_m: Array
    height_stds_m: Array

    def normal_equations(self, variance: float) -> tuple[Array, Array]:
        """Return the normal equations of the prior: information (P, P) and right side (P,) of the next step.

        Args:
            variance: Variance of the grey values, the unit of all information.
        """
        n = len(self.varied) + 2  # with the blur of both lenses
        information, right_side = np.zeros((n, n)), np.zeros(n)
        free = self.height_stds_m > 0.0
        index = len(self.varied) - len(free) + np.flatnonzero(free)
        information[index, index] = variance / self.height_stds_m[free] ** 2
        right_side[index] = -information[index, index] * self.heights_m[free]
        return information, right_side


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A step of all parameters.

    Attributes:
        step: (P,) change of all parameters; 0 for those that are not free.
        free: Indices of the free parameters.
        information: Information of the blocks that count about the free parameters, for noise of variance 1.
        relative: Deviances of these blocks over the deviance at which a block ceases to count.
        scale: Mean scale of the deviances of both cameras.
    """

    step: Array
    free: npt.NDArray[np.intp]
    information: Array
    relative: Array
    scale: float

    def covariance(self, variance: float) -> Array | NotFitted:
        """Return the covariance (P, P) of an M-estimator, or the reason why the weights do not give one.

        Let d be the deviance and w(d) the weight of a block. The covariance is ``E[w^2 d] / 3`` over the
        square of ``E[w + 2 w' d / 3]``, times the inverse information of the blocks that count (Huber, Robust
        Statistics, section 6.3).

        Args:
            variance: Variance of the grey values.
        """
        # dw/dd = -2 (1 - d / c) / c for the biweight w = (1 - d / c)^2.
        weight = 1.0 - self.relative
        steepness = float(np.mean(weight**2 - 4.0 / 3.0 * weight * self.relative))
        scatter = float(np.mean(weight**4 * self.relative)) * _TUKEY_DEVIANCE / 3.0
        if steepness <= 0.0:
            return NotFitted("mean slope of the weighted residuals", steepness, Bound.LEAST, 0.0)
        covariance = np.zeros((len(self.step), len(self.step)))
        if not np.all(np.isfinite(self.information)):
            return NotFitted(_DETERMINED, 0, Bound.LEAST, len(self.free))
        inverse = np.linalg.pinv(self.information, hermitian=True)
        covariance[np.ix_(self.free, self.free)] = inverse * (scatter / steepness**2 * variance)
        return covariance


def solve_step(
    blocks: RowBlocks, jac_columns_road: Array, reweightings: int, prior: RoadPrior
) -> Step | NotFitted:
    """Solve for the change of all parameters; each block is weighted robustly.

    Args:
        blocks: Displacements of the stripes' edges with their information.
        jac_columns_road: (P, 2 cameras, L stripes, 2 edges, N) derivative of the edge columns by the road's
            parameters.
        reweightings: Rounds of robust weights.
        prior: Which parameters are free, and the prior of the heights.

    Returns:
        The step, or the reason why there is none.
    """
    usable = blocks.usable
    enough = usable.sum(axis=(0, 2)) >= _MIN_STRIPE_BLOCKS
    n_usable, n_stripes = int(np.count_nonzero(usable)), int(np.count_nonzero(enough))
    if n_usable < MIN_BLOCKS:
        return NotFitted("blocks of rows that show both edges of a stripe", n_usable, Bound.LEAST, MIN_BLOCKS)
    if n_stripes < _LEAST_STRIPES:
        return NotFitted(
            "stripes with enough blocks of rows that show both edges", n_stripes, Bound.LEAST, _LEAST_STRIPES
        )
    determined = np.concatenate([np.ones(N_POSE, bool), np.tile(enough, 3)])
    free = np.flatnonzero(np.concatenate([prior.varied & determined, np.ones(2, bool)]))
    usable = usable & enough[:, None]
    camera_of = np.nonzero(usable)[0]
    # Displacements (left edge, right edge, blur) of each block by the free parameters: (M, 3, P).
    n_road = len(jac_columns_road)
    design = np.zeros((len(camera_of), 3, n_road + 2))
    design[:, :2, :n_road] = np.moveaxis(jac_columns_road, (0, 3), (-1, -2))[usable]
    design[np.arange(len(camera_of)), 2, n_road + camera_of] = 1.0
    design = design[..., free]
    information, displacement = blocks.information[usable], blocks.displacement[usable]
    informed = information @ design
    # The normal equations of each block are one row, so that weighting all of them is one product.
    normals = (np.swapaxes(design, -1, -2) @ informed).reshape(len(design), -1)
    sides = (blocks.gradient[usable][:, None] @ design)[:, 0]
    prior_information, prior_side = (part[..., free] for part in prior.normal_equations(blocks.variance))
    prior_information = prior_information[free]

    def fit(weights: Array, scale: float | Array) -> tuple[Array, Array] | NotFitted:
        weights = weights / scale
        normal = (weights @ normals).reshape(prior_information.shape) + prior_information
        rank = rank_of(normal, hermitian=True)
        if rank < len(normal):
            return NotFitted(_DETERMINED, rank, Bound.LEAST, len(normal))
        change = solve_linear(normal, weights @ sides + prior_side, _DETERMINED)
        if isinstance(change, NotFitted):
            return change
        residual = displacement - design @ change
        deviance = np.einsum("mi,mij,mj->m", residual, information, residual) / blocks.variance
        return change, deviance

    cameras = [np.flatnonzero(camera_of == i) for i in range(2)]

    def scales_of(deviances: Array) -> Array:
        """Return the scale of the deviances of each camera, (2,).

        The template may fit one camera worse, because its lens is sharper or softer. All blocks of that
        camera then have larger deviances. They get less weight, but are no outliers.
        """
        medians = [upper_median(deviances[own]) if len(own) else 0.0 for own in cameras]
        return np.maximum(1.0, np.array(medians) / MEDIAN_CHI2_3)

    how = Reweighting(rounds=reweightings, limit=_TUKEY_DEVIANCE, of_squares=True)
    found = fit_reweighted(fit, len(sides), how, lambda deviances: scales_of(deviances)[camera_of])
    if isinstance(found, NotFitted):
        return found
    scales = scales_of(found.residuals)
    relative = found.residuals / (scales * _TUKEY_DEVIANCE)[camera_of]
    counted = relative < 1.0
    if not counted.any():
        return NotFitted("blocks of rows that agree with the fit", 0, Bound.LEAST, 1)
    step = np.zeros(n_road + 2)
    step[free] = found.solution
    counted_information = (counted / scales[camera_of] @ normals).reshape(prior_information.shape)
    counted_information = counted_information + prior_information
    return Step(step, free, counted_information, relative[counted], float(scales.mean()))
