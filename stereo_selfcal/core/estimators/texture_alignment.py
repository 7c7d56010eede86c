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

"""The road plane from the texture of the road surface: both images are aligned under one plane.

The disparity of a plane is linear in the image, so three numbers describe it. They are estimated by
Gauss-Newton on the differences of grey values (Lucas and Kanade, IJCAI 1981). Both images are moved by half
the disparity, so that interpolation blurs both equally. In each cell of the road, the differences give the
height of the road over the plane. :mod:`stereo_selfcal.core.road.surface` fits one plane to the cells, with
its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, jacobian_pose_wrt_plane, plane_from_pose, pose_from_plane
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.uncertainty import UncertaintyTerm, propagate_terms
from ..rejection import Bound, NotFitted
from ..road.cell_grid import FAR_M, HALF_WIDTH_M, SampleGrid, lay_out_samples, strip_of
from ..road.extent import OUTLIER_WEIGHT
from ..road.lane_points import OTHER_HALF_WIDTHS_M, STRETCHES_M, LanePoints
from ..road.priors import HALF_LANE_WIDTH_M, HALF_STRIP_M
from ..road.surface import CellHeights, LanePlane, RoadCells, Surface, road_cells
from ..road.unevenness import RoadUnevenness
from ..types import Array, Floats, Image, Mask
from .cell_displacements import CellDisplacements, correlation, measure_displacements
from .sampling import BlurredImages, ImageBlurs, half_disparity, sample_positions, usable_samples, warp
from .texture_fit import MIN_CELL_SHARE, TextureFit, TextureQuality
from .texture_search import NOT_IN_VIEW, SEARCH_RANGE, Layout, search_plane

# Most distance of the result from the start, over the search range and its own standard deviation: beyond,
# the fit diverged.
_MOST_RUN = 2.0

# Blur of each attempt along the row [px]. With less blur than a pixel, interpolation depends on the position
# within a pixel. The second attempt, for a road with too little texture for the first, has more blur: it
# loses detail, but the noise is lower by the root of the blur.
BLURS = (1.0, 3.0)
_THINNINGS = (2, 1)  # of the samples, in the first pass and in the last one
# Twice the distance between samples halves the significance of the texture of a cell. So where less than half
# of the share that is needed shows texture, the blur is too small for that road.
_LEAST_THINNED_SHARE = MIN_CELL_SHARE / 2.0
_THINNED_SHARE = "part of the road whose texture lies in one plane, by some of its samples"
_MOST_STEP_PX = 4.0  # most change of disparity in a pass; beyond, the fit leaves the plane that was found
# A pass is repeated where it has moved the plane by more than this part of the blur. Within it, grey values
# are linear to less than the mismatch of a usual road.
_CONVERGED, _MOST_PASSES = 0.1, 3

_CUBIC_ROWS = 2  # of the interpolation
_LANE_STEP_M = 1.5  # distance of the points of the own lane: there are cells as long, 10 m ahead


def align_texture(
    images: tuple[Image, Image],
    rig: StereoRig,
    start: Extrinsics,
    lane_yaw_rad: float = 0.0,
    *,
    limits_m: tuple[float, float] = (-HALF_WIDTH_M, HALF_WIDTH_M),
    far_m: float = FAR_M,
    first_attempt: int = 0,
    blurs: ImageBlurs | None = None,
) -> TextureFit | NotFitted:
    """Align the grey values of the road ahead of the camera.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        start: Extrinsics to start from, within 60 mm, 0.5 deg and 2 deg of the true ones.
        lane_yaw_rad: Heading of the camera against the lane [rad].
        limits_m: Right and left limit of the sampled strip beside the camera [m], left positive.
        far_m: Distance of the strip's end [m].
        first_attempt: Attempt to begin with: that which another frame of the same road needed.
        blurs: These images, as other alignments have blurred them; None to begin anew.

    Returns:
        The fit with its quality, or the reason why nothing could be aligned.
    """
    blurs = blurs or ImageBlurs(images)
    layout = (lane_yaw_rad, limits_m, far_m)
    searched = search_plane(images, rig, plane_from_pose(start, rig), layout)
    if isinstance(searched, NotFitted):
        return searched
    best: TextureFit | None = None
    for attempt in (*range(first_attempt, len(BLURS)), *range(first_attempt)):
        fit = align_from(images, blurs, rig, searched, layout, BLURS[attempt], _THINNINGS)
        if isinstance(fit, NotFitted):
            given_up = fit
            continue
        reach = np.hypot(SEARCH_RANGE, np.sqrt(np.diag(fit.covariance)))
        run = float(np.max(np.abs(fit.extrinsics.as_array() - start.as_array()) / reach))
        if not run < _MOST_RUN:
            given_up = NotFitted("distance from the start over what is searched", run, Bound.MOST, _MOST_RUN)
            continue
        fit = replace(fit, attempt=attempt)
        if fit.enough_texture:
            return fit
        if best is None or fit.sufficiency > best.sufficiency:
            best = fit
    return best or given_up


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Samples of a road in both images, laid out under one plane and taken under others.

    Attributes:
        grid: The samples.
        usable: (N,) 1 for samples that can be used, 0 for the others.
        blurred: The images.
        blur_px: Their blur along the row [px].
        rig: Intrinsics and baseline.
        lane: Points of the own lane.
        turned: As of :func:`align_from`.
    """

    grid: SampleGrid
    usable: Floats
    blurred: BlurredImages
    blur_px: float
    rig: StereoRig
    lane: LanePoints
    turned: Array | None

    def look(self, plane: DisparityPlane, unevenness: RoadUnevenness | None) -> _UnderPlane | NotFitted:
        """Take the samples under a plane, and find how that of the own lane differs from it.

        Args:
            plane: The plane.
            unevenness: That of the road where it is known.
        """
        grid = self.grid
        positions = sample_positions(grid, half_disparity(grid, plane, self.rig), self.turned)
        grey, slopes = warp(self.blurred.grey, positions), warp(self.blurred.slope, positions)
        cells = measure_displacements(grey, slopes, self.usable, grid, self.blur_px)
        # Height of the road over the plane for a disparity that is larger by one pixel.
        metres = plane.height_m(self.rig) / plane.disparities(grid.cell_rays)
        heights = np.where(cells.significant, cells.displacement * metres, np.nan)
        seen = CellHeights(heights, cells.variance * metres**2, metres, grid.cell_xy, grid.cell_strip)
        road = road_cells(seen, grid.cell_rays * metres[:, None], self.lane)
        if isinstance(road, NotFitted):
            return road
        moved = road.plane(unevenness)
        if isinstance(moved, NotFitted):
            return moved
        agreeing = grid.cell_rays[moved.weights > OUTLIER_WEIGHT]
        step_px = float(np.abs(agreeing @ moved.plane).max(initial=0.0))
        if step_px > _MOST_STEP_PX:
            return NotFitted("change of disparity in a pass", step_px, Bound.MOST, _MOST_STEP_PX, "px")
        return _UnderPlane(grid, cells, grey, road, moved, step_px)


@dataclass(frozen=True, slots=True, eq=False)
class _UnderPlane:
    """One pass: what samples show that were taken under a plane.

    Attributes:
        grid: The samples.
        cells: Displacements of the cells.
        grey: Grey values of the samples in the left and in the right image, (N,) each.
        road: The cells with heights over the plane.
        moved: How the plane of the own lane differs from it.
        step_px: Greatest change of disparity by that, of the cells that agree with it [px].
    """

    grid: SampleGrid
    cells: CellDisplacements
    grey: tuple[Floats, Floats]
    road: RoadCells
    moved: LanePlane
    step_px: float

    @property
    def too_few(self) -> NotFitted | None:
        """Which share of the road some of its samples show, where that is too little; else None."""
        share = _agreeing_share(self.moved.weights, self.grid, _near(self.grid))
        if share >= _LEAST_THINNED_SHARE:
            return None
        return NotFitted(_THINNED_SHARE, 100 * share, Bound.LEAST, 100 * _LEAST_THINNED_SHARE, "%")


def align_from(
    images: tuple[Image, Image],
    blurs: ImageBlurs,
    rig: StereoRig,
    plane: DisparityPlane,
    layout: Layout,
    blur_px: float,
    thinnings: tuple[int, ...],
    unevenness: RoadUnevenness | None = None,
    turned: Array | None = None,
) -> TextureFit | NotFitted:
    """Align from a plane that is exact to about a pixel.

    The first pass takes some of the samples. Where these show too little, it does not count, and there is
    none with all samples where another blur is left to be tried. Passes with all of them follow until the
    plane stays where it is.

    Args:
        images: Left and right image, (H, W) uint8.
        blurs: These images, as other alignments have blurred them.
        rig: Intrinsics and baseline.
        plane: The plane to start from.
        layout: Heading against the lane [rad], right and left limit, and far end of the samples [m].
        blur_px: Blur along the row [px].
        thinnings: Factors on the distance between samples, of which the last one is that of the last pass.
        unevenness: That of the road where it is known.
        turned: Homography (3, 3) of a right camera that has turned (:meth:`.CameraTurn.homography`).
    """
    lay_out = partial(_lay_out, images, blurs, rig, layout, blur_px, turned)
    for thinning in thinnings[:-1]:
        some = lay_out(plane, thinning)
        first = some if isinstance(some, NotFitted) else some.look(plane, unevenness)
        few = first if isinstance(first, NotFitted) else first.too_few
        if few is not None and blur_px < BLURS[-1]:
            return few
        if isinstance(first, _UnderPlane) and few is None:
            plane = plane.moved(first.moved.plane)
    samples = lay_out(plane, thinnings[-1])
    if isinstance(samples, NotFitted):
        return samples
    looked = samples.look(plane, unevenness)
    for _ in range(_MOST_PASSES - 1):
        # Where too little of a road is seen, where exactly it lies does not matter.
        if isinstance(looked, NotFitted) or looked.step_px <= _CONVERGED * blur_px or looked.too_few:
            break
        plane = plane.moved(looked.moved.plane)
        looked = samples.look(plane, unevenness)
    if isinstance(looked, NotFitted):
        return looked
    surface = looked.road.surface(unevenness)
    if isinstance(surface, NotFitted):
        return surface
    return _report(rig, plane.moved(surface.plane), samples.grid, surface, looked, layout[0])


def _lay_out(
    images: tuple[Image, Image],
    blurs: ImageBlurs,
    rig: StereoRig,
    layout: Layout,
    blur_px: float,
    turned: Array | None,
    plane: DisparityPlane,
    thinning: int,
) -> _Samples | NotFitted:
    """Lay out samples under a plane."""
    grid = lay_out_samples(rig, pose_from_plane(plane, rig), *layout, thinning=thinning)
    if grid is None:
        return NOT_IN_VIEW
    half = half_disparity(grid, plane, rig)
    usable = usable_samples(images, grid, half, rig, blur_px)
    blurred = blurs.of(blur_px, grid, 0 if turned is None else _rows_around(grid, half, turned))
    return _Samples(grid, usable, blurred, blur_px, rig, _lane_points(plane, rig, layout), turned)


def _rows_around(grid: SampleGrid, half: Floats, turned: Array) -> int:
    """Return how many rows above and below its own a turned camera needs for a sample."""
    rows = sample_positions(grid, half, turned)[1][1]
    return int(np.ceil(np.abs(rows - grid.v).max())) + _CUBIC_ROWS


def _lane_grid() -> tuple[Array, Array]:
    """Return distances ahead (T,) and to the left (T,) of the points of the own lane [m]."""
    begin_m, end_m = STRETCHES_M[0][0], STRETCHES_M[-1][1]
    ahead = np.linspace(begin_m, end_m, 1 + round((end_m - begin_m) / _LANE_STEP_M))
    half_m = np.array([*OTHER_HALF_WIDTHS_M, HALF_LANE_WIDTH_M, 0.0])
    lateral = np.unique(np.concatenate([half_m, -half_m]))
    x, aside = np.meshgrid(ahead, lateral)
    return x.ravel(), aside.ravel()


_LANE_GRID = _lane_grid()


def _lane_points(plane: DisparityPlane, rig: StereoRig, layout: Layout) -> LanePoints:
    """Return the points of the own lane in the sampled strip, over which the plane is fitted."""
    yaw, (right_m, left_m), _ = layout
    pose = pose_from_plane(plane, rig)
    x, aside = _LANE_GRID
    xy = np.column_stack([x, aside - np.tan(yaw) * x])
    on_road = np.column_stack([xy, np.full(len(x), -pose.height_m)])
    ray = on_road @ road_from_camera_rotation(pose.pitch_rad, pose.roll_rad)
    ray /= ray[:, :1]
    metres = plane.height_m(rig) / plane.disparities(ray)
    limits = right_m, left_m
    middle = int(strip_of(np.zeros(1), limits)[0])
    return LanePoints(xy, aside, ray * metres[:, None], strip_of(aside, limits), middle)


def _report(
    rig: StereoRig,
    plane: DisparityPlane,
    grid: SampleGrid,
    surface: Surface,
    looked: _UnderPlane,
    lane_yaw_rad: float,
) -> TextureFit:
    """Return the fit from the results of the last pass."""
    cells = looked.cells
    pose = pose_from_plane(plane, rig)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    noise = np.sqrt(np.diag(jac_pose_plane @ surface.noise_covariance @ jac_pose_plane.T))
    terms = (UncertaintyTerm(name, each) for name, each in surface.covariance_terms.items())
    near = surface.on_road & _near(grid)
    under_car = np.abs(grid.cell_xy[:, 1] + np.tan(lane_yaw_rad) * grid.cell_xy[:, 0]) <= HALF_STRIP_M
    quality = TextureQuality(
        sigmas=cells.sigmas,
        cell_share=_agreeing_share(surface.weights, grid, near),
        strip_share=_agreeing_share(surface.weights, grid, near & under_car),
        pixel_share=float(cells.weights.sum()) / grid.n_samples,
        correlation=correlation(*looked.grey, cells.weights, grid),
        noise_std=(float(noise[0]), float(noise[1]), float(noise[2])),
    )
    return TextureFit(
        extrinsics=pose,
        terms=propagate_terms(terms, jac_pose_plane),
        quality=quality,
        unevenness=surface.unevenness,
        cells_xy_m=grid.cell_xy,
        cells_height_m=surface.residuals,
        cells_weight=surface.weights,
        cells_variance=surface.noise_variance,
        halves=tuple(
            (
                jac_pose_plane @ half.plane,
                np.sqrt(np.diag(jac_pose_plane @ half.covariance @ jac_pose_plane.T)),
            )
            for half in surface.halves
        ),
    )


def _near(grid: SampleGrid) -> Mask:
    """Return which cells are of the nearer stretch, which has to be seen: a car hides what is beyond it."""
    near: Mask = grid.cell_xy[:, 0] <= STRETCHES_M[0][1]
    return near


def _agreeing_share(weights: Array, grid: SampleGrid, which: Mask) -> float:
    """Return which share of the area of some cells agrees with the plane, 0 ... 1."""
    area = grid.cell_area * which
    return float(weights @ area) / max(float(area.sum()), 1e-9)
