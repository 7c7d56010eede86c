"""The road plane from the grey values of the asphalt: both images aligned under one plane.

The disparity of a plane is linear in the image, so three numbers describe it: Gauss-Newton on the differences
of grey values (Lucas and Kanade, IJCAI 1981), both images moved by half the disparity so that interpolation
blurs both alike. Cell by cell, the differences give the height of the road over the plane; how the cells make
one plane, and how sure it is, is :mod:`stereo_selfcal.core.road.surface`.

Noise that is independent in the two cameras does not pass for texture: the information of a cell is the
product of the gradients in the left and in the right image, which noise alone leaves at zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.plane import DisparityPlane, jacobian_pose_wrt_plane, plane_from_pose, pose_from_plane
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, propagate_terms, total_covariance
from ..numerics.robust import TUKEY_SIGMAS, tukey_weights
from ..rejection import Bound, NotFitted
from ..road.cell_grid import FAR_M, HALF_WIDTH_M, Corridor, lay_out
from ..road.surface import Cells, RoadUnevenness, Surface, fit_surface
from ..tolerances import AGREEMENT, MAX_NOISE_STD
from ..types import Array, Floats, Image
from .sampling import half_disparity, places, prepare, sample, usable_samples, warp

# Error of the start that is found by search: a kerb's (60 mm), a frame's pitching (0.5 deg), another lane's
# cross slope (2 deg), and a quarter more.
SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD = 0.075, np.radians(0.65), np.radians(2.5)
_Layout = tuple[float, tuple[float, float], float]  # arguments of lay_out: yaw, limits, far end
_SEARCHED = np.array([SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD])
_MOST_RUN = 2.0  # times the search range: farther from the start it has run away
_SEARCH_BLUR_PX = 2.0  # correlation then has its peak over 2 px to either side
_SEARCH_KERNEL = (13, 1)
_SEARCH_STEP_PX = 1.0
_SEARCH_MOST_STEPS = 7  # to either side of the start, of each of the three numbers
_SEARCH_THINNING = 3

# Blur along the row [px] and thinning of the samples in each pass. With less blur than a pixel, interpolation
# does not treat all parts of a pixel alike. Where the first attempt does not find enough texture, the
# second gives up detail for a noise that is less by the root of the blur.
_ATTEMPTS = ((1.0, (2, 1)), (3.0, (1,)))
_MOST_STEP_PX = 4.0  # beyond, the plane is not the one that was found
# OpenCV interpolates at multiples of 1 / 32 px: an error of 0.009 px of a sample; of a cell's hundreds, this.
_FINEST_PX = 1e-3
_STEP_LIMIT_PX = 2.0  # a cell does not move farther in one pass: beyond, the gradient says nothing

_ABS_OF_SIGMA = 0.798  # mean absolute value of a Gaussian, sqrt(2 / pi)
_CELL_SIGMAS = 3.0  # significance of a cell's texture: one cell in 700 without any passes
_LEAST_SEGMENTS = 3
_ROUNDING = 1.0 / 12.0  # variance of rounding to whole grey levels: less is the steps of a smooth shade
# Sum of the squared autocorrelation, at whole pixels, of the derivative of noise, per pixel of its blur: so
# many samples count as one. It is an upper bound for samples farther apart.
_CORRELATED_SAMPLES = 1.88

_NOT_IN_VIEW = NotFitted("cells of the road in view", 0, Bound.LEAST, 1)

MIN_SIGMAS = 8.0
MIN_CELL_SHARE = 0.4


@dataclass(frozen=True, slots=True)
class TextureQuality:
    """Whether the road has enough texture, as figures.

    Attributes:
        sigmas: Texture common to both images over its own standard error, all cells together.
        cell_share: Part of the corridor's area in cells with significant texture that agree with the plane.
        pixel_share: Part of the samples that were used: not saturated, no paint, no outlier.
        correlation: Of the grey values of both images, rows' means removed, after alignment.
        noise_std: (height [m], pitch [rad], roll [rad]) standard deviations by the images' noise alone.
    """

    sigmas: float
    cell_share: float
    pixel_share: float
    correlation: float
    noise_std: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class TextureFit:
    """Outcome of the alignment.

    Attributes:
        extrinsics: Height, pitch and roll over the plane of the corridor.
        terms: What is not known of them; the sum is their covariance.
        quality: Whether there is enough texture, as figures.
        shape: What is no plane.
        cells_xy_m: (C, 2) middle of the cells on the road.
        cells_height_m: (C,) height over the plane; NaN without texture.
        cells_weight: (C,) 0 ... 1.
        cells_variance: (C,) of the heights by the noise of the images [m^2].
    """

    extrinsics: Extrinsics
    terms: tuple[UncertaintyTerm, ...]
    quality: TextureQuality
    shape: RoadUnevenness
    cells_xy_m: Array
    cells_height_m: Array
    cells_weight: Array
    cells_variance: Array

    @property
    def covariance(self) -> Array:
        """(3, 3) of height, pitch and roll: the sum of the terms."""
        return total_covariance(self.terms)

    @property
    def seen(self) -> bool:
        """Whether both images see the same texture, on enough of the road."""
        return self.quality.sigmas >= MIN_SIGMAS and self.quality.cell_share >= MIN_CELL_SHARE

    @property
    def enough_texture(self) -> bool:
        """Whether that is enough for an estimate."""
        return self.seen and bool(np.all(np.array(self.quality.noise_std) <= MAX_NOISE_STD))

    @property
    def even_enough(self) -> bool:
        """Whether the corridor is plane enough for the estimate to be compared with another one."""
        return bool(np.all(np.diag(self.covariance) <= AGREEMENT**2))

    @property
    def sufficiency(self) -> float:
        """Texture, area and evenness over what is needed, the least of them: below 1 it is no witness."""
        of_texture, of_area = self.quality.sigmas / MIN_SIGMAS, self.quality.cell_share / MIN_CELL_SHARE
        of_noise = MAX_NOISE_STD / self.quality.noise_std
        return float(min(of_texture, of_area, *of_noise, *(AGREEMENT / np.sqrt(np.diag(self.covariance)))))


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
) -> TextureFit | NotFitted:
    """Align the grey values of the road before the camera.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        start: Extrinsics to start from, within 60 mm, 0.5 deg and 2 deg.
        lane_yaw_rad: Heading of the camera against the lane.
        limits_m: Right and left limit of the corridor beside the camera [m], left positive.
        far_m: End of the corridor [m].
        keep_paint: Whether to use painted stripes as well; without them the answer is independent of theirs.
        vertical_px: Row of a point in the right image minus that in the left one, where it is known.

    Returns:
        The fit with its verdict, or why nothing could be aligned.
    """
    layout = (lane_yaw_rad, limits_m, far_m)
    searched = _search(images, rig, plane_from_pose(start, rig), layout)
    if isinstance(searched, NotFitted):
        return searched
    first: TextureFit | None = None
    for blur, thinnings in _ATTEMPTS:
        fit = _align(images, rig, searched, layout, blur, thinnings, keep_paint, vertical_px)
        if isinstance(fit, NotFitted):
            given_up = fit
            continue
        run = float(np.max(np.abs(fit.extrinsics.as_array() - start.as_array()) / _SEARCHED))
        if not run < _MOST_RUN:
            given_up = NotFitted("distance from the start over what is searched", run, Bound.MOST, _MOST_RUN)
            continue
        if fit.enough_texture:
            return fit
        first = first or fit
    return first or given_up


def _align(
    images: tuple[Image, Image],
    rig: StereoRig,
    plane: DisparityPlane,
    layout: _Layout,
    blur_px: float,
    thinnings: tuple[int, ...],
    keep_paint: bool,
    vertical_px: float,
) -> TextureFit | NotFitted:
    """Align from a plane on that is good to about a pixel: one pass for each thinning, and a last one."""
    prepared = None
    for i, thinning in enumerate(thinnings):
        last = i == len(thinnings) - 1
        corridor = lay_out(rig, pose_from_plane(plane, rig), *layout, thinning=thinning)
        if corridor is None:
            return _NOT_IN_VIEW
        half = half_disparity(corridor, plane, rig)
        usable = usable_samples(images, corridor, half, rig, None if keep_paint else blur_px)
        if prepared is None:
            prepared = prepare(images, blur_px, corridor)
        for final in (False, True)[: 1 + last]:
            half = half_disparity(corridor, plane, rig)
            place = places(prepared.first_row, corridor, half, vertical_px)
            grey, slopes = warp(prepared.grey, place), warp(prepared.slope, place)
            cells = _measure(grey, slopes, usable, corridor, blur_px)
            # A disparity that is too large by a pixel is a road too high by this much.
            metres = plane.height_m(rig) / plane.disparities(corridor.cell_rays)
            heights = np.where(cells.significant, cells.displacement * metres, np.nan)
            road = Cells(heights, cells.variance * metres**2, metres, corridor.cell_xy)
            surface = fit_surface(road, corridor.cell_rays * metres[:, None], final=final)
            if isinstance(surface, NotFitted):
                return surface
            step_px = float(np.abs(corridor.cell_rays @ surface.plane).max())
            if step_px > _MOST_STEP_PX:
                return NotFitted("change of disparity in a pass", step_px, Bound.MOST, _MOST_STEP_PX, "px")
            plane = plane.moved(surface.plane)
    assert corridor is not None and isinstance(surface, Surface)  # there are passes
    return _report(rig, plane, corridor, surface, cells, _correlation(*grey, cells.weights, corridor))


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """What the cells say about the plane under which both images were sampled.

    Attributes:
        displacement: (C,) disparity over that of the plane [px].
        variance: (C,) of it by the noise [px^2].
        significant: (C,) whether the cell has texture.
        sigmas: Texture over its standard error, all cells together.
        weights: (N,) of the samples.
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
    corridor: Corridor,
    blur_px: float,
) -> _Cells:
    """Fit the displacement of every cell, samples weighted robustly."""
    sums, cells = corridor.segment_sums, corridor.cell_sums
    count = np.maximum(sums(usable), 1e-6)
    gain = np.float32(_gain(*grey, usable, count, corridor))
    difference = grey[0] * gain - grey[1] / gain
    slope_left, slope_right = slopes[0] * gain, slopes[1] / gain
    rest = (difference - corridor.to_samples(sums(usable * difference) / count)) * usable
    per_cell = np.maximum(cells(count), 1.0)
    scale = np.maximum(cells(sums(np.abs(rest))) / per_cell / _ABS_OF_SIGMA, 0.1)
    relative = rest * corridor.to_samples(corridor.to_segments(1.0 / (TUKEY_SIGMAS * scale)))
    weights = tukey_weights(relative * relative)
    weights *= usable
    # Sums of a segment, means removed; the slope is the mean of both images'.
    total = np.maximum(sums(weights), 1e-6)
    w_left, w_right = weights * slope_left, weights * slope_right
    s_left, s_right, s_difference = sums(w_left), sums(w_right), sums(weights * difference)
    gradient = (s_left + s_right) * s_difference / total - sums((w_left + w_right) * difference)
    gradient /= 2.0
    common = sums(w_left * slope_right) - s_left * s_right / total
    of_left = sums(w_left * slope_left) - s_left**2 / total
    of_right = sums(w_right * slope_right) - s_right**2 / total
    information = (of_left + 2.0 * common + of_right) / 4.0
    # Of noise alone, the products of gradients have a mean of zero and this variance.
    alone = np.clip(of_left * of_right, 0.0, None) * (_CORRELATED_SAMPLES * blur_px) / total
    in_cell, spread = cells(common), np.sqrt(cells(alone))
    significant = (in_cell > _CELL_SIGMAS * spread) & (corridor.cell_lengths >= _LEAST_SEGMENTS)
    rounding = _ROUNDING / (4.0 * np.sqrt(np.pi) * blur_px**3)  # variance of its derivative, blurred
    significant &= in_cell > rounding * cells(total)
    safe = np.where(significant, in_cell, 1.0)
    displacement = np.clip(cells(gradient) / safe, -_STEP_LIMIT_PX, _STEP_LIMIT_PX)
    misfit = cells((gradient - common * corridor.to_segments(displacement)) ** 2)
    promised = np.maximum(scale**2 * cells(information), 1e-9)
    # Neighbours in a row are correlated, by the blur and by the road: how much, is one number for all cells.
    ratio = misfit[significant] / promised[significant]
    inflation = float(np.mean(ratio)) if ratio.size else 1.0
    sigmas = float((in_cell / scale**2).sum() / max(np.sqrt((spread**2 / scale**4).sum()), 1e-12))
    variance = inflation * promised / safe**2 + _FINEST_PX**2
    return _Cells(displacement, variance, significant, sigmas, weights)


def _gain(left: Floats, right: Floats, usable: Floats, count: Array, corridor: Corridor) -> float:
    """Return the root of the ratio of contrasts, right over left: it makes both alike."""
    spreads = []
    for grey in (left, right):
        weighted = usable * grey
        squares = corridor.segment_sums(weighted * grey) - corridor.segment_sums(weighted) ** 2 / count
        spreads.append(max(float(squares.sum()), 1e-6))
    return float(np.clip((spreads[1] / spreads[0]) ** 0.25, 0.5, 2.0))


def _search(
    images: tuple[Image, Image], rig: StereoRig, start: DisparityPlane, layout: _Layout
) -> DisparityPlane | NotFitted:
    """Try planes around the start; return the one under which the most cells correlate."""
    pose = pose_from_plane(start, rig)
    corridor = lay_out(rig, pose, *layout, thinning=_SEARCH_THINNING)
    if corridor is None:
        return _NOT_IN_VIEW
    changes = []
    for index, size in enumerate((SEARCH_HEIGHT_M, SEARCH_PITCH_RAD, SEARCH_ROLL_RAD)):
        moved = pose.as_array()
        moved[index] += size
        change = plane_from_pose(Extrinsics.from_array(moved), rig).coefficients - start.coefficients
        reach = float(np.abs(corridor.cell_rays @ change).max())
        n = min(_SEARCH_MOST_STEPS, int(np.ceil(reach / _SEARCH_STEP_PX)))
        changes.append(np.linspace(-1.0, 1.0, 2 * n + 1)[:, None] * change)
    grid = changes[0][:, None, None] + changes[1][None, :, None] + changes[2][None, None]
    candidates = grid.reshape(-1, 3)
    displacements = candidates @ corridor.cell_rays.T
    most = int(np.ceil(np.abs(displacements).max())) + 1
    correlations = _correlate(images, corridor, half_disparity(corridor, start, rig), most)
    position = displacements + most
    below = position.astype(np.intp)
    part = position - below
    at = below * correlations.shape[1] + np.arange(correlations.shape[1])
    rise = np.diff(correlations, axis=0)
    score = (correlations.reshape(-1).take(at) + part * rise.reshape(-1).take(at)).sum(axis=1)
    return start.moved(candidates[int(np.argmax(score))])


def _correlate(images: tuple[Image, Image], corridor: Corridor, half: Floats, most: int) -> Array:
    """Correlate both images, cell by cell, with the right one shifted by -most ... most; (shifts, C)."""
    row = corridor.v.astype(np.intp)
    seen = np.bincount(row) > 0  # only those rows are blurred, along themselves
    blurred = [cv2.GaussianBlur(each[: len(seen)][seen], _SEARCH_KERNEL, _SEARCH_BLUR_PX) for each in images]
    grey = [np.asarray(image, np.uint8) for image in blurred]
    v = (np.cumsum(seen) - 1).astype(np.float32)[row]
    shifts = np.arange(-most, most + 1, dtype=np.float32)[:, None]
    left = sample(grey[0], corridor.u + half, v, cv2.INTER_LINEAR).astype(np.float32)
    rows = np.broadcast_to(v, (len(shifts), len(v)))
    right = sample(grey[1], corridor.u - half - shifts, rows, cv2.INTER_LINEAR).astype(np.float32)
    # Whole grey values: their sums are exact, so that means can be removed from products.
    sums = corridor.segment_sums
    s_left, s_right = sums(left), sums(right)
    of_left = corridor.cell_sums(sums(left * left) - s_left**2 / corridor.lengths)
    of_right = sums(right * right) - s_right**2 / corridor.lengths
    both = sums(left * right) - s_left * s_right / corridor.lengths
    of_right, both = (corridor.cell_sums(each.T).T for each in (of_right, both))
    correlations: Array = both / np.sqrt(of_left * of_right + 1e-6)
    return correlations


def _correlation(left: Floats, right: Floats, weights: Floats, corridor: Corridor) -> float:
    """Return the correlation of both images over all cells, rows' means removed."""
    sums = corridor.segment_sums
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
    corridor: Corridor,
    surface: Surface,
    cells: _Cells,
    correlation: float,
) -> TextureFit:
    """Turn the last pass into what is returned."""
    pose = pose_from_plane(plane, rig)
    jac_pose_plane = jacobian_pose_wrt_plane(plane, rig)
    noise = np.sqrt(np.diag(jac_pose_plane @ surface.noise_covariance @ jac_pose_plane.T))
    terms = (UncertaintyTerm(name, each) for name, each in surface.covariance_by_cause.items())
    agreeing = surface.weights * corridor.cell_area
    quality = TextureQuality(
        sigmas=cells.sigmas,
        cell_share=float(agreeing.sum() / corridor.cell_area.sum()),
        pixel_share=float(cells.weights.sum()) / corridor.n_samples,
        correlation=correlation,
        noise_std=(float(noise[0]), float(noise[1]), float(noise[2])),
    )
    return TextureFit(
        extrinsics=pose,
        terms=propagate_terms(terms, jac_pose_plane),
        quality=quality,
        shape=surface.shape,
        cells_xy_m=corridor.cell_xy,
        cells_height_m=surface.residuals,
        cells_weight=surface.weights,
        cells_variance=surface.noise_variance,
    )
