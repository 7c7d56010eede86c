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

"""What an uncertainty is made of, for people: the terms of a covariance by what they contribute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.geometry.pose import DEGREES, POSE_COMPONENTS, DisplayUnit, Extrinsics, PoseComponent
from ..core.geometry.uncertainty import TERMS, UncertaintyTerm, total_covariance
from ..core.types import Array

# A sentence names the terms that leave at least this part of the whole standard deviation: the squares add
# up, so that a smaller one is less than a tenth of the variance.
_LEAST_NAMED = 0.3
_MOST_NAMED = 3
_MOST_IN_LINE = 2  # of the terminal, which is narrow
_LEAST_SHARE = 0.01  # a smaller one is not told in percent
_DIGITS = 3  # of the whole; the terms have as many decimals as it has


@dataclass(frozen=True, slots=True)
class Contribution:
    """One term beside the others.

    Attributes:
        name: Name of the term, snake_case.
        explanation: The same in words.
        std: Standard deviations that it alone leaves.
        share: Part of the variance that it is, 0 to 1, in the mean of the components of the pose.
    """

    name: str
    explanation: str
    std: Extrinsics
    share: float


def contributions(terms: Sequence[UncertaintyTerm]) -> list[Contribution]:
    """Return the terms of an uncertainty, the largest first.

    Args:
        terms: They add up to the whole.
    """
    whole = _variances(total_covariance(terms))
    found = [
        Contribution(
            term.name,
            TERMS.get(term.name, term.name.replace("_", " ")),
            std_of(term.covariance),
            float(np.mean(_variances(term.covariance) / np.where(whole > 0.0, whole, 1.0))),
        )
        for term in terms
    ]
    return sorted(found, key=lambda each: -each.share)


def std_of(covariance: Array) -> Extrinsics:
    """Return the standard deviations of a covariance (3, 3)."""
    return Extrinsics.from_array(np.sqrt(_variances(covariance)))


def variance_line(terms: Sequence[UncertaintyTerm]) -> str:
    """Return the largest terms with their shares of the variance, for a line; "" without terms."""
    largest = contributions(terms)[:_MOST_IN_LINE]
    named = [each for each in largest if each is largest[0] or each.share >= _LEAST_NAMED**2]
    return ", ".join(f"{100 * each.share:.0f} % {each.explanation}" for each in named)


def uncertainty_table(terms: Sequence[UncertaintyTerm]) -> dict[str, Any] | None:
    """Return sentences and rows for the page, None without terms."""
    if not terms:
        return None
    parts = contributions(terms)
    whole = std_of(total_covariance(terms))
    return {
        "headings": [f"{each.label.capitalize()} [{each.small_unit.symbol}]" for each in POSE_COMPONENTS],
        "sentences": [_sentence(component, parts, whole) for component in POSE_COMPONENTS],
        "rows": [
            {
                "cause": part.explanation[:1].upper() + part.explanation[1:],
                "cells": [_cell(component, part.std, whole) for component in POSE_COMPONENTS],
                "share": f"{100 * part.share:.0f} %" if part.share >= _LEAST_SHARE else "< 1 %",
                "bar": f"{100 * part.share:.0f}",
            }
            for part in parts
        ],
        "sum": [_cell(component, whole, whole) for component in POSE_COMPONENTS],
    }


def unit_symbol(unit: DisplayUnit) -> str:
    """Return what follows a number on the page: a space and the unit, or the sign of degrees."""
    return "°" if unit == DEGREES else f" {unit.symbol}"


def _sentence(component: PoseComponent, parts: Sequence[Contribution], whole: Extrinsics) -> str:
    """Return the standard deviation of one component, and the terms it is mostly made of."""
    all_of_it = component.of(whole)
    ranked = sorted(parts, key=lambda part: -component.of(part.std))[:_MOST_NAMED]
    named = [
        part for part in ranked if part is ranked[0] or component.of(part.std) >= _LEAST_NAMED * all_of_it
    ]
    causes = ", ".join(f"{_cell(component, part.std, whole, 2)} {part.explanation}" for part in named)
    total = _cell(component, whole, whole, 2) + unit_symbol(component.small_unit)
    return f"{component.label.capitalize()} {total}: {causes}"


def _cell(component: PoseComponent, std: Extrinsics, whole: Extrinsics, n_digits: int = _DIGITS) -> str:
    """Return one standard deviation, with the decimals of the whole at a number of significant digits."""
    per_si = component.small_unit.per_si
    size = component.of(whole) * per_si
    decimals = max(0, n_digits - 1 - int(np.floor(np.log10(size)))) if size > 0.0 else 0
    return f"{component.of(std) * per_si:.{decimals}f}"


def _variances(covariance: Array) -> Array:
    """Return the diagonal (3,); what rounding has left below zero is zero."""
    diagonal: Array = np.maximum(np.diagonal(covariance), 0.0)
    return diagonal
