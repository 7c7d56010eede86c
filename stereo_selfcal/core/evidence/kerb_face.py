"""How low the one edge of a stripe lies below the other: paint is level, a kerb and its face are not.

Where the face of a kerb, or the lower half of a rail, passes for a part of a stripe, the edge of the stripe
towards the lane lies lower than the plane of the fit. Both cameras look down on it from different places:
each sees the stripe wider than a level one, the more the more its line is inclined, and so not alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..camera.rig import StereoRig
from ..estimators.row_blocks import EdgeResiduals
from ..numerics.robust import Reweighting, fit_reweighted, scale_by_median
from ..rejection import NotFitted
from ..types import Array
from .profile import EDGE_STD_PX, MOST_RAMP_SIGMAS, REACH_PX

_EXCLUDED_SIGMAS = 2.0  # of normal errors, one in 40 to a side
_LEAST_BLOCKS = 4  # of a camera: their scatter is the uncertainty
# Paint has asphalt on both sides: where one edge has less than half the contrast of the other, a step of
# something else, or none, passes for it.
_LEAST_LIKE = 0.5
_REWEIGHTING = Reweighting(rounds=5, least_weight=1e-12)
_SCALE = scale_by_median(1.0)  # in standard deviations: they are not less than is known beforehand


@dataclass(frozen=True, slots=True)
class EdgeStep:
    """How low the edge of a boundary towards the lane lies below its other edge.

    Attributes:
        height_m: Of the face, > 0: a kerb or a rail; NaN where too little is seen of the stripe.
        std_m: Its standard deviation.
    """

    height_m: float = np.nan
    std_m: float = np.nan

    def surely_lower_than(self, height_m: float) -> bool:
        """Whether a face as high as this is excluded; not where nothing is known."""
        return bool(abs(self.height_m) + _EXCLUDED_SIGMAS * self.std_m < height_m)


UNSEEN = EdgeStep()


def measure_edge_steps(edges: EdgeResiduals, widths_m: Array, rig: StereoRig) -> tuple[EdgeStep, EdgeStep]:
    """Measure the faces of the boundaries of a lane: those that are part of their stripes in the fit.

    Under the plane of the stripe, an edge lower by h is seen h (fy / fx) m farther towards the camera, where
    its line moves by m columns a row.

    Args:
        edges: What the edges are off the fit.
        widths_m: (L,) widths of the stripes, the boundaries first.
        rig: Intrinsics and baseline.

    Returns:
        Those of the left and of the right boundary.
    """
    return _face(edges, widths_m, rig, 0), _face(edges, widths_m, rig, 1)


def _face(edges: EdgeResiduals, widths_m: Array, rig: StereoRig, stripe: int) -> EdgeStep:
    wider = [_wider(edges, float(widths_m[stripe]), camera, stripe) for camera in (0, 1)]
    (left_m, left_std_m), (right_m, right_std_m) = wider
    # The edge towards the lane: the right one of the left stripe, the left one of the right stripe.
    inclined = edges.slopes[:, stripe, 1 - stripe] * rig.fy / rig.fx * (-1.0 if stripe == 0 else 1.0)
    stretch = float(inclined[0] - inclined[1])
    if stretch == 0.0 or not np.all(np.isfinite(wider)):
        return UNSEEN
    return EdgeStep((left_m - right_m) / stretch, float(np.hypot(left_std_m, right_std_m)) / abs(stretch))


def _wider(edges: EdgeResiduals, width_m: float, camera: int, stripe: int) -> tuple[float, float]:
    """Return by how much a camera sees a stripe wider than the fit has it, and the standard deviation [m]."""
    off = edges.displacement[camera, stripe]  # (N, 2)
    columns = edges.columns[camera, stripe]  # (2, N)
    usable = edges.blocks.usable[camera, stripe] & np.all(np.abs(off) < REACH_PX, axis=1)
    usable &= edges.blocks.ramp_sigmas[camera, stripe] <= MOST_RAMP_SIGMAS
    information = np.diagonal(edges.blocks.information[camera, stripe], axis1=-2, axis2=-1)[:, :2]
    usable &= information.min(axis=1) >= _LEAST_LIKE**2 * information.max(
        axis=1
    )  # goes by the contrast's square
    if np.count_nonzero(usable) < _LEAST_BLOCKS:
        return np.nan, np.nan
    information = information[usable]
    variance_px = (edges.blocks.variance / np.maximum(information, 1e-9) + EDGE_STD_PX**2).sum(axis=1)
    m_per_px = width_m / (columns[1] - columns[0])[usable]
    wider, sigma = (off[usable, 1] - off[usable, 0]) * m_per_px, np.sqrt(variance_px) * m_per_px

    def fit(weights: Array, _: object) -> tuple[float, Array]:
        mean = float(np.average(wider, weights=weights / sigma**2))
        return mean, (wider - mean) / sigma

    found = fit_reweighted(fit, len(wider), _REWEIGHTING, _SCALE)
    assert not isinstance(found, NotFitted)  # a mean is always determined
    return found.solution, float(found.scale / np.sqrt((found.weights / sigma**2).sum()))
