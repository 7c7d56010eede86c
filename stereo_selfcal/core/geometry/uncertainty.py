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

"""The covariance of a pose as a sum of named terms, one for each cause of uncertainty.

Causes are, for example, the noise, the road's roughness, and a kerb that cannot be ruled out. They are
independent of each other, and each has a covariance of its own. The sum of these terms is the covariance of
the pose.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..types import Array

# Meaning of each term, in the order in which the terms are listed.
TERMS = {
    "noise": "noise of the pixels",
    "misfit": "lines that agree less than their own noise promises",
    "mismatch": "disparity errors that neither noise nor the road's shape explains",
    "roughness": "unevenness of the road along the lane",
    "camber": "bend of the road's cross-section",
    "paint_angle": "lines that are not painted quite parallel",
    "stage_disagreement": "difference between the line fit and the fit of the stripes' grey values",
    "slope_seen": "slope ahead that differs from the slope near the car",
    "slope_unseen": "slope ahead where the road is not seen",
    "crown": "crown of the road between the lines",
    "kerb": "kerb beside a line that cannot be ruled out",
    "part_of_road": "difference between the planes of nearer and farther, narrower and wider road",
    "vergence": "turn of the right camera about the vertical that its calibration leaves",
    "rectification": "distortion of the disparities that the calibration leaves",
    "row_offset": "offset between the rows of both images that the calibration leaves",
    "turn_before": "turn of the right camera that was measured in a frame before",
    "ahead": "right camera that seems to sit farther ahead, as that of late images does",
    "synchronisation": "way of the car between the two images",
    "combination_disagreement": "difference between lines and texture beyond their uncertainties",
    "standing": "unevenness and slope of the place where the car stood",
    "motion": "motion of the car over its road",
    "scatter": "scatter of the frames beyond what their noise and the motion explain",
    "lean": "lean of the car on the cross fall of its road",
}


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyTerm:
    """One cause of uncertainty.

    Attributes:
        name: Name of the cause in snake_case; a key of :data:`TERMS`.
        covariance: (3, 3) of (height_m, pitch_rad, roll_rad) from this cause alone.
    """

    name: str
    covariance: Array


def total_covariance(terms: Iterable[UncertaintyTerm]) -> Array:
    """Return the sum (3, 3) of the terms; zeros where there are none."""
    total = np.zeros((3, 3))
    for term in terms:
        total = total + term.covariance
    return total


def merge_terms(terms: Iterable[UncertaintyTerm]) -> tuple[UncertaintyTerm, ...]:
    """Return one term for each name, in the order of :data:`TERMS`; terms of zeros are left out.

    Args:
        terms: Independent terms; terms of the same name are added.
    """
    sums: dict[str, Array] = {}
    for term in terms:
        sums[term.name] = sums[term.name] + term.covariance if term.name in sums else term.covariance
    order = [*TERMS, *(name for name in sums if name not in TERMS)]
    # Rounding may leave the two halves of a matrix different in their last digit.
    return tuple(
        UncertaintyTerm(name, (sums[name] + sums[name].T) / 2.0)
        for name in order
        if name in sums and np.any(sums[name])
    )


def propagate_terms(terms: Iterable[UncertaintyTerm], jacobian: Array) -> tuple[UncertaintyTerm, ...]:
    """Return the terms of ``jacobian @ x`` from the terms of x.

    Args:
        terms: Terms of x.
        jacobian: (3, 3) derivative by x, or a weight matrix.
    """
    return tuple(UncertaintyTerm(term.name, _sandwich(jacobian, term.covariance)) for term in terms)


def _sandwich(jacobian: Array, covariance: Array) -> Array:
    propagated = jacobian @ covariance @ jacobian.T
    symmetric: Array = (propagated + propagated.T) / 2.0
    return symmetric
