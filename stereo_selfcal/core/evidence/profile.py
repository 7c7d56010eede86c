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

"""Profile of the road along the lines: whether its near and far parts lie in one plane.

The fit of the stripes drops single rows that do not fit its plane, such as those of a car or a worn stripe.
Where the road ahead has another slope, all stripes miss the plane together, in both cameras. Each misses it
by an amount that grows with its slope in the image. That does not happen by chance. From the displacements of
the edges, row by row, this module estimates the heights of the road along the lane. It also gives the plane
that fits the road 5 to 20 m ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.row_blocks import EdgeResiduals
from ..geometry.homography import horizon_row
from ..geometry.pose import Extrinsics
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..rejection import NotFitted
from ..tolerances import AGREEMENT
from ..types import Array, Mask

# The part of the road that the pose describes. It begins where a camera behind a windscreen begins to see the
# road. It ends where a pixel of disparity is a tenth of the height of the camera (the paper's rig).
NEAR_M, FAR_M = 5.0, 20.0
# The profile has heights at these distances [m] and is linear between them: a change of slope is resolved to
# a few metres.
_NODES_M = np.array([3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0])
_N_STEPS = 61  # distances at which the plane is fitted to the profile
# Standard deviations of the priors: of the height of a node [m]; of the curvature of the lane [1/m]: the
# largest for which lines are still taken as straight.
_HEIGHT_STD_M, _BEND_STD_PER_M = 0.3, 1e-3
# Standard deviations of the change of slope from one node to the next, on sharp and on gentle roads. The
# first is half of the change over 5 m on a crest or dip of 250 m radius, the sharpest in a street. The second
# is that of nine of ten recorded roads: of the cells of 59 frames with a textured road surface, a likelihood
# of two kinds of roads is greatest with 0.1 % for 80 to 85 %, and 0.4 % for the others.
_SHARP_STD, _GENTLE_STD = 0.01, 0.001
_SHARP_SHARE = 0.1
_GREATEST_EXPONENT = 700.0  # of a floating-point number
# Edges of paint are straight to a tenth of a pixel: no block of rows is taken as more accurate than that.
EDGE_STD_PX = 0.1
# One step of least squares sees an edge only as far as it is smeared, about a pixel. It underestimates larger
# displacements: a road that falls by 58 mm at 15 m was measured as 31 +- 1 mm.
REACH_PX = 1.0
# Even of smaller ones it sees half where a lens smears by half a pixel: 17 mm at 15 m were measured as 9 mm.
_SEEN_SHARE = 0.5
_LEAST_SHARE = 0.5  # of the edges at a distance must be within reach; fewer may be so by chance
WIDE_REACH_PX = 5.0  # the window of the stripes' fit
MOST_RAMP_SIGMAS = 3.0  # a ramp steeper than a lens's means that the edge is not where the fit has it
# A height counts when it is this many of its standard deviations from zero: one false alarm in 15 000 for
# normal errors.
_BENT_SIGMAS = 4.0
_REWEIGHTING = Reweighting(rounds=5)
# In standard deviations: the scatter is taken as no smaller than the variances say.
_SCALE = scale_by_median(1.0)


@dataclass(frozen=True, slots=True, eq=False)
class SlopeChange:
    """What a profile says of the road 5 to 20 m ahead, under one prior.

    Attributes:
        probability: Probability of that prior, given what is seen; of a sharp road, no less than before.
        change: (2,) height [m] and pitch [rad] of the plane 5 to 20 m ahead, minus those of the fit.
        covariance: (2, 2) of the change.
    """

    probability: float
    change: Array
    covariance: Array


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """Heights of the road along the lane, over the plane of the fit.

    Attributes:
        at_m: (K,) distances [m].
        heights_m: (K,) heights there [m].
        stds_m: (K,) their standard deviations [m].
        change: (2,) height [m] and pitch [rad] of the plane 5 to 20 m ahead, minus those of the fit.
        covariance: (2, 2) of the change; large where the road is not seen that far.
        seen_share: The smallest part of a height that the measurement sees, where the road is bent.
        kinds: The change if the road is a gentle one, and if it is a sharp one; empty where the one above is
            all that is known.
    """

    at_m: Array
    heights_m: Array
    stds_m: Array
    change: Array
    covariance: Array
    seen_share: float = 1.0
    kinds: tuple[SlopeChange, ...] = ()

    @property
    def std(self) -> Array:
        """(2,) standard deviations of the change."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations

    @property
    def bent(self) -> bool:
        """Whether a height surely differs from zero: the road leaves the plane of the fit."""
        return bool(np.any(np.abs(self.heights_m) > _BENT_SIGMAS * self.stds_m))

    @property
    def magnification(self) -> float:
        """How much greater the change may be than measured.

        It is 1 where the heights are noise, and rises to ``1 / seen_share`` with their significance.
        """
        chi2 = float(np.max((self.heights_m / self.stds_m) ** 2, initial=0.0))
        return 1.0 + (1.0 / self.seen_share - 1.0) * chi2 / (chi2 + _BENT_SIGMAS**2)

    @property
    def seen_change(self) -> Array:
        """(2, 2) mean square of the measured change: what an estimate is off that does not allow for it."""
        squares: Array = sum(
            (kind.probability * np.outer(kind.change, kind.change) for kind in self._kinds),
            start=np.zeros((2, 2)),
        )
        return squares * self.magnification**2

    @property
    def unseen_change(self) -> Array:
        """(2, 2) covariance of the change beyond what is measured; large where the road is not seen."""
        covariance: Array = sum(
            (kind.probability * kind.covariance for kind in self._kinds), start=np.zeros((2, 2))
        )
        return covariance

    @property
    def _kinds(self) -> tuple[SlopeChange, ...]:
        return self.kinds or (SlopeChange(1.0, self.change, self.covariance),)

    @property
    def bends_at_m(self) -> float:
        """Distance of the first such height beyond 5 m [m]; infinite without one."""
        bent = (np.abs(self.heights_m) > _BENT_SIGMAS * self.stds_m) & (self.at_m > NEAR_M)
        return float(self.at_m[np.argmax(bent)]) if bent.any() else np.inf

    @property
    def sees_ahead(self) -> bool:
        """Whether the road 5 to 20 m ahead surely has the plane of the fit, to within ``AGREEMENT``."""
        return bool(np.all(np.abs(self.change) + _BENT_SIGMAS * self.std <= AGREEMENT[:2]))


def measure_profile(
    residuals: EdgeResiduals, rig: StereoRig, pose: Extrinsics, *, wide: bool = False
) -> Profile:
    """Measure heights of the road from the displacements of the stripes' edges.

    A point higher by z at the distance x is seen fy z / x rows higher, so an edge of slope m is displaced by
    m fy z / x. A curvature k of the lane displaces it by -k fx x / 2.

    Args:
        residuals: Displacements of the edges from the fit.
        rig: Intrinsics and baseline.
        pose: The fit.
        wide: Whether to use edges that are too far off to be measured well, too. They show that there is
            another slope ahead, and at least how large it is.
    """
    columns = np.moveaxis(residuals.columns, 2, -1)  # (2, L, N, 2)
    below = residuals.rows[:, None] - horizon_row(rig, pose, columns)
    x = rig.fy * pose.height_m / np.maximum(below, 1.0)
    clear = (residuals.blocks.usable & (residuals.blocks.ramp_sigmas <= MOST_RAMP_SIGMAS))[..., None]
    within = clear & (np.abs(residuals.displacement) < (WIDE_REACH_PX if wide else REACH_PX))
    usable = within & (x < (_NODES_M[-1] if wide else _usable_range_m(x, clear, within)))
    slopes = np.broadcast_to(residuals.slopes[:, :, None], columns.shape)
    information = np.diagonal(residuals.blocks.information, axis1=-2, axis2=-1)[..., :2]
    displacement, slope, at = residuals.displacement[usable], slopes[usable], x[usable]
    variance = residuals.blocks.variance / np.maximum(information[usable], 1e-9) + EDGE_STD_PX**2
    jac_heights, jac_bend = (slope * rig.fy / at)[:, None] * _node_weights(at), -rig.fx * at / 2.0
    found = _fit(jac_heights, jac_bend, displacement, variance)
    near = at <= found.bends_at_m
    if not wide and not near.all():
        # Beyond the bend, edges are farther off with every metre, and soon out of reach.
        found = _fit(jac_heights[near], jac_bend[near], displacement[near], variance[near])
    return replace(found, seen_share=_SEEN_SHARE)


def _usable_range_m(x: Array, clear: Mask, within: Mask) -> float:
    """Return the distance beyond which most edges are out of reach [m].

    The few edges within reach beyond it are there by chance.

    Args:
        x: Distances of the edges [m], of any shape.
        clear: Whether there is an edge, no steeper and no softer than the lens makes it; broadcast to x.
        within: Whether such an edge is within reach, too.
    """
    interval = np.digitize(x, _NODES_M)
    for i in range(1, len(_NODES_M)):
        here = interval == i
        if np.count_nonzero(here & within) < _LEAST_SHARE * np.count_nonzero(here & clear):
            return float(_NODES_M[i - 1])
    return float(_NODES_M[-1])


def _node_weights(at_m: Array) -> Array:
    """Return the weights (N, K) of the nodes at distances (N,), by linear interpolation."""
    return np.stack([np.interp(at_m, _NODES_M, one) for one in np.eye(len(_NODES_M))], axis=1)


def _fit(
    jac_displacement_heights: Array, jac_displacement_bend: Array, displacement: Array, variance: Array
) -> Profile:
    """Fit heights at the nodes and a curvature to displacements.

    Args:
        jac_displacement_heights: (N, K) derivative of the displacements by the heights.
        jac_displacement_bend: (N,) derivative by the curvature of the lane [1/m].
        displacement: (N,) measured displacements, of any unit.
        variance: (N,) their variances.
    """
    design = np.column_stack([jac_displacement_heights, jac_displacement_bend])
    prior = _prior(_SHARP_STD)

    def fit(weights: Array, _: object) -> tuple[tuple[Array, Array], Array]:
        weighted = design * (weights / variance)[:, None]
        inverse = np.linalg.inv(weighted.T @ design + prior)
        solution = inverse @ (weighted.T @ displacement)
        return (solution, inverse), (displacement - design @ solution) / np.sqrt(variance)

    solution, covariance = np.zeros(len(prior)), np.linalg.inv(prior)
    information, moment = np.zeros_like(prior), np.zeros(len(prior))
    if len(displacement):
        found = fit_reweighted(fit, len(displacement), _REWEIGHTING, _SCALE)
        assert not isinstance(found, NotFitted)  # the prior determines the nodes that are not seen
        solution, covariance = found.solution[0], found.solution[1] * found.scale**2
        weighted = design * (found.weights / variance / found.scale**2)[:, None]
        information, moment = weighted.T @ design, weighted.T @ displacement
    # The plane that fits the heights from NEAR_M to FAR_M, by least squares.
    steps = np.linspace(NEAR_M, FAR_M, _N_STEPS)
    line = np.linalg.pinv(np.column_stack([np.ones(_N_STEPS), steps])) @ _node_weights(steps)
    # A road that lies higher under the camera lowers the height; one that rises ahead increases the pitch.
    n = len(_NODES_M)
    change = np.zeros((2, len(prior)))
    change[:, :n] = np.array([-1.0, 1.0])[:, None] * line
    return Profile(
        _NODES_M,
        solution[:n],
        np.sqrt(np.diag(covariance)[:n]),
        change @ solution,
        change @ covariance @ change.T,
        kinds=_slope_changes(information, moment, change),
    )


def _slope_changes(information: Array, moment: Array, jac_change: Array) -> tuple[SlopeChange, ...]:
    """Return the change on a gentle and on a sharp road, each with its probability.

    Args:
        information: (K + 1, K + 1) of the measured displacements about heights and curvature.
        moment: (K + 1,) the displacements times their derivatives and weights.
        jac_change: (2, K + 1) derivative of the change by heights and curvature.
    """
    log_weights, posteriors = [], []
    for share, slope_std in ((1.0 - _SHARP_SHARE, _GENTLE_STD), (_SHARP_SHARE, _SHARP_STD)):
        prior = _prior(slope_std)
        solution = np.linalg.solve(information + prior, moment)
        # Likelihood of the displacements, integrated over all profiles of the prior.
        determinants = np.linalg.slogdet(prior)[1] - np.linalg.slogdet(information + prior)[1]
        log_weights.append(np.log(share) + 0.5 * (float(moment @ solution) + determinants))
        posteriors.append((solution, np.linalg.inv(information + prior)))
    # A road may bend beyond the part that is seen to be flat: that makes no road a gentle one.
    sharp = max(
        _SHARP_SHARE, 1.0 / (1.0 + math.exp(min(log_weights[0] - log_weights[1], _GREATEST_EXPONENT)))
    )
    return tuple(
        SlopeChange(weight, jac_change @ solution, jac_change @ covariance @ jac_change.T)
        for weight, (solution, covariance) in zip((1.0 - sharp, sharp), posteriors, strict=True)
    )


def _prior(slope_std: float) -> Array:
    """Return the prior information of the heights and of the curvature, (K + 1, K + 1).

    Args:
        slope_std: Standard deviation of the change of slope from one node to the next.
    """
    slopes = np.diff(np.eye(len(_NODES_M)), axis=0) / np.diff(_NODES_M)[:, None]
    kinks = np.diff(slopes, axis=0) / slope_std
    information = np.zeros((len(_NODES_M) + 1, len(_NODES_M) + 1))
    information[:-1, :-1] = kinks.T @ kinks + np.eye(len(_NODES_M)) / _HEIGHT_STD_M**2
    information[-1, -1] = 1.0 / _BEND_STD_PER_M**2
    return information
