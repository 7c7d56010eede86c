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

"""Fusion of the estimates from lines and from the texture of the road surface.

The pixels of two stripes give the plane of the stripes to a millimetre. The road between them is uneven and
does not lie in that plane: heights under the stripes vary as those of the road surface do
(`core.road.surface`). The roughness is measured from the texture. With it, the estimate from lines has the
uncertainty of an estimate of the road, and both estimates can be weighted by their information.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimators.texture_fit import TextureFit
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, propagate_terms
from ..numerics.linear import invert, solve_linear
from ..rejection import NotFitted
from ..types import Array
from .estimate import Estimate
from .rig_unknowns import RigResponse, rig_terms

_DETERMINED = "numbers of the pose that lines and texture determine"


def difference_covariance(
    lines: Estimate, texture: TextureFit, of_lines: RigResponse, of_surface: RigResponse
) -> Array:
    """Return the covariance (3, 3) of the difference between an estimate from lines and one from texture.

    Args:
        lines: Estimate from lines, without what is unknown of the rig.
        texture: The alignment of the road surface.
        of_lines: What the unknowns of the rig do to the lines' pose.
        of_surface: The same of the surface's pose.
    """
    apart = of_lines.changes - of_surface.changes
    covariance: Array = lines.covariance + texture.covariance + apart @ apart.T
    return covariance


def combine(
    lines: Estimate, texture: TextureFit, of_lines: RigResponse, of_surface: RigResponse
) -> Estimate | NotFitted:
    """Return the mean of lines and texture, weighted by their information, with the terms of both.

    They share no pixel, as the texture is aligned without the paint. What is unknown of the rig is common to
    both, and each responds to it in its own way: so it is estimated with the pose. The unevenness of the road
    that both share is neglected. Where they differ by more than their covariances explain, a term
    ``combination_disagreement`` enlarges the covariance by as much (R. T. Birge, "The calculation of errors
    by the method of least squares", Phys. Rev. 40, 1932).

    Args:
        lines: Estimate from lines, with the terms of the road's shape, without those of the rig.
        texture: The alignment of the road surface.
        of_lines: What the unknowns of the rig do to the lines' pose.
        of_surface: The same of the surface's pose.

    Returns:
        The mean, or why there is none: one of them leaves a component of the pose open.
    """
    response = RigResponse(np.concatenate([of_lines.changes, of_surface.changes]), of_lines.terms)
    both = response.changes @ response.changes.T
    both[:3, :3] += lines.covariance
    both[3:, 3:] += texture.covariance
    same_pose = np.concatenate([np.eye(3), np.eye(3)])
    weighted = solve_linear(both, same_pose, _DETERMINED)
    if isinstance(weighted, NotFitted):
        return weighted
    total = invert(same_pose.T @ weighted, _DETERMINED)
    if isinstance(total, NotFitted):
        return total
    gain = total @ weighted.T
    line_pose, texture_pose = lines.pose.as_array(), texture.extrinsics.as_array()
    terms = [
        *propagate_terms(lines.terms, gain[:, :3]),
        *propagate_terms(texture.terms, gain[:, 3:]),
        *rig_terms(response.through(gain)),
    ]
    difference = line_pose - texture_pose
    explained = solve_linear(
        difference_covariance(lines, texture, of_lines, of_surface), difference, _DETERMINED
    )
    if isinstance(explained, NotFitted):
        return explained
    excess = max(0.0, float(difference @ explained) / len(difference) - 1.0)
    terms.append(UncertaintyTerm("combination_disagreement", (total + total.T) / 2.0 * excess))
    mean = gain @ np.concatenate([line_pose, texture_pose])
    return replace(lines, pose=Extrinsics.from_array(mean), terms=merge_terms(terms))
