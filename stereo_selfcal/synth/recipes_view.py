"""Ingredients of light and cameras: shadows, glare, exposure, focus, a misaligned pair."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from .ingredients import Glare, Shadow, Shake, WorldScene
from .recipe_tools import Rng, side_of_choice, strip

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
