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

"""Settings of the calibrator: each with its description, unit and range.

These dataclasses are the only list of the settings. The node declares its ROS parameters from them, the
configuration files are read into them, and a test compares the table of docs/parameters.md with them.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from .errors import ConfigError, shortened


@dataclass(frozen=True, slots=True)
class Setting:
    """Description of one setting, as the node declares it.

    Attributes:
        description: One line for people.
        unit: Unit, "" for counts and fractions.
        low: Smallest allowed value.
        high: Largest allowed value.
        whole: Whether it is a whole number.
        choices: Allowed words; empty for a number, whose limits are then given.
    """

    description: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False
    choices: tuple[str, ...] = ()


def _setting(default: Any, description: str, unit: str, low: float, high: float) -> Any:
    return field(
        default=default, metadata={"setting": Setting(description, unit, low, high, isinstance(default, int))}
    )


def _choice(default: str, choices: tuple[str, ...], description: str) -> Any:
    return field(default=default, metadata={"setting": Setting(description, choices=choices)})


@dataclass(frozen=True, slots=True)
class SearchConfig:
    """Search box of the genetic algorithm. It is so wide that no initial guess is needed."""

    height_min_m: float = _setting(0.3, "Lowest height of the baseline over the road", "m", 0.05, 20)
    height_max_m: float = _setting(4.0, "Greatest height of the baseline over the road", "m", 0.05, 20)
    pitch_max_rad: float = _setting(
        math.radians(20), "Greatest pitch, up or down", "rad", 0.001, math.radians(60)
    )
    roll_max_rad: float = _setting(
        math.radians(15), "Greatest roll, to either side", "rad", 0.001, math.radians(60)
    )

    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the lower and the upper corner of the box, each (height [m], pitch [rad], roll [rad])."""
        lower = (self.height_min_m, -self.pitch_max_rad, -self.roll_max_rad)
        return lower, (self.height_max_m, self.pitch_max_rad, self.roll_max_rad)


@dataclass(frozen=True, slots=True)
class ExtractionConfig:
    """Extraction of the lane lines (paper section 2.2)."""

    min_contrast_sigma: float = _setting(
        3.0, "Least edge contrast of a stripe point over the image noise", "sigma", 1, 20
    )
    min_line_rows: int = _setting(40, "Least length of a lane line in the image", "px", 10, 10000)
    min_radius_m: float = _setting(
        1000.0, "Smallest radius of the road that still counts as straight", "m", 10, 100000
    )
    sample_step_px: int = _setting(10, "Distance of the sampled image rows (paper: 10)", "px", 1, 100)
    horizon_fraction: float = _setting(
        0.9, "First sampled row, as a fraction of the vanishing point's height (paper: 90 %)", "", 0.5, 0.99
    )


@dataclass(frozen=True, slots=True)
class FitnessConfig:
    """Fitness of a candidate (paper section 2.3)."""

    k: float = _setting(1e-4, "K of the paper: the fitness is at most 1 / K", "", 1e-9, 1)
    parallel_weight: float = _setting(
        10.0, "Weight of the parallelism term E2 over the matching term E1", "", 0.01, 1000
    )
    max_misfit_px: float = _setting(
        1.0, "Greatest misfit of the lines under the best candidate", "px", 0.01, 100
    )


@dataclass(frozen=True, slots=True)
class GeneticConfig:
    """Genetic algorithm (paper Table II; its own settings are in config/collado2006.yaml).

    The defaults find the optimum as reliably as the paper's 100 individuals: in 2030 of 2030 runs over frames
    of 0 to 20 % noise. They take less than half the time. The result is accurate to 1e-5 of the search box:
    40 um, 0.0004 deg.
    """

    population: int = _setting(40, "Individuals in the population", "", 8, 100000)
    parent_fraction: float = _setting(0.2, "Part of the population that may become parents", "", 0.05, 1)
    child_fraction: float = _setting(0.9, "Children per generation over the population", "", 0.05, 1)
    crossover_probability: float = _setting(0.85, "Part of the children made by crossover", "", 0, 1)
    mutation_probability: float = _setting(0.1, "Probability of a child to mutate", "", 0, 1)
    max_generations: int = _setting(500, "Generations at most", "", 1, 100000)
    tolerance: float = _setting(
        1e-5, "Stop when the spread of the population over the search box is below this", "", 0, 1
    )


@dataclass(frozen=True, slots=True)
class TextureConfig:
    """Cross-check by the texture of the road surface, which must lie in the plane of the lines."""

    check: int = _setting(
        1,
        "Whether (1) to use the road surface: it checks the lines, helps to find them, improves the estimate",
        "",
        0,
        1,
    )
    required: int = _setting(
        0,
        "Whether (1) to refuse lines that no texture of the road surface can check; needs texture.check",
        "",
        0,
        1,
    )


@dataclass(frozen=True, slots=True)
class RefinementConfig:
    """Refinement of the estimate from lines by the grey values of their stripes."""

    stripes: int = _setting(
        1, "Whether (1) to fit the grey values of the stripes; 0: the estimate is that of the paper", "", 0, 1
    )


# Words of alignment.correct.
CORRECT_NOTHING, CORRECT_ROWS, CORRECT_ALL = "none", "rows", "all"


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """How the right camera is turned against the left one."""

    correct: str = _choice(
        CORRECT_ROWS,
        (CORRECT_NOTHING, CORRECT_ROWS, CORRECT_ALL),
        "What of the turn is corrected before a pose is estimated: none; rows: pitch and roll; all: yaw, too",
    )


@dataclass(frozen=True, slots=True)
class KnownConfig:
    """Frames that are followed from an accepted one, instead of looked at as if nothing were known.

    With the default, a cold look takes a part of what following takes; and a car has driven 30 m, over which
    a road stays as uneven as it is, and 2 s, in which no camera turns by warming up.
    """

    cold_every_s: float = _setting(
        2.0, "Time after which a frame is looked at as if nothing were known; 0: every frame", "s", 0, 10
    )


@dataclass(frozen=True, slots=True)
class CalibratorConfig:
    """All settings of a :class:`~stereo_selfcal.core.calibrator.Calibrator`.

    Raises:
        ConfigError: A value has the wrong type or is outside its range.
    """

    seed: int = _setting(0, "Seed of the random numbers: same input and seed, same result", "", 0, 2**31 - 1)
    search: SearchConfig = field(default_factory=SearchConfig)
    extraction: ExtractionConfig = field(default_factory=ExtractionConfig)
    fitness: FitnessConfig = field(default_factory=FitnessConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    texture: TextureConfig = field(default_factory=TextureConfig)
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    known: KnownConfig = field(default_factory=KnownConfig)

    def __post_init__(self) -> None:
        for name, value, setting in self.settings():
            _checked(name, value, setting)
        if not self.search.height_min_m < self.search.height_max_m:
            raise ConfigError(
                f"search.height_min_m is {self.search.height_min_m}, search.height_max_m is "
                f"{self.search.height_max_m}: the first must be the smaller"
            )
        if self.texture.required and not self.texture.check:
            raise ConfigError(
                "texture.required is 1, but texture.check is 0: what is not looked for cannot be required; "
                "set texture.check to 1 or texture.required to 0"
            )

    def settings(self) -> Iterator[tuple[str, int | float | str, Setting]]:
        """Yield (dotted name, value, description) of every setting, in declaration order."""
        for item in fields(self):
            value = getattr(self, item.name)
            if is_dataclass(value):
                for sub in fields(value):
                    yield f"{item.name}.{sub.name}", getattr(value, sub.name), sub.metadata["setting"]
            else:
                yield item.name, value, item.metadata["setting"]

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> CalibratorConfig:
        """Build from a mapping, flat with dotted names or nested, or a mix.

        Args:
            values: Settings that differ from the defaults.

        Raises:
            ConfigError: A name is unknown, a value has the wrong type or is outside its range.
        """
        defaults = cls()
        known = {name: setting for name, _, setting in defaults.settings()}
        sections: dict[str, dict[str, Any]] = {}
        for name, value in flatten(values).items():
            if name not in known:
                raise ConfigError(f"unknown setting {shortened(name)}: the settings are {', '.join(known)}")
            section, _, leaf = name.rpartition(".")
            sections.setdefault(section, {})[leaf] = _checked(name, value, known[name])
        changes = sections.pop("", {})
        for section, leaves in sections.items():
            changes[section] = replace(getattr(defaults, section), **leaves)
        return replace(defaults, **changes)


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a nested mapping as one level with dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _checked(name: str, value: Any, setting: Setting) -> int | float | str:
    """Return ``value`` as the type that the setting needs; raise ConfigError where it is wrong."""
    if setting.choices:
        if value not in setting.choices:
            raise ConfigError(f"{name} is {shortened(value)}: it must be one of {', '.join(setting.choices)}")
        return str(value)
    # NumPy's scalars are instances of numbers.Real, too. A switch, 0 or 1, may be written as false or true.
    switch = setting.whole and (setting.low, setting.high) == (0, 1)
    number = isinstance(value, numbers.Real) and (switch or not isinstance(value, bool))
    if not number or (setting.whole and not float(value).is_integer()):
        kind = "a whole number" if setting.whole else "a number"
        raise ConfigError(f"{name} is {shortened(value)}: {kind} is needed")
    if not setting.low <= value <= setting.high:
        raise ConfigError(
            f"{name} is {value}: it must lie in {setting.low} ... {setting.high} {setting.unit}".rstrip()
        )
    return int(value) if setting.whole else float(value)
