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

Noise that is independent in the two cameras is not mistaken for texture. The information of a cell is the
product of the gradients in the left and in the right image, and noise alone gives it a mean of zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, jacobian_pose_wrt_plane, plane_from_pose, pose_from_plane
from ..geometry.pose import Extrinsics, road_from_camera_rotation
from ..geometry.uncertainty import UncertaintyTerm, propagate_terms
from ..numerics.robust import TUKEY_SIGMAS, tukey_weights
from ..rejection import Bound, NotFitted
from ..road.cell_grid import FAR_M, HALF_WIDTH_M, SampleGrid, lay_out_samples, strip_of
from ..road.extent import OUTLIER_WEIGHT
from ..road.lane_points import OTHER_HALF_WIDTHS_M, STRETCHES_M, LanePoints
from ..road.priors import HALF_LANE_WIDTH_M, HALF_STRIP_M
from ..road.surface import (
    CellHeights,
    Surface,
    fit_plane,
    fit_surface,
)
from ..road.unevenness import RoadUnevenness
from ..types import Array, Floats, Image, Mask
from .sampling import ImageBlurs, half_disparity, sample, sample_positions, usable_samples, warp
from .texture_fit import TextureFit, TextureQuality

# The search corrects errors of the start up to these: a kerb's height (60 mm), the pitching of a frame (0.5
# deg) and the cross slope of another lane (2 deg), each increased by a quarter.
SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD = 0.075, np.radians(0.65), np.radians(2.5)
Layout = tuple[float, tuple[float, float], float]  # arguments of lay_out_samples: yaw, limits, far end
_SEARCH_RANGE = np.array([SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD])
_MOST_RUN = 2.0  # most distance of the result from the start, over the search range: beyond, the fit diverged
_SEARCH_BLUR_PX = 2.0  # with this blur, the peak of the correlation extends over 2 px to either side
_SEARCH_KERNEL = (13, 1)
_SEARCH_STEP_PX = 1.0
_SEARCH_MOST_STEPS = 7  # steps to either side of the start, for each of the three numbers
_SEARCH_THINNING = 3

# Each attempt: blur along the row [px], thinning of the samples in each pass. With less blur than a pixel,
# interpolation depends on the position within a pixel. The second attempt, for a road with too little texture
# for the first, has more blur: it loses detail, but the noise is lower by the root of the blur.
BLURS = ((1.0, (2, 1)), (3.0, (1,)))
_MOST_STEP_PX = 4.0  # most change of disparity in a pass; beyond, the fit leaves the plane that was found
# OpenCV interpolates at multiples of 1 / 32 px. This is an error of 0.009 px for one sample, and of so much
# for a cell of hundreds of samples.
_FINEST_PX = 1e-3
_STEP_LIMIT_PX = 2.0  # most displacement of a cell in one pass; beyond, the gradient is not valid

_ABS_OF_SIGMA = 0.798  # mean absolute value of a Gaussian, sqrt(2 / pi)
_CELL_SIGMAS = 3.0  # least significance of a cell's texture: one cell in 700 without texture reaches it
_LEAST_SEGMENTS = 3
_ROUNDING = 1.0 / 12.0  # variance of rounding to whole grey levels: it turns a smooth shade into steps
# Sum of the squared autocorrelation, at whole pixels, of the derivative of noise, per pixel of its blur. So
# many samples count as one. For samples farther apart, the number is an upper bound.
_CORRELATED_SAMPLES = 1.88

_LANE_STEP_M = 1.5  # distance of the points of the own lane: there are cells as long, 10 m ahead

_NOT_IN_VIEW = NotFitted("cells of the road in view", 0, Bound.LEAST, 1)


def align_texture(
    images: tuple[Image, Image],
    rig: StereoRig,
    start: Extrinsics,
    lane_yaw_rad: float = 0.0,
    *,
    limits_m: tuple[float, float] = (-HALF_WIDTH_M, HALF_WIDTH_M),
    far_m: float = FAR_M,
    keep_paint: bool = False,
    vertical_px: float = 0.0,
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
        keep_paint: Whether to use painted stripes as well; else the result is independent of the stripes.
        vertical_px: Row of a point in the right image minus that in the left one [px]; 0 where it is not
            known.
        first_attempt: Attempt to begin with: that which another frame of the same road needed.
        blurs: These images, as other alignments have blurred them; None to begin anew.

    Returns:
        The fit with its quality, or the reason why nothing could be aligned.
    """
    blurs = blurs or ImageBlurs(images)
    layout = (lane_yaw_rad, limits_m, far_m)
    searched = _search(images, rig, plane_from_pose(start, rig), layout)
    if isinstance(searched, NotFitted):
        return searched
    first: TextureFit | None = None
    for attempt in (*range(first_attempt, len(BLURS)), *range(first_attempt)):
        blur, thinnings = BLURS[attempt]
        fit = align_from(images, blurs, rig, searched, layout, blur, thinnings, keep_paint, vertical_px)
        if isinstance(fit, NotFitted):
            given_up = fit
            continue
        run = float(np.max(np.abs(fit.extrinsics.as_array() - start.as_array()) / _SEARCH_RANGE))
        if not run < _MOST_RUN:
            given_up = NotFitted("distance from the start over what is searched", run, Bound.MOST, _MOST_RUN)
            continue
        fit = replace(fit, attempt=attempt)
        if fit.enough_texture:
            return fit
        first = first or fit
    return first or given_up


def align_from(
    images: tuple[Image, Image],
    blurs: ImageBlurs,
    rig: StereoRig,
    plane: DisparityPlane,
    layout: Layout,
    blur_px: float,
    thinnings: tuple[int, ...],
    keep_paint: bool,
    vertical_px: float,
    unevenness: RoadUnevenness | None = None,
    turned: Array | None = None,
) -> TextureFit | NotFitted:
    """Align from a plane that is exact to about a pixel: one pass for each thinning, and a final one.

    The unevenness is that of the road where it is known. ``turned`` is the homography (3, 3) of a right
    camera that has turned (:meth:`.CameraTurn.homography`). Other arguments as of :func:`align_texture`.
    """
    for i, thinning in enumerate(thinnings):
        last = i == len(thinnings) - 1
        grid = lay_out_samples(rig, pose_from_plane(plane, rig), *layout, thinning=thinning)
        if grid is None:
            return _NOT_IN_VIEW
        lane = _lane_points(plane, rig, layout)
        half = half_disparity(grid, plane, rig)
        usable = usable_samples(images, grid, half, rig, None if keep_paint else blur_px)
        blurred = blurs.of(blur_px, grid)
        for final in (False, True)[: 1 + last]:
            half = half_disparity(grid, plane, rig)
            positions = sample_positions(blurred.first_row, grid, half, vertical_px, turned)
            grey, slopes = warp(blurred.grey, positions), warp(blurred.slope, positions)
            cells = _measure(grey, slopes, usable, grid, blur_px)
            # Height of the road over the plane for a disparity that is larger by one pixel.
            metres = plane.height_m(rig) / plane.disparities(grid.cell_rays)
            heights = np.where(cells.significant, cells.displacement * metres, np.nan)
            road = CellHeights(heights, cells.variance * metres**2, metres, grid.cell_xy, grid.cell_strip)
            design = grid.cell_rays * metres[:, None]
            surface = fit_surface(road, design, lane, unevenness) if final else fit_plane(road, design, lane)
            if isinstance(surface, NotFitted):
                return surface
            step_px = float(
                np.abs(grid.cell_rays[surface.weights > OUTLIER_WEIGHT] @ surface.plane).max(initial=0.0)
            )
            if step_px > _MOST_STEP_PX:
                return NotFitted("change of disparity in a pass", step_px, Bound.MOST, _MOST_STEP_PX, "px")
            plane = plane.moved(surface.plane)
    assert grid is not None and isinstance(surface, Surface)  # there are passes
    return _report(rig, plane, grid, surface, cells, layout[0], _correlation(*grey, cells.weights, grid))


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


@dataclass(frozen=True, slots=True, eq=False)
class _CellDisplacements:
    """Displacements of the cells against the plane under which both images were sampled.

    Attributes:
        displacement: (C,) disparity minus that of the plane [px].
        variance: (C,) variance of the displacement caused by the noise [px^2].
        significant: (C,) whether the cell has significant texture.
        sigmas: Texture over its standard error, for all cells together.
        weights: (N,) robust weights of the samples.
    """

    displacement: Array
    variance: Array
    significant: npt.NDArray[np.bool_]
    sigmas: float
    weights: Floats


def _measure(
    grey: tuple[Floats, Floats],
    slopes: tuple[Floats, Floats],
    usable: Floats,
    grid: SampleGrid,
    blur_px: float,
) -> _CellDisplacements:
    """Fit the displacement of every cell; the samples are weighted robustly."""
    sums, cells = grid.segment_sums, grid.cell_sums
    count = np.maximum(sums(usable), 1e-6)
    gain = np.float32(_gain(*grey, usable, count, grid))
    difference = grey[0] * gain - grey[1] / gain
    slope_left, slope_right = slopes[0] * gain, slopes[1] / gain
    residuals = (difference - grid.to_samples(sums(usable * difference) / count)) * usable
    per_cell = np.maximum(cells(count), 1.0)
    scale = np.maximum(cells(sums(np.abs(residuals))) / per_cell / _ABS_OF_SIGMA, 0.1)
    relative = residuals * grid.to_samples(grid.to_segments(1.0 / (TUKEY_SIGMAS * scale)))
    weights = tukey_weights(relative * relative)
    weights *= usable
    # Sums over a segment, with the means removed. The slope is the mean of the slopes in both images.
    total = np.maximum(sums(weights), 1e-6)
    w_left, w_right = weights * slope_left, weights * slope_right
    s_left, s_right, s_difference = sums(w_left), sums(w_right), sums(weights * difference)
    gradient = (s_left + s_right) * s_difference / total - sums((w_left + w_right) * difference)
    gradient /= 2.0
    common = sums(w_left * slope_right) - s_left * s_right / total
    of_left = sums(w_left * slope_left) - s_left**2 / total
    of_right = sums(w_right * slope_right) - s_right**2 / total
    information = (of_left + 2.0 * common + of_right) / 4.0
    # For noise alone, the sum of the products of gradients has a mean of zero and this variance.
    alone = np.clip(of_left * of_right, 0.0, None) * (_CORRELATED_SAMPLES * blur_px) / total
    in_cell, spread = cells(common), np.sqrt(cells(alone))
    significant = (in_cell > _CELL_SIGMAS * spread) & (grid.cell_lengths >= _LEAST_SEGMENTS)
    rounding = _ROUNDING / (4.0 * np.sqrt(np.pi) * blur_px**3)  # variance of its derivative, blurred
    significant &= in_cell > rounding * cells(total)
    safe = np.where(significant, in_cell, 1.0)
    displacement = np.clip(cells(gradient) / safe, -_STEP_LIMIT_PX, _STEP_LIMIT_PX)
    misfit = cells((gradient - common * grid.to_segments(displacement)) ** 2)
    promised = np.maximum(scale**2 * cells(information), 1e-9)
    # Neighbouring samples are correlated by blur and road; one factor for all cells accounts for that.
    ratio = misfit[significant] / promised[significant]
    inflation = float(np.mean(ratio)) if ratio.size else 1.0
    sigmas = float((in_cell / scale**2).sum() / max(np.sqrt((spread**2 / scale**4).sum()), 1e-12))
    variance = inflation * promised / safe**2 + _FINEST_PX**2
    return _CellDisplacements(displacement, variance, significant, sigmas, weights)


def _gain(left: Floats, right: Floats, usable: Floats, count: Array, grid: SampleGrid) -> float:
    """Return the root of the ratio of contrasts, right over left: the factor that equalises both images."""
    spreads = []
    for grey in (left, right):
        weighted = usable * grey
        squares = grid.segment_sums(weighted * grey) - grid.segment_sums(weighted) ** 2 / count
        spreads.append(max(float(squares.sum()), 1e-6))
    return float(np.clip((spreads[1] / spreads[0]) ** 0.25, 0.5, 2.0))


def _search(
    images: tuple[Image, Image], rig: StereoRig, start: DisparityPlane, layout: Layout
) -> DisparityPlane | NotFitted:
    """Try planes around the start; return the one with the largest sum of the cells' correlations."""
    pose = pose_from_plane(start, rig)
    grid = lay_out_samples(rig, pose, *layout, thinning=_SEARCH_THINNING)
    if grid is None:
        return _NOT_IN_VIEW
    changes = []
    for index, size in enumerate((SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD)):
        moved = pose.as_array()
        moved[index] += size
        change = plane_from_pose(Extrinsics.from_array(moved), rig).coefficients - start.coefficients
        reach = float(np.abs(grid.cell_rays @ change).max())
        n = min(_SEARCH_MOST_STEPS, int(np.ceil(reach / _SEARCH_STEP_PX)))
        changes.append(np.linspace(-1.0, 1.0, 2 * n + 1)[:, None] * change)
    combined = changes[0][:, None, None] + changes[1][None, :, None] + changes[2][None, None]
    candidates = combined.reshape(-1, 3)
    displacements = candidates @ grid.cell_rays.T
    most = int(np.ceil(np.abs(displacements).max())) + 1
    correlations = _correlate(images, grid, half_disparity(grid, start, rig), most)
    position = displacements + most
    below = position.astype(np.intp)
    part = position - below
    at = below * correlations.shape[1] + np.arange(correlations.shape[1])
    rise = np.diff(correlations, axis=0)
    score = (correlations.reshape(-1).take(at) + part * rise.reshape(-1).take(at)).sum(axis=1)
    return start.moved(candidates[int(np.argmax(score))])


def _correlate(images: tuple[Image, Image], grid: SampleGrid, half: Floats, most: int) -> Array:
    """Return the correlation in each cell for shifts of the right image by -most ... most px, (shifts, C)."""
    row = grid.v.astype(np.intp)
    sampled = np.bincount(row) > 0  # the blur runs along the rows, so only the sampled rows are needed
    rows_of_each = (each[: len(sampled)][sampled] for each in images)
    blurred = [cv2.GaussianBlur(rows, _SEARCH_KERNEL, _SEARCH_BLUR_PX) for rows in rows_of_each]
    grey = [np.asarray(image, np.uint8) for image in blurred]
    v = (np.cumsum(sampled) - 1).astype(np.float32)[row]
    shifts = np.arange(-most, most + 1, dtype=np.float32)[:, None]
    left = sample(grey[0], grid.u + half, v, cv2.INTER_LINEAR).astype(np.float32)
    rows = np.broadcast_to(v, (len(shifts), len(v)))
    right = sample(grey[1], grid.u - half - shifts, rows, cv2.INTER_LINEAR).astype(np.float32)
    # Sums of whole grey values are exact, so that the means can be removed from the products.
    sums = grid.segment_sums
    s_left, s_right = sums(left), sums(right)
    of_left = grid.cell_sums(sums(left * left) - s_left**2 / grid.lengths)
    of_right = sums(right * right) - s_right**2 / grid.lengths
    both = sums(left * right) - s_left * s_right / grid.lengths
    of_right, both = (grid.cell_sums(each.T).T for each in (of_right, both))
    correlations: Array = both / np.sqrt(of_left * of_right + 1e-6)
    return correlations


def _correlation(left: Floats, right: Floats, weights: Floats, grid: SampleGrid) -> float:
    """Return the correlation of both images over all cells; the means of the segments are removed."""
    sums = grid.segment_sums
    total = np.maximum(sums(weights), 1e-6)
    w_left, w_right = weights * left, weights * right
    s_left, s_right = sums(w_left), sums(w_right)
    both = (sums(w_left * right) - s_left * s_right / total).sum()
    squares = (sums(w_left * left) - s_left**2 / total).sum() * (
        sums(w_right * right) - s_right**2 / total
    ).sum()
    return float(both / np.sqrt(squares + 1e-6))


def _report(
    rig: StereoRig,
    plane: DisparityPlane,
    grid: SampleGrid,
    surface: Surface,
    cells: _CellDisplacements,
    lane_yaw_rad: float,
    correlation: float,
) -> TextureFit:
    """Return the fit from the results of the last pass."""
    pose = pose_from_plane(plane, rig)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    noise = np.sqrt(np.diag(jac_pose_plane @ surface.noise_covariance @ jac_pose_plane.T))
    terms = (UncertaintyTerm(name, each) for name, each in surface.covariance_terms.items())
    # A car ahead hides the road beyond it: that is no disagreement. The nearer stretch has to be seen.
    near = surface.on_road & (grid.cell_xy[:, 0] <= STRETCHES_M[0][1])
    under_car = np.abs(grid.cell_xy[:, 1] + np.tan(lane_yaw_rad) * grid.cell_xy[:, 0]) <= HALF_STRIP_M
    quality = TextureQuality(
        sigmas=cells.sigmas,
        cell_share=_agreeing_share(surface, grid, near),
        strip_share=_agreeing_share(surface, grid, near & under_car),
        pixel_share=float(cells.weights.sum()) / grid.n_samples,
        correlation=correlation,
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


def _agreeing_share(surface: Surface, grid: SampleGrid, which: Mask) -> float:
    """Return which share of the area of some cells agrees with the plane, 0 ... 1."""
    area = grid.cell_area * which
    return float(surface.weights @ area) / max(float(area.sum()), 1e-9)
