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

"""How a world is seen: its light, the cameras and their faults."""

from __future__ import annotations

from dataclasses import dataclass, field

from .world import Photometry


@dataclass(frozen=True, slots=True)
class Glare:
    """A smooth bright patch, made in the lens or on a wet road: each camera has its own.

    Attributes:
        u_px: Column of its middle [px].
        v_px: Row of its middle [px].
        sigma_u_px: Its extent along the rows [px].
        sigma_v_px: Its extent along the columns [px].
        grey: Light added in its middle [grey levels].
    """

    u_px: float
    v_px: float
    sigma_u_px: float
    sigma_v_px: float
    grey: float = 250.0


@dataclass(frozen=True, slots=True)
class Headlights:
    """The own car's lamps at night, in the middle of the rig, and what light there is besides.

    Attributes:
        ambient: Light everywhere, as a share of the day's.
        near: Light of the lamps right ahead, as a share of the day's.
        reach_m: Where half of it is left [m].
        spread_rad: Standard deviation of the beam to either side [rad].
    """

    ambient: float = 0.03
    near: float = 0.9
    reach_m: float = 18.0
    spread_rad: float = 0.4


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light that is seen: of a street, a car ahead, a car that comes.

    Attributes:
        s_m: Position along the road [m].
        d_m: Lateral position [m].
        z_m: Height over the plane z = 0 [m].
        radius_m: Standard deviation of its disc [m].
        grey: Grey level of its middle; far above white for a lamp that blinds.
    """

    s_m: float
    d_m: float
    z_m: float
    radius_m: float = 0.06
    grey: float = 600.0


@dataclass(frozen=True, slots=True)
class Wet:
    """Water on the road: it is darker, and mirrors what is above it.

    Attributes:
        darker: Share of the light that the wet surface swallows.
        mirror: Share of the reflection of smooth water (1) that is left.
        patches: How unevenly the water lies (0 ... 1).
        rough_rows: How far the mirrored picture is smeared along the columns, of the image's height.
    """

    darker: float = 0.3
    mirror: float = 0.6
    patches: float = 0.5
    rough_rows: float = 0.03


@dataclass(frozen=True, slots=True)
class Rain:
    """Drops that fall before one camera, each a bright streak that the other does not see.

    Attributes:
        streaks: Their number.
        length_px: Their mean length [px].
        grey: Their mean light [grey levels].
        slant: How far they lean, in columns a row.
        seed: Of their places.
    """

    streaks: int
    length_px: float = 20.0
    grey: float = 25.0
    slant: float = 0.05
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Sensor:
    """What is done to a picture behind the lens.

    Attributes:
        mosaic: Whether a pixel sees one colour only (Bayer, RGGB), and the others come from its neighbours.
        red: Signal of a red pixel, as a share of a green one's.
        blue: That of a blue pixel.
        white_balance_error: How much too bright red is made, and blue too dark (1: twice as bright).
        jpeg_quality: Quality of a JPEG compression (1 ... 100), None for none.
    """

    mosaic: bool = False
    red: float = 0.6
    blue: float = 0.5
    white_balance_error: float = 0.0
    jpeg_quality: int | None = None


@dataclass(frozen=True, slots=True)
class Shake:
    """Vibration of the rig while the rows are read one after another, at one time in both cameras.

    The mean over the rows below the principal point is no part of it: there the pose is the scene's.

    Attributes:
        pitch_rad: Amplitude of the pitch [rad].
        yaw_rad: Amplitude of the yaw [rad], a quarter of a period later.
        hz: Frequency [Hz].
        phase_rad: Phase at the first row [rad].
        readout_s: Time from the first row to the last [s].
    """

    pitch_rad: float
    yaw_rad: float = 0.0
    hz: float = 30.0
    phase_rad: float = 0.0
    readout_s: float = 0.02


@dataclass(frozen=True, slots=True)
class Camera:
    """One camera of the pair, with its faults.

    Attributes:
        photometry: Gain, offset, vignetting, blur, noise.
        lower_px: By how many rows its picture lies too low [px].
        turned_rad: Its rotation about its own axis against the rig [rad], > 0: right side down.
        yaw_rad: Its rotation about the vertical of the rig [rad], > 0: it looks further left.
        glare: A bright patch, None for none.
        sensor: What is done to its picture behind the lens.
        rain: Drops before the lens, None for none.
    """

    photometry: Photometry = field(default_factory=Photometry)
    lower_px: float = 0.0
    turned_rad: float = 0.0
    yaw_rad: float = 0.0
    glare: Glare | None = None
    sensor: Sensor = field(default_factory=Sensor)
    rain: Rain | None = None
