"""One step of Gauss and Newton: what the blocks of rows say of the road, block by block weighted robustly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..numerics.robust import Reweighting, fit_reweighted
from ..numerics.statistics import MEDIAN_CHI2_3, upper_median
from ..rejection import Bound, NotFitted
from ..road.stripe_model import N_POSE
from ..types import Array
from .row_blocks import RowBlocks

MIN_BLOCKS = 12  # of four stripe images, 10 parameters: 36 displacements at least
# A stripe with fewer blocks has no say: its own position and width take two displacements each.
_MIN_STRIPE_BLOCKS = 3

_LEAST_STRIPES = 2  # on either side of the lane

# Tukey's biweight on the deviance of a block of three displacements: 95 % efficiency for normal errors.
_TUKEY_DEVIANCE = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What is known of the road beforehand.

    Attributes:
        varied: (5 + 3 L,) the parameters that are free.
        heights_m: (L,) heights of the stripes over the plane so far [m].
        height_stds_m: (L,) their standard deviations about 0 [m]; 0 where they are not free.
    """

    varied: npt.NDArray[np.bool_]
    heights_m: Array
    height_stds_m: Array

    def heights(self, variance: float) -> tuple[Array, Array]:
        """Return the information (P, P) of the heights, and what it says of the next step (P,).

        Args:
            variance: Of the grey values, in which all information is measured.
        """
        n = len(self.varied) + 2  # with the blur of both lenses
        information, pull = np.zeros((n, n)), np.zeros(n)
        free = self.height_stds_m > 0.0
        place = len(self.varied) - len(free) + np.flatnonzero(free)
        information[place, place] = variance / self.height_stds_m[free] ** 2
        pull[place] = -information[place, place] * self.heights_m[free]
        return information, pull


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A step of all parameters.

    Attributes:
        step: (P,) of all parameters; 0 of those that are not free.
        free: Which ones are.
        information: Of the free ones, by the blocks that count, for noise of variance 1.
        relative: Deviances of these blocks, over that at which a block ceases to count.
        scale: Mean scale of the deviances of both cameras.
    """

    step: Array
    free: npt.NDArray[np.intp]
    information: Array
    relative: Array
    scale: float

    def covariance(self, variance: float) -> Array | NotFitted:
        """Return the covariance (P, P) of an M-estimator, or why the weights say nothing.

        With deviance d and weight w(d) of a block it is ``E[w^2 d] / 3`` over the square of
        ``E[w + 2 w' d / 3]``, times the inverse information of the blocks that count (Huber, Robust
        Statistics, section 6.3).

        Args:
            variance: Of the grey values.
        """
        # dw/dd = -2 (1 - d / c) / c for the biweight w = (1 - d / c)^2.
        weight = 1.0 - self.relative
        steepness = float(np.mean(weight**2 - 4.0 / 3.0 * weight * self.relative))
        scatter = float(np.mean(weight**4 * self.relative)) * _TUKEY_DEVIANCE / 3.0
        if steepness <= 0.0:
            return NotFitted("mean slope of the weighted residuals", steepness, Bound.LEAST, 0.0)
        covariance = np.zeros((len(self.step), len(self.step)))
        inverse = np.linalg.pinv(self.information, hermitian=True)
        covariance[np.ix_(self.free, self.free)] = inverse * (scatter / steepness**2 * variance)
        return covariance


def solve_step(
    blocks: RowBlocks, jac_columns_road: Array, reweightings: int, known: Known
) -> Step | NotFitted:
    """Solve for the change of all parameters, block by block weighted robustly.

    Returns:
        The step, or why there is none.
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
    enough_of = np.concatenate([np.ones(N_POSE, bool), np.tile(enough, 3)])
    free = np.flatnonzero(np.concatenate([known.varied & enough_of, np.ones(2, bool)]))
    usable = usable & enough[:, None]
    of_camera = np.nonzero(usable)[0]
    # Displacements (left edge, right edge, blur) of each block by the free parameters: (M, 3, P).
    n_road = len(jac_columns_road)
    design = np.zeros((len(of_camera), 3, n_road + 2))
    design[:, :2, :n_road] = np.moveaxis(jac_columns_road, (0, 3), (-1, -2))[usable]
    design[np.arange(len(of_camera)), 2, n_road + of_camera] = 1.0
    design = design[..., free]
    information, displacement = blocks.information[usable], blocks.displacement[usable]
    informed = information @ design
    # All blocks' normal equations in one row each: weighting them is one product.
    normals = (np.swapaxes(design, -1, -2) @ informed).reshape(len(design), -1)
    sides = (blocks.gradient[usable][:, None] @ design)[:, 0]
    prior, pull = (part[..., free] for part in known.heights(blocks.variance))
    prior = prior[free]

    def fit(weights: Array, scale: float | Array) -> tuple[Array, Array] | NotFitted:
        weights = weights / scale
        normal = (weights @ normals).reshape(prior.shape) + prior
        rank = int(np.linalg.matrix_rank(normal, hermitian=True)) if np.isfinite(normal).all() else 0
        if rank < len(normal):
            return NotFitted("numbers of the road that the stripes determine", rank, Bound.LEAST, len(normal))
        change = np.linalg.solve(normal, weights @ sides + pull)
        residual = displacement - design @ change
        deviance = np.einsum("mi,mij,mj->m", residual, information, residual) / blocks.variance
        return change, deviance

    cameras = [np.flatnonzero(of_camera == i) for i in range(2)]

    def scales_of(deviances: Array) -> Array:
        """Return the scale of the deviances of each camera, (2,).

        A camera that the template fits worse (its lens is sharper or softer) has larger deviances in all
        of its blocks: they weigh less, but are no outliers.
        """
        medians = [upper_median(deviances[own]) if len(own) else 0.0 for own in cameras]
        return np.maximum(1.0, np.array(medians) / MEDIAN_CHI2_3)

    how = Reweighting(rounds=reweightings, limit=_TUKEY_DEVIANCE, of_squares=True)
    found = fit_reweighted(fit, len(sides), how, lambda deviances: scales_of(deviances)[of_camera])
    if isinstance(found, NotFitted):
        return found
    scales = scales_of(found.residuals)
    relative = found.residuals / (scales * _TUKEY_DEVIANCE)[of_camera]
    counted = relative < 1.0
    if not counted.any():
        return NotFitted("blocks of rows that agree with the fit", 0, Bound.LEAST, 1)
    whole = np.zeros(n_road + 2)
    whole[free] = found.solution
    counted_information = (counted / scales[of_camera] @ normals).reshape(prior.shape) + prior
    return Step(whole, free, counted_information, relative[counted], float(scales.mean()))
