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

"""What stands beside and on the road of a world: kerbs, rails, cars, walls.

Lateral positions are in road coordinates, left positive [m]; greys are those of the world, before a
camera's gain.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Kerb:
    """A straight step up, parallel to the lane, with the pavement behind it at the height of its top.

    Attributes:
        face_m: Lateral position of its face [m]; left of the camera when positive.
        height_m: Height of the step [m].
        top_width_m: Width of the kerb stone's top [m].
        face_grey: Grey level of the face.
        top_grey: Grey level of the top.
        behind_grey: Grey level of the pavement.
        behind_texture: Standard deviation of the pavement's texture [grey levels].
    """

    face_m: float
    height_m: float = 0.08
    top_width_m: float = 0.15
    face_grey: float = 150.0
    top_grey: float = 195.0
    behind_grey: float = 120.0
    behind_texture: float = 6.0


@dataclass(frozen=True, slots=True)
class GuardRail:
    """A steel rail along the road on posts that are not drawn, for cameras above it; see Barrier.

    Attributes:
        d_m: Lateral position [m].
        bottom_m: Height of its lower edge [m].
        top_m: Height of its upper edge [m]; below the camera.
        grey: Grey level of the middle.
        relief: Difference of its brighter upper to its darker lower half [grey levels].
    """

    d_m: float
    bottom_m: float = 0.40
    top_m: float = 0.70
    grey: float = 165.0
    relief: float = 50.0


@dataclass(frozen=True, slots=True)
class Car:
    """A car: a body with a cabin of dark windows on it.

    Attributes:
        s_m: Where its near end is, along the road [m].
        d_m: Lateral position of its middle [m].
        length_m: Length [m].
        width_m: Width [m].
        height_m: Height with the cabin [m].
        grey: Grey level of its sunny side.
    """

    s_m: float
    d_m: float
    length_m: float = 4.3
    width_m: float = 1.8
    height_m: float = 1.45
    grey: float = 140.0


@dataclass(frozen=True, slots=True)
class Wall:
    """Foliage or houses as an upright textured plane.

    Attributes:
        at_m: Distance ahead (across the view) or lateral position (along the road) [m].
        along: Whether it stands along the road, or across the view.
        height_m: Mean height [m].
        ragged_m: Standard deviation of its upper edge [m].
        grey: Mean grey level.
        texture_amplitude: Standard deviation of its texture [grey levels].
    """

    at_m: float
    along: bool = False
    height_m: float = 6.0
    ragged_m: float = 1.5
    grey: float = 80.0
    texture_amplitude: float = 25.0


@dataclass(frozen=True, slots=True)
class Strand:
    """What runs along the road at one height: a strip of a rail, a rope, a wire.

    Attributes:
        bottom_m: Height of its lower edge over the road [m].
        top_m: Height of its upper edge [m].
        grey: Grey level.
        sag_m: How far it hangs lower in the middle of a span [m].
        span_m: Length of a span along the road [m].
        hung_m: Where along the road a span begins [m].
    """

    bottom_m: float
    top_m: float
    grey: float
    sag_m: float = 0.0
    span_m: float = 35.0
    hung_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Posts:
    """Square posts in a row along the road.

    Attributes:
        d_m: Lateral position of their middles [m].
        height_m: Height [m].
        every_m: Distance from one to the next [m].
        first_m: Where along the road one of them stands [m].
        width_m: Their width [m].
        grey: Grey level.
    """

    d_m: float
    height_m: float
    every_m: float = 4.0
    first_m: float = 1.0
    width_m: float = 0.12
    grey: float = 120.0


@dataclass(frozen=True, slots=True)
class Barrier:
    """Strands above one another along a straight road: a guard rail, a wire barrier, cables overhead.

    Attributes:
        d_m: Lateral position [m].
        strands: From the lowest to the highest.
        posts: What carries them; None for nothing.
    """

    d_m: float
    strands: tuple[Strand, ...]
    posts: Posts | None = None


@dataclass(frozen=True, slots=True)
class Ridge:
    """A bar on the road along it, such as a rail of a railway.

    Attributes:
        d_m: Lateral position of its middle [m].
        height_m: Height of its top over the road [m].
        width_m: Width [m].
        top_grey: Grey level of its top.
        face_grey: Grey level of its faces.
    """

    d_m: float
    height_m: float = 0.17
    width_m: float = 0.07
    top_grey: float = 190.0
    face_grey: float = 60.0


@dataclass(frozen=True, slots=True)
class RoadStep:
    """An edge along the road beyond which its surface, with the paint on it, is higher or lower.

    Attributes:
        edge_m: Lateral position of the edge [m].
        height_m: Height of the surface beyond it over that of the lane [m]; below zero where it is lower.
        grey: Mean grey level of the surface beyond it.
        texture_amplitude: Standard deviation of its texture seen from near [grey levels].
        face_grey: Grey level of the face, seen where the surface beyond is higher.
    """

    edge_m: float
    height_m: float
    grey: float = 100.0
    texture_amplitude: float = 4.0
    face_grey: float = 55.0


@dataclass(frozen=True, slots=True)
class House:
    """The front of a house along the road.

    Attributes:
        begin_m: Where it begins along the road [m].
        end_m: Where it ends [m].
        height_m: Height [m].
        grey: Mean grey level.
        window_grey: Grey level of its windows.
        floor_m: Height of a floor [m].
        window_every_m: Distance from a window to the next, about [m].
        texture_amplitude: Standard deviation of the texture of its wall [grey levels].
    """

    begin_m: float
    end_m: float
    height_m: float
    grey: float = 130.0
    window_grey: float = 50.0
    floor_m: float = 3.0
    window_every_m: float = 2.5
    texture_amplitude: float = 5.0


@dataclass(frozen=True, slots=True)
class Facade:
    """Houses side by side along a straight road.

    Attributes:
        d_m: Lateral position of their fronts [m].
        houses: The houses, from near to far.
    """

    d_m: float
    houses: tuple[House, ...]
