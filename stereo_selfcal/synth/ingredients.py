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

"""A synthetic world: its road, what is on and beside it, and the cameras that see it.

What a world is made of comes from three files by its place: ``ingredients_road`` (on the road),
``ingredients_beside`` (beside and above it) and ``ingredients_view`` (cameras). Lateral positions are in
road coordinates, left positive [m]; greys are those of the world, before a camera's gain.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from stereo_selfcal.core.errors import ConfigError

from ..core.camera.rig import StereoRig
from ..core.geometry.pose import Extrinsics
from .ingredients_beside import (
    Barrier,
    Car,
    Facade,
    GuardRail,
    House,
    Kerb,
    Posts,
    Ridge,
    RoadStep,
    Strand,
    Wall,
)
from .ingredients_road import Arrow, Band, Paint, Shadow
from .ingredients_view import Camera, Glare, Headlights, Lamp, Rain, Sensor, Shake, Wet
from .road_shape import RoadShape, near_plane, pose_over_plane
from .world import ASPHALT_GREY, SKY_GREY, Side

__all__ = [
    "Arrow",
    "Band",
    "Barrier",
    "Camera",
    "Car",
    "Facade",
    "Glare",
    "GuardRail",
    "Headlights",
    "House",
    "Kerb",
    "Lamp",
    "Paint",
    "Posts",
    "Rain",
    "Ridge",
    "RoadStep",
    "Sensor",
    "Shadow",
    "Shake",
    "Strand",
    "Wall",
    "Wet",
    "WorldScene",
]


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
        shape: Course and height of the road.
        paints: Painted lines (tram rails and sleepers too); where they overlap, the later lies on top.
        arrows: Painted arrows.
        bands: Strips of other surfaces, below the paint; the later lies on top.
        shadows: Shadows on the ground; their light multiplies.
        kerbs: At most one on either side of the rig.
        rails: Guard rails without posts.
        barriers: Guard rails with posts, wire barriers, cables; as ridges, steps and facades, along a
            straight road only.
        ridges: Rails of a railway.
        steps: Edges of another level of the road; at most one on either side of the rig.
        facades: Houses.
        cars: Cars.
        walls: Foliage.
        asphalt_grey: Mean grey level of the road surface.
        texture_amplitude: Standard deviation of its texture seen from near [grey levels].
        fine_texture: Whether grains shorter than a pixel is long on the road are averaged within it, as a
            camera does; otherwise they are left out.
        texture_seed: Seed of every texture.
        sky_grey: Grey level of the sky at the horizon.
        left: Left camera.
        right: Right camera.
        headlights: The own car's at night, None by day.
        lamps: Lights that are seen.
        wet: Water on the road, None where it is dry; its mirror is the plane z = 0.
        shake: Vibration of the rig under a rolling shutter, None for none.
        swapped: Whether the pictures of the cameras are exchanged.

    Raises:
        ConfigError: The rig would touch the road, a guard rail without posts is above it, or something
            that stands along a straight road only is in a bend.
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
    barriers: tuple[Barrier, ...] = ()
    ridges: tuple[Ridge, ...] = ()
    steps: tuple[RoadStep, ...] = ()
    facades: tuple[Facade, ...] = ()
    cars: tuple[Car, ...] = ()
    walls: tuple[Wall, ...] = ()
    asphalt_grey: float = ASPHALT_GREY
    texture_amplitude: float = 3.0
    fine_texture: bool = False
    texture_seed: int = 0
    sky_grey: float = SKY_GREY
    left: Camera = field(default_factory=Camera)
    right: Camera = field(default_factory=Camera)
    headlights: Headlights | None = None
    lamps: tuple[Lamp, ...] = ()
    wet: Wet | None = None
    shake: Shake | None = None
    swapped: bool = False

    def __post_init__(self) -> None:
        levels_m = [kerb.height_m for kerb in self.kerbs] + [ridge.height_m for ridge in self.ridges]
        levels_m += [step.height_m for step in self.steps]
        top_m = max([0.2, *(rail.top_m for rail in self.rails), *levels_m])
        # Each camera may be lower than the rig's middle by half the baseline when the rig is rolled.
        lowest_m = self.pose.height_m - abs(self.pose.roll_rad) * self.rig.baseline_m / 2
        if not lowest_m > top_m:
            raise ConfigError(f"world.pose.height_m is {self.pose.height_m}, it must be above {top_m} m")
        for name in ("barriers", "ridges", "steps", "facades"):
            if getattr(self, name) and self.shape.curvature_per_m != 0:
                raise ConfigError(f"{name} are along a straight road, but shape.curvature_per_m is not zero")

    def camera(self, side: Side) -> Camera:
        """Return one camera."""
        return self.left if side == "left" else self.right

    def truth(self) -> Extrinsics:
        """Return the pose a calibration should find.

        That is the pose of the (fault-free) rig over the plane which the surface of the own lane has
        near it: the least-squares plane of the heights between the lane's borders, 3 to 15 m ahead.
        """
        plane = near_plane(self.shape, self.lane_m)
        return pose_over_plane(self.pose, self.lane_yaw_rad, self.lateral_offset_m, plane)
