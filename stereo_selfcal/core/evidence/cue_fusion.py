"""Fusion of the estimates from lines and from the texture of the road surface.

The pixels of two stripes give the plane of the stripes to a millimetre. The road between them is uneven and
does not lie in that plane: heights under the stripes vary as those of the road surface do
(`core.road.surface`). The roughness is measured from the texture. With it, the estimate from lines has the
uncertainty of an estimate of the road, and both estimates can be weighted by their information.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimators.texture_alignment import TextureFit
from ..geometry.pose import POSE_COMPONENTS, Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, propagate_terms
from ..numerics.linear import invert, solve_linear
from ..numerics.statistics import UNLIKELY_CHI2_3
from ..rejection import Bound, NotFitted
from ..tolerances import AGREEMENT, WRONG
from ..types import Array
from .estimate import Estimate

_DETERMINED = "numbers of the pose that lines and texture determine"
_SURE_SIGMAS = 3.0  # one in 370 for normal errors


def same_road(a: Extrinsics, b: Extrinsics) -> bool:
    """Whether two poses differ by less than ``AGREEMENT`` in each component: they are of the same road."""
    return bool(np.all(np.abs(a.as_array() - b.as_array()) < AGREEMENT))


def too_uncertain(covariance: Array) -> NotFitted | None:
    """Return which component has three standard deviations of more than ``WRONG``; None where none has."""
    spread = _SURE_SIGMAS * np.sqrt(np.diag(covariance))
    worst = int(np.argmax(spread / WRONG))
    if spread[worst] <= WRONG[worst]:
        return None
    component = POSE_COMPONENTS[worst]
    unit = component.small_unit
    value, limit = (float(each[worst]) * unit.per_si for each in (spread, WRONG))
    what = f"three standard deviations of the {component.label}"
    return NotFitted(what, value, Bound.MOST, limit, unit.symbol)


def combine(lines: Estimate, texture: TextureFit) -> Estimate | NotFitted:
    """Return the mean of lines and texture, weighted by their information, with the terms of both.

    They share no pixel, as the texture is aligned without the paint. The unevenness of the road that both
    share is neglected. Where they differ by more than their covariances explain, a term
    ``combination_disagreement`` enlarges the covariance by as much (R. T. Birge, "The calculation of errors
    by the method of least squares", Phys. Rev. 40, 1932).

    Args:
        lines: Estimate from lines, with the terms of the road's shape.
        texture: The alignment of the road surface.

    Returns:
        The mean, or why there is none: one of them leaves a component of the pose open.
    """
    of_lines, of_texture = (invert(each.covariance, _DETERMINED) for each in (lines, texture))
    if isinstance(of_lines, NotFitted):
        return of_lines
    if isinstance(of_texture, NotFitted):
        return of_texture
    information = [of_lines, of_texture]
    total = invert(information[0] + information[1], _DETERMINED)
    if isinstance(total, NotFitted):
        return total
    line_pose, texture_pose = lines.pose.as_array(), texture.extrinsics.as_array()
    mean = total @ (information[0] @ line_pose + information[1] @ texture_pose)
    terms = [
        *propagate_terms(lines.terms, total @ information[0]),
        *propagate_terms(texture.terms, total @ information[1]),
    ]
    difference = line_pose - texture_pose
    weighted = solve_linear(lines.covariance + texture.covariance, difference, _DETERMINED)
    if isinstance(weighted, NotFitted):
        return weighted
    chi2 = float(difference @ weighted)
    if chi2 > UNLIKELY_CHI2_3:
        excess = total * (chi2 / len(difference) - 1.0)
        terms.append(UncertaintyTerm("combination_disagreement", (excess + excess.T) / 2.0))
    return replace(lines, pose=Extrinsics.from_array(mean), terms=merge_terms(terms))
