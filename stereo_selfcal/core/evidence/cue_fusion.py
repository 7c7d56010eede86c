"""Lines and asphalt together: what a road that is no plane does to an estimate from lines, and their mean.

The pixels of two stripes give the plane of the stripes to a millimetre, yet the road between them is not in
it: heights under the stripes walk as those under the asphalt do (`core.road.surface`). With the roughness
that the asphalt shows, the estimate from lines gets the uncertainty it has as an estimate of the road, and
both can be weighted by their information.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimators.texture_alignment import TextureFit
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, propagate_terms
from ..numerics.statistics import UNLIKELY_CHI2_3
from ..tolerances import AGREEMENT, WRONG
from ..types import Array
from .estimate import Estimate

_SURE_SIGMAS = 3.0  # one in 370


def same_road(a: Extrinsics, b: Extrinsics) -> bool:
    """Whether two estimates are nearer than what the asphalt could tell apart."""
    return bool(np.all(np.abs(a.as_array() - b.as_array()) < AGREEMENT))


def surely_right(covariance: Array) -> bool:
    """Whether three standard deviations of an estimate are less than what is called wrong."""
    return bool(np.all(_SURE_SIGMAS * np.sqrt(np.diag(covariance)) <= WRONG))


def combine(lines: Estimate, texture: TextureFit) -> Estimate:
    """Return the mean of lines and texture, weighted by their information, with the terms of both.

    They share no pixel, as the texture is aligned without the paint. That both may lie in the same hollow of
    the road is neglected. Where they differ by more than their covariances explain, a term
    ``combination_disagreement`` enlarges the covariance by as much (R. T. Birge, "The calculation of errors
    by the method of least squares", Phys. Rev. 40, 1932).

    Args:
        lines: Estimate from lines, with the shape of the road.
        texture: The alignment of the road surface.
    """
    information = [np.linalg.inv(lines.covariance), np.linalg.inv(texture.covariance)]
    total = np.linalg.inv(information[0] + information[1])
    of_lines, of_texture = lines.pose.as_array(), texture.extrinsics.as_array()
    mean = total @ (information[0] @ of_lines + information[1] @ of_texture)
    terms = [
        *propagate_terms(lines.terms, total @ information[0]),
        *propagate_terms(texture.terms, total @ information[1]),
    ]
    difference = of_lines - of_texture
    chi2 = float(difference @ np.linalg.solve(lines.covariance + texture.covariance, difference))
    if chi2 > UNLIKELY_CHI2_3:
        excess = total * (chi2 / len(difference) - 1.0)
        terms.append(UncertaintyTerm("combination_disagreement", (excess + excess.T) / 2.0))
    return replace(lines, pose=Extrinsics.from_array(mean), terms=merge_terms(terms))
