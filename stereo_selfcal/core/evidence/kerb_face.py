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

"""Height of one edge of a stripe below the other: paint is level, a kerb with its face is not.

The fit may take the face of a kerb, or the lower half of a rail, for a part of a stripe. Then the edge
towards the lane lies below the plane of the fit. The cameras look down on that edge from different positions.
Each sees the stripe wider than a level one, by more the more its line is inclined. So the two cameras measure
different widths, and their difference gives the height.
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

_EXCLUDED_SIGMAS = 2.0  # one-sided, one in 40 for normal errors
_LEAST_BLOCKS = 4  # in one camera: their scatter gives the uncertainty
# Paint has the road surface on both sides. Where one edge has less than half the contrast of the other, it is
# not an edge of paint.
_LEAST_CONTRAST_RATIO = 0.5
_REWEIGHTING = Reweighting(rounds=5, least_weight=1e-12)
# In standard deviations: the scatter is taken as no smaller than the variances say.
_SCALE = scale_by_median(1.0)


@dataclass(frozen=True, slots=True)
class EdgeStep:
    """How low the edge of a boundary towards the lane lies below its other edge.

    Attributes:
        height_m: Height of the other edge over it [m], > 0 for a kerb or a rail; NaN where too little of the
            stripe is seen.
        std_m: Its standard deviation [m].
    """

    height_m: float = np.nan
    std_m: float = np.nan

    def surely_lower_than(self, height_m: float) -> bool:
        """Whether the step is surely smaller than a height [m]; False where it was not measured."""
        return bool(abs(self.height_m) + _EXCLUDED_SIGMAS * self.std_m < height_m)


NOT_MEASURED = EdgeStep()


def measure_edge_steps(
    residuals: EdgeResiduals, widths_m: Array, rig: StereoRig
) -> tuple[EdgeStep, EdgeStep]:
    """Measure the edge steps of the two boundaries of a lane from the residuals of the stripes' fit.

    An edge that lies h below the plane of the stripe is seen h m (fy / fx) farther towards the camera. Here m
    is the slope of its line in columns a row.

    Args:
        residuals: Displacements of the edges from the fit.
        widths_m: (L,) widths of the stripes, the boundaries first.
        rig: Intrinsics and baseline.

    Returns:
        Edge steps of the left and of the right boundary.
    """
    return _edge_step(residuals, widths_m, rig, 0), _edge_step(residuals, widths_m, rig, 1)


def _edge_step(residuals: EdgeResiduals, widths_m: Array, rig: StereoRig, stripe: int) -> EdgeStep:
    """Return the edge step of one boundary, by the widths of its stripe in both cameras."""
    excess = [_excess_width(residuals, float(widths_m[stripe]), camera, stripe) for camera in (0, 1)]
    (left_m, left_std_m), (right_m, right_std_m) = excess
    # The edge towards the lane: the right one of the left stripe, the left one of the right stripe.
    inclined = residuals.slopes[:, stripe, 1 - stripe] * rig.fy / rig.fx * (-1.0 if stripe == 0 else 1.0)
    stretch = float(inclined[0] - inclined[1])
    if stretch == 0.0 or not np.all(np.isfinite(excess)):
        return NOT_MEASURED
    return EdgeStep((left_m - right_m) / stretch, float(np.hypot(left_std_m, right_std_m)) / abs(stretch))


def _excess_width(residuals: EdgeResiduals, width_m: float, camera: int, stripe: int) -> tuple[float, float]:
    """Return the width of a stripe in one camera minus that in the fit, and its standard deviation [m]."""
    displacement = residuals.displacement[camera, stripe]  # (N, 2)
    columns = residuals.columns[camera, stripe]  # (2, N)
    usable = residuals.blocks.usable[camera, stripe] & np.all(np.abs(displacement) < REACH_PX, axis=1)
    usable &= residuals.blocks.ramp_sigmas[camera, stripe] <= MOST_RAMP_SIGMAS
    information = np.diagonal(residuals.blocks.information[camera, stripe], axis1=-2, axis2=-1)[:, :2]
    # The information of an edge grows with the square of its contrast.
    usable &= information.min(axis=1) >= _LEAST_CONTRAST_RATIO**2 * information.max(axis=1)
    if np.count_nonzero(usable) < _LEAST_BLOCKS:
        return np.nan, np.nan
    information = information[usable]
    variance_px = (residuals.blocks.variance / np.maximum(information, 1e-9) + EDGE_STD_PX**2).sum(axis=1)
    m_per_px = width_m / (columns[1] - columns[0])[usable]
    excess, sigma = (
        (displacement[usable, 1] - displacement[usable, 0]) * m_per_px,
        np.sqrt(variance_px) * m_per_px,
    )

    def fit(weights: Array, _: object) -> tuple[float, Array]:
        mean = float(np.average(excess, weights=weights / sigma**2))
        return mean, (excess - mean) / sigma

    found = fit_reweighted(fit, len(excess), _REWEIGHTING, _SCALE)
    assert not isinstance(found, NotFitted)  # a mean is always determined
    return found.solution, float(found.scale / np.sqrt((found.weights / sigma**2).sum()))
