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

"""Ingredients of light and cameras: shadows, glare, exposure, focus, a misaligned pair."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from .ingredients import Glare, Headlights, Lamp, Rain, Shadow, Shake, Wet, WorldScene
from .recipe_tools import Rng, outermost, side_of_choice, strip

# --- light ---


def shadows_across(scene: WorldScene, rng: Rng) -> WorldScene:
    """Shadows of poles and trees across the road, hard or soft, straight across or oblique."""
    soft_m = float(rng.choice([0.02, 0.3, 1.0]))
    begin, shadows = float(rng.uniform(4, 9)), []
    for _ in range(int(rng.integers(1, 5))):
        end = begin + float(rng.uniform(0.3, 5))
        skew = float(rng.uniform(-1.0, 1.0))
        shadows.append(Shadow("across", begin, end, float(rng.uniform(0.35, 0.7)), soft_m, skew))
        begin = end + float(rng.uniform(1, 10))
    return replace(scene, shadows=(*scene.shadows, *shadows))


def shadow_along(scene: WorldScene, rng: Rng) -> WorldScene:
    """The shadow of a wall or a hedge over one side of the road; its edge lies in the own lane or beside."""
    side = side_of_choice(rng)
    edge = sum(scene.lane_m) / 2 + side * float(rng.uniform(-0.5, 2.5))
    soft_m = float(rng.choice([0.03, 0.2, 0.8]))
    shadow = Shadow("along", *strip(edge, side), float(rng.uniform(0.35, 0.7)), soft_m)
    return replace(scene, shadows=(*scene.shadows, shadow))


def dappled(scene: WorldScene, rng: Rng) -> WorldScene:
    """Sun through leaves."""
    return replace(scene, shadows=(*scene.shadows, Shadow("dappled", light=float(rng.uniform(0.5, 0.75)))))


def night(scene: WorldScene, rng: Rng) -> WorldScene:
    """Night: the road is lit by the own headlights, and there may be lamps of the street and of cars."""
    lights = Headlights(
        float(rng.uniform(0.01, 0.06)),
        float(rng.uniform(0.6, 1.2)),
        float(rng.uniform(14, 28)),
        float(rng.uniform(0.35, 0.6)),
    )
    # Cameras see more at night, noise included.
    noise, gain = float(rng.uniform(0.005, 0.03)), float(rng.uniform(1.0, 2.0))
    left, right = (
        replace(
            camera,
            photometry=replace(camera.photometry, noise_fraction=noise, gain=gain * camera.photometry.gain),
        )
        for camera in (scene.left, scene.right)
    )
    lamps = [lamp for lamp in (_street, _ahead, _coming) if rng.random() < 0.5]
    seen = tuple(lamp for lamps_of in lamps for lamp in lamps_of(scene, rng))
    sky = float(rng.uniform(2, 14))
    # There is no sun that could cast a shadow.
    return replace(scene, headlights=lights, lamps=seen, sky_grey=sky, shadows=(), left=left, right=right)


def _street(scene: WorldScene, rng: Rng) -> list[Lamp]:
    """Return the lamps of a street, on one side of it."""
    side, every, z = side_of_choice(rng), float(rng.uniform(25, 45)), float(rng.uniform(6, 9))
    at = outermost(scene, side) + side * float(rng.uniform(0.5, 2.0))
    first = float(rng.uniform(12, every))
    return [Lamp(first + i * every, at, z, 0.12, 5000.0) for i in range(6)]


def _ahead(scene: WorldScene, rng: Rng) -> list[Lamp]:
    """Return the tail lamps of a car ahead, too far for itself to be seen."""
    s, z = float(rng.uniform(35, 90)), float(rng.uniform(0.6, 0.9))
    middle = sum(scene.lane_m) / 2
    return [Lamp(s, middle + off, z, 0.06, 1500.0) for off in (-0.65, 0.65)]


def _coming(scene: WorldScene, rng: Rng) -> list[Lamp]:
    """Return the headlights of a car that comes in the lane to the left."""
    s, z = float(rng.uniform(25, 120)), float(rng.uniform(0.55, 0.75))
    middle = scene.lane_m[1] + (scene.lane_m[1] - scene.lane_m[0]) / 2
    return [Lamp(s, middle + off, z, 0.07, 12000.0) for off in (-0.6, 0.6)]


def wet(scene: WorldScene, rng: Rng) -> WorldScene:
    """A wet road: darker, and it mirrors the sky and what stands beside it."""
    darker, mirror = float(rng.uniform(0.15, 0.45)), float(rng.uniform(0.2, 0.7))
    return replace(scene, wet=Wet(darker, mirror, float(rng.uniform(0, 0.9)), float(rng.uniform(0.01, 0.07))))


def rain(scene: WorldScene, rng: Rng) -> WorldScene:
    """Rain: a wet road, and streaks of drops before either camera."""
    scene = wet(scene, rng)
    rig = scene.rig
    per_area = float(rng.uniform(2e-4, 1e-3))
    slant, grey = float(rng.normal(0, 0.1)), float(rng.uniform(8, 35))

    def drops() -> Rain:
        number = int(per_area * rig.width * rig.height)
        length = rig.height * float(rng.uniform(0.02, 0.06))
        return Rain(number, length, grey, slant, int(rng.integers(2**31)))

    left, right = (replace(camera, rain=drops()) for camera in (scene.left, scene.right))
    return replace(scene, left=left, right=right)


def night_rain(scene: WorldScene, rng: Rng) -> WorldScene:
    """Rain at night: lamps draw streaks over the wet road."""
    return rain(night(scene, rng), rng)


def glare(scene: WorldScene, rng: Rng) -> WorldScene:
    """A saturated patch on the road towards the sun, of its own place and size in each camera."""
    rig = scene.rig
    u, v = rig.width * float(rng.uniform(0.3, 0.7)), rig.height * float(rng.uniform(0.55, 0.85))
    wide, high = rig.height * rng.uniform(0.05, 0.15), rig.height * rng.uniform(0.05, 0.2)

    def patch() -> Glare:
        factor = rng.uniform(0.8, 1.25, size=3)
        shift = rng.uniform(-0.02, 0.02, size=2) * rig.height
        return Glare(
            u + float(shift[0]),
            v + float(shift[1]),
            float(wide * factor[0]),
            float(high * factor[1]),
            220.0 * float(factor[2]),
        )

    return replace(scene, left=replace(scene.left, glare=patch()), right=replace(scene.right, glare=patch()))


# --- cameras ---


def _photometry(scene: WorldScene, left: dict[str, float], right: dict[str, float]) -> WorldScene:
    return replace(
        scene,
        left=replace(scene.left, photometry=replace(scene.left.photometry, **left)),
        right=replace(scene.right, photometry=replace(scene.right.photometry, **right)),
    )


def exposures_differ(scene: WorldScene, rng: Rng) -> WorldScene:
    """One camera is 15 to 40 % darker and has another black level."""
    gain, offset = float(rng.uniform(0.6, 0.85)), float(rng.uniform(0, 12))
    return _photometry(scene, {}, {"gain": gain, "offset": offset})


def over_exposed(scene: WorldScene, rng: Rng) -> WorldScene:
    """The road surface and the paint are both white."""
    gain = float(rng.uniform(4.0, 6.0))
    return _photometry(scene, {"gain": gain}, {"gain": gain})


def under_exposed(scene: WorldScene, rng: Rng) -> WorldScene:
    """Paint a few grey levels above black."""
    gain = float(rng.uniform(0.015, 0.04))
    return _photometry(scene, {"gain": gain}, {"gain": gain})


def blurred(scene: WorldScene, rng: Rng) -> WorldScene:
    """Out of focus: 5 to 9 px."""
    sigma = float(rng.uniform(5, 9)) * scene.rig.height / 480
    return _photometry(scene, {"psf_sigma_px": sigma}, {"psf_sigma_px": sigma})


def soft_focus(scene: WorldScene, rng: Rng) -> WorldScene:
    """Slightly out of focus: 0.8 to 1.5 px, different in both cameras."""
    left, right = rng.uniform(0.8, 1.5, size=2)
    return _photometry(scene, {"psf_sigma_px": float(left)}, {"psf_sigma_px": float(right)})


def misaligned(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right picture 1 to 4 px too low or too high."""
    lower_px = side_of_choice(rng) * float(rng.choice([1.0, 1.0, 2.0, 4.0]))
    return replace(scene, right=replace(scene.right, lower_px=lower_px))


def turned(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right camera turned about its own axis by 0.3 to 1.5 deg."""
    turned_rad = side_of_choice(rng) * math.radians(float(rng.uniform(0.3, 1.5)))
    return replace(scene, right=replace(scene.right, turned_rad=turned_rad))


def slightly_misaligned(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right picture 0.1 to 0.3 px too low or too high, as of rigs that are called rectified."""
    lower_px = side_of_choice(rng) * float(rng.uniform(0.1, 0.3))
    return replace(scene, right=replace(scene.right, lower_px=lower_px))


def slightly_turned(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right camera turned about its own axis by 0.03 to 0.3 deg."""
    turned_rad = side_of_choice(rng) * math.radians(float(rng.uniform(0.03, 0.3)))
    return replace(scene, right=replace(scene.right, turned_rad=turned_rad))


def looks_aside(scene: WorldScene, rng: Rng) -> WorldScene:
    """The right camera turned about the vertical by 0.05 to 0.2 deg: every plane of disparities tilts."""
    yaw_rad = side_of_choice(rng) * math.radians(float(rng.uniform(0.05, 0.2)))
    return replace(scene, right=replace(scene.right, yaw_rad=yaw_rad))


def swapped(scene: WorldScene, rng: Rng) -> WorldScene:
    """The pictures of the cameras exchanged."""
    del rng
    return replace(scene, swapped=True)


def _sensor(scene: WorldScene, **changes: Any) -> WorldScene:
    """Return the scene with changed sensors in both cameras."""
    left, right = (
        replace(camera, sensor=replace(camera.sensor, **changes)) for camera in (scene.left, scene.right)
    )
    return replace(scene, left=left, right=right)


def bayer(scene: WorldScene, rng: Rng) -> WorldScene:
    """Colour cameras: two of three colours of every pixel are interpolated, with noise and its gains."""
    red, blue = (float(rng.uniform(*range_)) for range_ in ((0.45, 0.8), (0.4, 0.75)))
    error = float(rng.uniform(-0.08, 0.08))
    return _sensor(scene, mosaic=True, red=red, blue=blue, white_balance_error=error)


def jpeg(scene: WorldScene, rng: Rng) -> WorldScene:
    """Pictures compressed as JPEG, of a quality from 60 to 95."""
    return _sensor(scene, jpeg_quality=int(rng.integers(60, 96)))


def rolling_shutter(scene: WorldScene, rng: Rng) -> WorldScene:
    """A vibrating rig whose rows are read one after another: edges are waves of up to a pixel."""
    pitch, yaw = (math.radians(float(rng.uniform(0.01, 0.08))) for _ in range(2))
    hz, phase = float(rng.uniform(15, 90)), float(rng.uniform(0, 2 * math.pi))
    return replace(scene, shake=Shake(pitch, yaw, hz, phase, float(rng.uniform(0.01, 0.03))))
