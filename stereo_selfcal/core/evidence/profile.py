"""Profile of the road along the lines: whether near and far parts of it lie in one plane.

The refinement drops rows that do not fit its plane, one by one, as it should: a car, a worn stripe. Where the
road ahead has another slope, all stripes miss the plane together, in both cameras, each by as much as it is
inclined in the image: that is no chance. From what the edges are off, row by row, this gives the heights of
the road along it, and the plane that a longer look would see.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.row_blocks import EdgeResiduals
from ..estimators.texture_alignment import TextureFit
from ..geometry.homography import horizon_row
from ..geometry.pose import Extrinsics
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..rejection import NotFitted
from ..tolerances import AGREEMENT
from ..types import Array, Mask

# The road that is meant: from where a camera behind a windscreen begins to see it, to where a pixel of
# disparity is a tenth of the height of the camera (the paper's rig).
NEAR_M, FAR_M = 5.0, 20.0
# Heights at these distances [m], linear between them: a change of slope shows within a few metres.
_NODES_M = np.array([3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0])
_N_STEPS = 61  # of the plane through them
# Before anything is seen: a road falls or rises by this at a node [m], its slope changes by this from one
# node to the next (half of what a crest or dip of 250 m radius does in 5 m, the sharpest in a street), and it
# bends by this [1/m], the sharpest bend for which lines pass for straight.
_HEIGHT_STD_M, _SLOPE_STD, _BEND_STD_PER_M = 0.3, 0.01, 1e-3
# Edges of paint are straight to a tenth of a pixel: no block weighs more than that.
EDGE_STD_PX = 0.1
# One step of least squares sees an edge as far as it is smeared, about a pixel. What is farther off it puts
# too near: a road falling by 58 mm at 15 m was measured as 31 +- 1 mm.
REACH_PX = 1.0
# Even of that it sees half, where a lens smears by half a pixel: 17 mm at 15 m as 9.
_SEEN_SHARE = 0.5
_LEAST_SHARE = 0.5  # of the edges at a distance, within reach: else chance picks them
WIDE_REACH_PX = 5.0  # the window of the refinement
MOST_RAMP_SIGMAS = 3.0  # a ramp steeper than any lens's stands for an edge that is elsewhere than in the fit
# Of a height: one false alarm in 15 000 for normal errors.
_BENT_SIGMAS = 4.0
_REWEIGHTING = Reweighting(rounds=5)
_SCALE = scale_by_median(1.0)  # in standard deviations: they are not less than is known beforehand


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """Heights of the road along it, over the plane of the fit.

    Attributes:
        at_m: (K,) distances [m].
        heights_m: (K,) heights there [m].
        stds_m: (K,) their standard deviations [m].
        change: (2,) height [m] and pitch [rad] of the plane 5 to 20 m ahead, less those of the fit.
        covariance: (2, 2) of it: great where the road is not seen that far.
        seen_share: Least part of a height that is seen, where the road is bent.
    """

    at_m: Array
    heights_m: Array
    stds_m: Array
    change: Array
    covariance: Array
    seen_share: float = 1.0

    @property
    def std(self) -> Array:
        """(2,) standard deviations of the change."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations

    @property
    def bent(self) -> bool:
        """Whether the road surely leaves the plane of the fit where it is seen."""
        return bool(np.any(np.abs(self.heights_m) > _BENT_SIGMAS * self.stds_m))

    @property
    def bends_at_m(self) -> float:
        """Where it does so first on the road that is meant [m]; infinite where it does not."""
        bent = (np.abs(self.heights_m) > _BENT_SIGMAS * self.stds_m) & (self.at_m > NEAR_M)
        return float(self.at_m[np.argmax(bent)]) if bent.any() else np.inf

    @property
    def sees_ahead(self) -> bool:
        """Whether a slope ahead that makes another plane of the road is surely excluded."""
        return bool(np.all(np.abs(self.change) + _BENT_SIGMAS * self.std <= AGREEMENT[:2]))


def measure_profile(edges: EdgeResiduals, rig: StereoRig, pose: Extrinsics, *, wide: bool = False) -> Profile:
    """Measure heights of the road from what the edges of the stripes are off.

    A point higher by z at the distance x is seen fy z / x rows higher, so that an edge of slope m is off by
    m fy z / x; where the lane bends by k, by -k fx x / 2.

    Args:
        edges: What the edges are off.
        rig: Intrinsics and baseline.
        pose: The fit.
        wide: Whether edges count that are too far off to be measured well: they show that there is another
            slope ahead, of that size at least.
    """
    columns = np.moveaxis(edges.columns, 2, -1)  # (2, L, N, 2)
    below = edges.rows[:, None] - horizon_row(rig, pose, columns)
    x = rig.fy * pose.height_m / np.maximum(below, 1.0)
    clear = (edges.blocks.usable & (edges.blocks.ramp_sigmas <= MOST_RAMP_SIGMAS))[..., None]
    within = clear & (np.abs(edges.displacement) < (WIDE_REACH_PX if wide else REACH_PX))
    usable = within & (x < (_NODES_M[-1] if wide else _end_of_sight_m(x, clear, within)))
    slopes = np.broadcast_to(edges.slopes[:, :, None], columns.shape)
    information = np.diagonal(edges.blocks.information, axis1=-2, axis2=-1)[..., :2]
    off, slope, at = edges.displacement[usable], slopes[usable], x[usable]
    variance = edges.blocks.variance / np.maximum(information[usable], 1e-9) + EDGE_STD_PX**2
    jac_off_heights, jac_off_bend = (slope * rig.fy / at)[:, None] * _hats(at), -rig.fx * at / 2.0
    found = _fit(jac_off_heights, jac_off_bend, off, variance)
    near = at <= found.bends_at_m
    if not wide and not near.all():
        # From there on edges are farther off with every metre, and soon out of reach.
        found = _fit(jac_off_heights[near], jac_off_bend[near], off[near], variance[near])
    return replace(found, seen_share=_SEEN_SHARE)


def _end_of_sight_m(x: Array, clear: Mask, within: Mask) -> float:
    """Return from where on most edges are out of reach [m]: those that are not are there by chance.

    Args:
        x: Distances of the edges [m], of any shape.
        clear: Whether there is an edge, no steeper and no softer than the lens makes it; broadcast to x.
        within: Whether it is near enough to the fit besides.
    """
    interval = np.digitize(x, _NODES_M)
    for i in range(1, len(_NODES_M)):
        here = interval == i
        if np.count_nonzero(here & within) < _LEAST_SHARE * np.count_nonzero(here & clear):
            return float(_NODES_M[i - 1])
    return float(_NODES_M[-1])


def profile_of_asphalt(texture: TextureFit) -> Profile:
    """Measure the profile of a road from the heights of the cells of its asphalt over its plane."""
    at_m = texture.cells_xy_m[:, 0]
    seen = np.isfinite(texture.cells_height_m) & (at_m < _NODES_M[-1])
    at_m, heights_m, variances = at_m[seen], texture.cells_height_m[seen], texture.cells_variance[seen]
    return _fit(_hats(at_m), np.zeros(len(at_m)), heights_m, variances)


def _hats(at_m: Array) -> Array:
    """Return the share (N, K) of the nodes in places between them."""
    return np.stack([np.interp(at_m, _NODES_M, one) for one in np.eye(len(_NODES_M))], axis=1)


def _fit(jac_off_heights: Array, jac_off_bend: Array, off: Array, variance: Array) -> Profile:
    """Fit heights at the nodes, and a bend, to measurements (N,) by their derivatives (N, K) and (N,)."""
    design = np.column_stack([jac_off_heights, jac_off_bend])
    prior = _prior()

    def fit(weights: Array, _: object) -> tuple[tuple[Array, Array], Array]:
        weighted = design * (weights / variance)[:, None]
        inverse = np.linalg.inv(weighted.T @ design + prior)
        solution = inverse @ (weighted.T @ off)
        return (solution, inverse), (off - design @ solution) / np.sqrt(variance)

    solution, covariance = np.zeros(len(prior)), np.linalg.inv(prior)
    if len(off):
        found = fit_reweighted(fit, len(off), _REWEIGHTING, _SCALE)
        assert not isinstance(found, NotFitted)  # the prior determines what is not seen
        solution, covariance = found.solution[0], found.solution[1] * found.scale**2
    # The plane through the heights from near to far, by least squares.
    steps = np.linspace(NEAR_M, FAR_M, _N_STEPS)
    line = np.linalg.pinv(np.column_stack([np.ones(_N_STEPS), steps])) @ _hats(steps)
    # A road that lies higher under the camera makes it lower; one that rises ahead pitches it down.
    change = np.array([-1.0, 1.0])[:, None] * line
    n = len(_NODES_M)
    return Profile(
        _NODES_M,
        solution[:n],
        np.sqrt(np.diag(covariance)[:n]),
        change @ solution[:n],
        change @ covariance[:n, :n] @ change.T,
    )


def _prior() -> Array:
    """Return the information of the heights and of the bend before anything is seen, (K + 1, K + 1)."""
    slopes = np.diff(np.eye(len(_NODES_M)), axis=0) / np.diff(_NODES_M)[:, None]
    kinks = np.diff(slopes, axis=0) / _SLOPE_STD
    information = np.zeros((len(_NODES_M) + 1, len(_NODES_M) + 1))
    information[:-1, :-1] = kinks.T @ kinks + np.eye(len(_NODES_M)) / _HEIGHT_STD_M**2
    information[-1, -1] = 1.0 / _BEND_STD_PER_M**2
    return information
