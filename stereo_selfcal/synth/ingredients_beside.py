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
    """A steel rail along the road on posts that are not drawn.

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
