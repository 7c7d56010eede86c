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

"""Checks of the fields of a result file. Each refusal is one sentence: the field, its value, the remedy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..core.errors import ConfigError, shortened
from ..core.types import Array
from .node_settings import NODE_NAME

REMEDY = "calibrate anew"
PROVENANCE = "provenance"
# What a whole number of 32 bits holds: frames, seed and schema, the seed's own range.
GREATEST_WHOLE = 2**31 - 1
# Of a variance over the square of its standard deviation, and of a correlation over 1: rounding is far
# below, an edited number far above.
ROUNDING = 1e-6


def required(section: Mapping[str, Any], name: str, prefix: str = PROVENANCE) -> Any:
    """Return the value of a field that has to be there."""
    if name not in section:
        raise ConfigError(
            f"{prefix}.{name} is missing: the file is no result of {NODE_NAME}, or not all of it; {REMEDY}"
        )
    return section[name]


def number(
    section: Mapping[str, Any], name: str, low: float, high: float, unit: str = "", prefix: str = PROVENANCE
) -> float:
    """Return a finite number within its range."""
    return _number(required(section, name, prefix), f"{prefix}.{name}" if prefix else name, low, high, unit)


def whole(section: Mapping[str, Any], name: str, low: int, high: int, prefix: str = PROVENANCE) -> int:
    """Return a whole number within its range."""
    value = required(section, name, prefix)
    if not isinstance(value, int) or isinstance(value, bool):
        raise wrong(f"{prefix}.{name}", value, "a whole number is needed")
    if not low <= value <= high:
        raise wrong(f"{prefix}.{name}", value, f"it must lie in {low} ... {high}")
    return value


def yes_or_no(section: Mapping[str, Any], name: str, prefix: str = PROVENANCE) -> bool:
    """Return a truth value."""
    value = required(section, name, prefix)
    if not isinstance(value, bool):
        raise wrong(f"{prefix}.{name}", value, "true or false is needed")
    return value


def numbers(
    values: Any, full_name: str, size: int, low: float = -math.inf, high: float = math.inf, unit: str = ""
) -> Array:
    """Return a list of so many finite numbers, each within its range, as an array (size,)."""
    if not isinstance(values, list) or len(values) != size:
        raise wrong(full_name, values, f"a list of {size} numbers is needed")
    return np.array([_number(value, full_name, low, high, unit) for value in values])


def covariance_of(values: Any, full_name: str, deviations: Array) -> Array:
    """Return a covariance whose standard deviations are known.

    Args:
        values: Its numbers, row by row.
        full_name: Name of the field.
        deviations: (N,) standard deviations that it has to have.
    """
    n = deviations.size
    covariance: Array = numbers(values, full_name, n * n).reshape(n, n)
    with np.errstate(all="ignore"):  # what overflows is found below
        correlation = covariance / np.outer(deviations, deviations)
    if not np.all(np.isfinite(correlation)) or np.any(np.abs(np.diag(correlation) - 1.0) > ROUNDING):
        raise wrong(full_name, values, "it contradicts the standard deviations")
    return part_of_covariance(values, full_name, deviations)


def part_of_covariance(values: Any, full_name: str, deviations: Array) -> Array:
    """Return a covariance that is a part of a whole.

    Args:
        values: Its numbers, row by row.
        full_name: Name of the field.
        deviations: (N,) standard deviations of the whole.
    """
    n = deviations.size
    covariance: Array = numbers(values, full_name, n * n).reshape(n, n)
    with np.errstate(all="ignore"):  # what overflows is found below
        scaled = covariance / np.outer(deviations, deviations)
    if (
        not np.all(np.isfinite(scaled))
        or np.any(np.abs(scaled - scaled.T) > ROUNDING)
        or float(np.linalg.eigvalsh(scaled)[0]) < -ROUNDING
    ):
        raise wrong(full_name, values, "no quantities vary together like this")
    return covariance


def mapping(values: Any, full_name: str, what: str) -> dict[str, Any]:
    """Return a section of the file.

    Args:
        values: What is there.
        full_name: Name of the section.
        what: What it has to hold, for the sentence.
    """
    if not isinstance(values, Mapping):
        raise wrong(full_name, values, f"{what} are needed")
    return {str(name): value for name, value in values.items()}


def wrong(name: str, value: Any, what: str) -> ConfigError:
    """Return the refusal of a value."""
    return ConfigError(f"{name} is {shortened(value)}: {what}; {REMEDY}")


def _number(given: Any, full_name: str, low: float, high: float, unit: str) -> float:
    try:
        value = math.nan if isinstance(given, bool | str) else float(given)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not math.isfinite(value):
        raise wrong(full_name, given, "a finite number is needed")
    if not low <= value <= high:
        raise wrong(full_name, given, f"it must lie in {low:g} ... {high:g} {unit}".rstrip())
    return value
