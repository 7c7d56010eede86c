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

"""What lies on the road of a world: paint, arrows, strips of other surfaces, shadows.

Lateral positions are in road coordinates, left positive [m]; greys are those of the world, before a
camera's gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .world import PAINT_GREY, LaneLine


@dataclass(frozen=True, slots=True)
class Paint:
    """A painted line with its state.

    Attributes:
        line: Place, width, dashes and grey level.
        worn: Share of the paint that is gone, in patches (0 ... 1).
    """

    line: LaneLine
    worn: float = 0.0


@dataclass(frozen=True, slots=True)
class Arrow:
    """An arrow painted on the road, pointing ahead.

    Attributes:
        s_m: Where its shaft begins, along the road [m].
        d_m: Lateral position of its middle [m].
        length_m: Length of the shaft and of the head together [m].
        head_m: Length of the head [m].
        head_width_m: Width of the head where it begins [m].
        shaft_width_m: Width of the shaft [m].
        grey: Grey level of the paint.
    """

    s_m: float
    d_m: float
    length_m: float = 5.0
    head_m: float = 2.0
    head_width_m: float = 0.9
    shaft_width_m: float = 0.15
    grey: float = PAINT_GREY


@dataclass(frozen=True, slots=True)
class Band:
    """An endless strip of another surface: grass, gravel, a bright verge.

    Attributes:
        right_m: Right border [m].
        left_m: Left border [m].
        grey: Mean grey level.
        texture_amplitude: Standard deviation of its texture seen from near [grey levels].
    """

    right_m: float
    left_m: float
    grey: float = 105.0
    texture_amplitude: float = 12.0


@dataclass(frozen=True, slots=True)
class Shadow:
    """A shadow on the road.

    Attributes:
        kind: "across": a strip across the road, from ``begin_m`` to ``end_m`` along it;
            "along": the same in lateral positions; "dappled": patches everywhere.
        begin_m: Where it begins [m].
        end_m: Where it ends [m].
        light: Share of the light that reaches the shadow (0 ... 1).
        soft_m: Width of its edges [m].
        skew: How far its edges move along the road per metre to the left (across only).
    """

    kind: Literal["across", "along", "dappled"]
    begin_m: float = 0.0
    end_m: float = 0.0
    light: float = 0.5
    soft_m: float = 0.05
    skew: float = 0.0
