"""Lines and asphalt together: what a road that is no plane does to an estimate from lines, and their mean.

The pixels of two stripes give the plane of the stripes to a millimetre, yet the road between them is not in
it: heights under the stripes walk as those under the asphalt do (`core.road.surface`). With the roughness
that the asphalt shows, the estimate from lines gets the uncertainty it has as an estimate of the road, and
both can be weighted by their information.
"""

from __future__ import annotations

import numpy as np

from ..estimators.texture_alignment import TextureFit
from ..geometry.pose import Extrinsics
from ..numerics.statistics import UNLIKELY_CHI2_3
from ..tolerances import AGREEMENT, WRONG
from ..types import Array

_SURE_SIGMAS = 3.0  # one in 370


def same_road(a: Extrinsics, b: Extrinsics) -> bool:
    """Whether two estimates are nearer than what the asphalt could tell apart."""
    return bool(np.all(np.abs(a.as_array() - b.as_array()) < AGREEMENT))


def surely_right(covariance: Array) -> bool:
    """Whether three standard deviations of an estimate are less than what is called wrong."""
    return bool(np.all(_SURE_SIGMAS * np.sqrt(np.diag(covariance)) <= WRONG))


def combine(lines: Extrinsics, covariance: Array, texture: TextureFit) -> tuple[Extrinsics, Array]:
    """Return the mean of both estimates, weighted by their information, and its covariance.

    They share no pixel, as the asphalt is aligned without the paint; that both may lie in the same hollow of
    the road is neglected. Where they differ by more than their covariances explain, it is enlarged
    by as much (R. T. Birge, "The calculation of errors by the method of least squares", Phys. Rev. 40, 1932).

    Args:
        lines: Estimate from lines.
        covariance: (3, 3) of it, with the shape of the road.
        texture: The asphalt.
    """
    information = [np.linalg.inv(covariance), np.linalg.inv(texture.covariance)]
    total = np.linalg.inv(information[0] + information[1])
    mean = total @ (information[0] @ lines.as_array() + information[1] @ texture.extrinsics.as_array())
    difference = lines.as_array() - texture.extrinsics.as_array()
    chi2 = float(difference @ np.linalg.solve(covariance + texture.covariance, difference))
    if chi2 > UNLIKELY_CHI2_3:
        total = total * (chi2 / len(difference))
    return Extrinsics.from_array(mean), (total + total.T) / 2.0
