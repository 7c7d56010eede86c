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

"""What a world consists of, besides its polygons."""

from __future__ import annotations

from dataclasses import dataclass, field

from stereo_selfcal import StereoRig

from .cameras import Mount, Turn
from .mesh import Mesh
from .roads import Alignment
from .sensors import Sensor


@dataclass(frozen=True)
class Stripe:
    """A rectangle of the carriageway along the lane with another grey: paint, a seam or a repair.

    Attributes:
        t_m: Its middle across the lane.
        width_m: Its width.
        albedo: Its grey.
        dash_m: Length of its dashes, 0: it is solid.
        gap_m: Length of the gaps.
        phase_m: Where one dash begins.
        start_m: Where it begins.
        end_m: Where it ends.
        wear: Share of it that is gone.
        warmth: Its colour.
        taper: Whether it narrows to a point at its end.
        wobble_m: How far it leaves its place to either side.
        reflects: Whether it gives the light of headlamps back.
        slope: How far its middle goes to the left for each metre along the lane: paint is never parallel.
    """

    t_m: float
    width_m: float
    albedo: float
    dash_m: float = 0.0
    gap_m: float = 0.0
    phase_m: float = 0.0
    start_m: float = -10.0
    end_m: float = 400.0
    wear: float = 0.0
    warmth: float = 0.0
    taper: bool = False
    wobble_m: float = 0.0
    reflects: bool = False
    slope: float = 0.0


@dataclass(frozen=True)
class Surface:
    """The asphalt.

    Attributes:
        albedo: Mean grey.
        grain: Standard deviation of its stones, relative.
        grain_texel_m: Size of the smallest of them.
        cloud: Standard deviation of spots of some centimetres to metres, relative.
        blotch: Standard deviation of what is larger than metres, relative.
        cracks: How dark cracks are, 0: there are none.
        tracks: How much brighter the wheels' tracks are, relative.
        origin_m: Where in the textures this road lies.
        warmth: Its colour.
    """

    albedo: float
    grain: float
    grain_texel_m: float
    cloud: float
    blotch: float
    cracks: float
    tracks: float
    origin_m: tuple[float, float]
    warmth: float = 0.0


@dataclass(frozen=True)
class Shade:
    """A rectangle on the ground into which the sun does not shine.

    Attributes:
        centre_m: Its middle.
        half_m: Half its sides.
        yaw_rad: Its heading.
        soft_m: Width of its borders.
    """

    centre_m: tuple[float, float]
    half_m: tuple[float, float]
    yaw_rad: float
    soft_m: float


@dataclass(frozen=True)
class Lamp:
    """A lamp that lights the road.

    Attributes:
        place_m: Where it is.
        strength: Light at one metre.
        beam: Whether it is a headlamp that shines along the road (a low beam), or one that shines all around.
    """

    place_m: tuple[float, float, float]
    strength: float
    beam: bool


@dataclass(frozen=True)
class Light:
    """The light of a world.

    Attributes:
        sun: Direction to the sun, unit vector.
        sun_strength: Its light on a surface that faces it.
        ambient: Light from everywhere.
        sky: Brightness of the sky above, and at the horizon.
        clouds: Standard deviation of the clouds, relative.
        haze_m: Distance at which two thirds are haze.
        shades: Shadows.
        dapple: Share of the sun that leaves take away, 0: there are no trees above.
        dapple_m: Size of a tile of the leaves' shadows.
        dapple_reach_m: Where the leaves are: from, to along the road.
        lamps: Lamps.
    """

    sun: tuple[float, float, float]
    sun_strength: float
    ambient: float
    sky: tuple[float, float]
    clouds: float
    haze_m: float
    shades: tuple[Shade, ...] = ()
    dapple: float = 0.0
    dapple_m: float = 6.0
    dapple_reach_m: tuple[float, float] = (0.0, 0.0)
    lamps: tuple[Lamp, ...] = ()


@dataclass(frozen=True)
class Scene:
    """All that the renderer needs.

    Attributes:
        rig: The rig as its users know it.
        mount: Where it is.
        turn: How its right camera is turned.
        road: Shape of the road.
        surface: Its asphalt.
        stripes: What is painted on it, the last on top.
        mesh: All polygons.
        light: The light.
        wet: How wet the road is, 0: dry, 1: puddles that mirror.
        sensor: What happens to the light in the cameras.
        along_lane: Whether the textures of what lies flat follow the road, and not the camera's heading.
    """

    rig: StereoRig
    mount: Mount
    turn: Turn
    road: Alignment
    surface: Surface
    stripes: tuple[Stripe, ...]
    mesh: Mesh
    light: Light
    wet: float
    sensor: Sensor = field(default_factory=Sensor)
    along_lane: bool = False
