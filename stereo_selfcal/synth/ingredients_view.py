"""How a world is seen: the cameras and their faults."""

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
class Camera:
    """One camera of the pair, with its faults.

    Attributes:
        photometry: Gain, offset, vignetting, blur, noise.
        lower_px: By how many rows its picture lies too low [px].
        turned_rad: Its rotation about its own axis against the rig [rad], > 0: right side down.
        glare: A bright patch, None for none.
    """

    photometry: Photometry = field(default_factory=Photometry)
    lower_px: float = 0.0
    turned_rad: float = 0.0
    glare: Glare | None = None
