"""Parts of a synthetic world besides paint on a plane: worn lines, kerbs, cars, shadows, faults.

Lateral positions are in road coordinates, left positive [m]; greys are those of the world, before a
camera's gain.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from stereo_selfcal.core.errors import ConfigError

from ..core.camera.rig import StereoRig
from ..core.geometry.pose import Extrinsics
from .road_shape import RoadShape, near_plane, pose_over_plane
from .world import ASPHALT_GREY, PAINT_GREY, SKY_GREY, LaneLine, Photometry, Side


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


@dataclass(frozen=True, slots=True)
class WorldScene:
    """One stereo frame of a world, with its truth.

    Attributes:
        rig: The rig as the calibrator is told.
        pose: Height, pitch and roll of the rig over the plane z = 0 of the lane frame. Where the road
            has height this is not the truth: :meth:`truth` is.
        lane_m: Lateral positions of the right and the left border of the own lane [m].
        lane_yaw_rad: Heading against the reference line [rad], > 0: it points left.
        lateral_offset_m: Position of the rig beside the reference line, left positive [m].
        shape: MountHistory and height of the road.
        paints: Painted lines (tram rails too); where they overlap, the later lies on top.
        arrows: Painted arrows.
        bands: Strips of other surfaces, below the paint; the later lies on top.
        shadows: Shadows on the ground; their light multiplies.
        kerbs: At most one on either side of the rig.
        rails: Guard rails.
        cars: Cars.
        walls: Foliage.
        asphalt_grey: Mean grey level of the road surface.
        texture_amplitude: Standard deviation of its texture seen from near [grey levels].
        texture_seed: Seed of every texture.
        sky_grey: Grey level of the sky at the horizon.
        left: Left camera.
        right: Right camera.
        swapped: Whether the pictures of the cameras are exchanged.

    Raises:
        ConfigError: The rig would touch the road, or a guard rail is above it.
    """

    rig: StereoRig
    pose: Extrinsics
    lane_m: tuple[float, float]
    lane_yaw_rad: float = 0.0
    lateral_offset_m: float = 0.0
    shape: RoadShape = field(default_factory=RoadShape)
    paints: tuple[Paint, ...] = ()
    arrows: tuple[Arrow, ...] = ()
    bands: tuple[Band, ...] = ()
    shadows: tuple[Shadow, ...] = ()
    kerbs: tuple[Kerb, ...] = ()
    rails: tuple[GuardRail, ...] = ()
    cars: tuple[Car, ...] = ()
    walls: tuple[Wall, ...] = ()
    asphalt_grey: float = ASPHALT_GREY
    texture_amplitude: float = 3.0
    texture_seed: int = 0
    sky_grey: float = SKY_GREY
    left: Camera = field(default_factory=Camera)
    right: Camera = field(default_factory=Camera)
    swapped: bool = False

    def __post_init__(self) -> None:
        top_m = max([0.2, *(rail.top_m for rail in self.rails), *(kerb.height_m for kerb in self.kerbs)])
        # Each camera may be lower than the rig's middle by half the baseline when the rig is rolled.
        lowest_m = self.pose.height_m - abs(self.pose.roll_rad) * self.rig.baseline_m / 2
        if not lowest_m > top_m:
            raise ConfigError(f"world.pose.height_m is {self.pose.height_m}, it must be above {top_m} m")

    def camera(self, side: Side) -> Camera:
        """Return one camera."""
        return self.left if side == "left" else self.right

    def truth(self) -> Extrinsics:
        """Return the pose a calibration should find.

        That is the pose of the (fault-free) rig over the plane which the surface of the own lane has
        near it: the least-squares plane of the heights between the lane's borders, 5 to 20 m ahead.
        """
        plane = near_plane(self.shape, self.lane_m)
        return pose_over_plane(self.pose, self.lane_yaw_rad, self.lateral_offset_m, plane)
