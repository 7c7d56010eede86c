"""Refinement: a maximum-likelihood fit of the stripes' grey values in both images at once.

The genetic algorithm compares lines that were fitted to one edge of each stripe. Here one road
(pose, yaw, position and width of all stripes) predicts both edges of all stripes in both
images, and is fitted to the grey values around them by Gauss-Newton.

Grey levels, ramps and blur are nuisances (`core.estimators.row_blocks`). Linearised about the predicted
edges, a block of rows says how far its edges are off and with what information; these displacements are
linear in the parameters of the road, and are combined robustly. A stripe beside the two boundaries has a
height of its own, which is known only as far as roads are flat: it always says where the lane runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..lanes.lane_pair import LanePattern, row_towards
from ..lanes.line_geometry import lane_in_road
from ..numerics.derivatives import central_difference, point_by_point
from ..rejection import Bound, NotFitted
from ..road.stripe_model import N_POSE, bent_columns, predict_edges
from ..types import Array, Image
from .gauss_newton import MIN_BLOCKS, Known, Step, solve_step
from .row_blocks import BLOCK_ROWS, RAMP_PX, EdgeResiduals, RowBlocks, measure_blocks

# Steps of the numerical derivative by the parameters of the road (`core.road.stripe_model`) [m, rad];
# after them come the blur of the left and the right lens [px].
_POSE_STEPS = (1e-5, 1e-6, 1e-6, 1e-6, 1e-7)
_STRIPE_STEP = 1e-5
_CURVATURE = 4  # its place among the parameters


@dataclass(frozen=True, slots=True)
class _Pass:
    """One step of Gauss and Newton, from coarse to fine.

    Attributes:
        half_width: Half width of the window around each edge [px].
        added_blur: Blur added to the template [px].
        row_step: Every how many rows of a block are read.
        reweightings: Rounds of robust weights.
    """

    half_width: int
    added_blur: float
    row_step: int
    reweightings: int


# The first bears edges 3 px off (a width that is 10 % wrong), the last one is the fit itself, which reads
# every row; the others only lead there. Two of them have the blur free: with one, a lens that is sharper than
# supposed by half a pixel leaves a bias of a fifth of a standard deviation in pitch.
_PASSES = (
    _Pass(6, 2.0, 2, 2),
    _Pass(5, 0.5, 2, 2),
    _Pass(5, 0.0, 2, 2),
    _Pass(5, 0.0, 2, 2),
    _Pass(7, 0.0, 1, 5),
)

# First row, as the height over the bottom of the image relative to the vanishing point: closer to it
# stripes are thinner than a pixel and every road is a hill or a bend.
_FIRST_ROW = 0.97

_LEAST_ROWS_OF_BLOCKS = MIN_BLOCKS // 4  # two stripes in two images are four to a row

_MAX_VIGNETTING = 0.6  # share of the light lost in the farthest corner: more than any lens on a car

_BLUR_START_PX, _BLUR_MIN_PX, BLUR_MAX_PX = 0.5, 0.05, 3.0

# Stripe widths tried at the start [m].
_WIDTHS_M = np.linspace(0.04, 0.70, 67)


@dataclass(frozen=True, slots=True, eq=False)
class StripeFit:
    """Outcome of the refinement.

    Attributes:
        extrinsics: Height, pitch and roll.
        covariance: (3, 3) of them: inverse information, times the scale of the residuals.
        lane_yaw_rad: Yaw of the camera against the lane [rad].
        curvature_per_m: Curvature of the lane, > 0: to the left [1/m]; 0 where it was taken as straight.
        positions_m: (L,) middle of the stripes at x = 0, left positive [m].
        widths_m: (L,) width of the stripes [m].
        heights_m: (L,) height of the stripes over the plane of the boundaries [m], which are in it.
        blur_px: (2,) standard deviation of the blur of the left and right lens [px].
        noise_grey: Standard deviation of the grey values about the model.
        scale: Deviance of a block over what the noise explains; 1 where the model is the road.
        n_blocks: Blocks of rows that count.
        residuals: What the edges of the stripes are off after the fit.
    """

    extrinsics: Extrinsics
    covariance: Array
    lane_yaw_rad: float
    curvature_per_m: float
    positions_m: Array
    widths_m: Array
    heights_m: Array
    blur_px: Array
    noise_grey: float
    scale: float
    n_blocks: int
    residuals: EdgeResiduals


def refine(
    images: tuple[Image, Image],
    pattern: LanePattern,
    rig: StereoRig,
    start: Extrinsics,
    curvature_per_m: float | None = None,
) -> StripeFit | NotFitted:
    """Fit the road to the grey values around the edges of the stripes.

    Args:
        images: Left and right image, (H, W) uint8.
        pattern: The matched lines, for yaw and position of the stripes.
        rig: Intrinsics and baseline.
        start: Extrinsics to start from, good to a few pixels in the image.
        curvature_per_m: Curvature of the lane to start from; None where the road is straight.

    Returns:
        The fit, or why there is none: too few blocks of rows show both edges of a stripe, or it runs away.
    """
    first = row_towards(pattern.vanishing_point, _FIRST_ROW, rig)
    n_blocks = (rig.height - int(np.ceil(first))) // BLOCK_ROWS
    if n_blocks < _LEAST_ROWS_OF_BLOCKS:
        return NotFitted(
            "blocks of rows below the vanishing point", n_blocks, Bound.LEAST, _LEAST_ROWS_OF_BLOCKS
        )
    yaw, *left_edges = lane_in_road(pattern, rig, start)
    n_stripes = len(left_edges)
    widths = _start_widths(images, pattern, rig, start)
    heights = np.zeros(n_stripes)
    road = np.array(
        [*start.as_array(), yaw, curvature_per_m or 0.0, *(left_edges - widths / 2.0), *widths, *heights]
    )
    varied = _varied(pattern, curvature_per_m is not None)
    blur = np.full(2, _BLUR_START_PX)
    noise = 0.0  # not known before the first pass
    vignetting: Array = np.zeros(2)
    all_rows = np.arange(rig.height - n_blocks * BLOCK_ROWS, rig.height).reshape(n_blocks, BLOCK_ROWS)
    solution: Step | NotFitted | None = None
    for one in _PASSES:
        rows = all_rows[:, :: one.row_step]
        columns, slopes, jac_columns_road = _predict(road, rows, varied, rig, curvature_per_m is not None)
        window = (one.half_width, one.added_blur)
        darkening = _vignetting_profile(columns, rig)
        steepness = vignetting[:, None, None] * darkening
        blocks = measure_blocks(images, columns, slopes, rows, blur, window, noise, steepness)
        noise = blocks.variance
        known = Known(varied, heights, pattern.height_stds_m)
        solution = solve_step(blocks, jac_columns_road, one.reweightings, known)
        if isinstance(solution, NotFitted):
            return solution
        step = solution.step
        road = road + step[: len(road)]
        # Far from the road its blur cannot be known, but must be free: else a camera that is sharper
        # or softer than supposed is taken for an outlier.
        if one.added_blur == 0.0:
            blur = np.clip(blur + step[len(road) :], _BLUR_MIN_PX, BLUR_MAX_PX)
            if one is not _PASSES[-1]:
                loss = vignetting + _measure_vignetting(blocks, darkening)
                vignetting = np.clip(loss, 0.0, _MAX_VIGNETTING)
        middles, widths, heights = np.split(road[N_POSE:], 3)
        least_m = float(min(road[0], widths.min())) if np.all(np.isfinite(road)) else -np.inf
        if least_m <= 0.0:
            return NotFitted("least of the height and the stripes' widths", least_m, Bound.LEAST, 0.0, "m")
    assert isinstance(solution, Step)  # there are passes
    covariance = solution.covariance(blocks.variance)
    if isinstance(covariance, NotFitted):
        return covariance
    pose = Extrinsics.from_array(road[:3])
    return StripeFit(
        extrinsics=pose,
        covariance=(covariance[:3, :3] + covariance[:3, :3].T) / 2.0,
        lane_yaw_rad=float(road[3]),
        curvature_per_m=float(road[_CURVATURE]),
        positions_m=middles,
        widths_m=widths,
        heights_m=heights,
        blur_px=blur,
        noise_grey=float(np.sqrt(blocks.variance)),
        scale=solution.scale,
        n_blocks=len(solution.relative),
        residuals=_residuals(blocks, jac_columns_road, step, columns, slopes, all_rows),
    )


def _predict(
    road: Array, rows: npt.NDArray[np.intp], varied: npt.NDArray[np.bool_], rig: StereoRig, bent: bool
) -> tuple[Array, Array, Array]:
    """Return where the edges of the stripes are, and how the free parameters of the road move them.

    Args:
        road: (P,) its parameters.
        rows: (N, R) rows of the blocks [px].
        varied: (P,) which parameters are free.
        rig: Intrinsics and baseline.
        bent: Whether the road is.

    Returns:
        Columns (2 cameras, L stripes, 2 edges, N, R) [px], slopes (2, L, 2) [columns a row], and the
        derivative of the columns in the middle of the blocks, (P, 2, L, 2, N).
    """
    steps = np.where(varied, [*_POSE_STEPS, *[_STRIPE_STEP] * (len(road) - N_POSE)], 0.0)
    middles = rows.mean(axis=1)
    if bent:
        columns = bent_columns(road, rows.astype(np.float64), rig)
        slopes = (columns[..., -1, -1] - columns[..., 0, 0]) / (rows[-1, -1] - rows[0, 0])
        bent_at = point_by_point(lambda one: bent_columns(one, middles, rig))
        return columns, slopes, central_difference(bent_at, road, steps)

    def straight_at(roads: Array) -> Array:
        edges = predict_edges(roads, rig)
        columns: Array = edges[..., :1] + edges[..., 1:] * middles
        return columns

    edges = predict_edges(road[None], rig)[0]
    columns = edges[..., :1, None] + edges[..., 1:, None] * rows
    return columns, edges[..., 1], central_difference(straight_at, road, steps)


def _residuals(
    blocks: RowBlocks,
    jac_columns_road: Array,
    step: Array,
    columns: Array,
    slopes: Array,
    rows: npt.NDArray[np.intp],
) -> EdgeResiduals:
    """Return what of the edges' displacements remains after a step; of blocks that do not count as well."""
    explained = np.moveaxis(np.tensordot(step[: len(jac_columns_road)], jac_columns_road, axes=1), 2, -1)
    remainder = blocks.displacement[..., :2] - explained
    return EdgeResiduals(remainder, blocks, columns.mean(axis=-1), slopes, rows.mean(axis=1))


def _varied(pattern: LanePattern, bent: bool) -> npt.NDArray[np.bool_]:
    """Return which parameters of the road are free, (5 + 3 L,): curvature and heights are not always."""
    beside = pattern.height_stds_m > 0.0
    varied = np.ones(N_POSE + 3 * len(beside), bool)
    varied[_CURVATURE] = bent
    varied[-len(beside) :] = beside
    return varied


def _vignetting_profile(columns: Array, rig: StereoRig) -> Array:
    """Return the steepness of the ramp in each block for a lens that loses all light in the farthest corner.

    The loss grows with the square of the distance from the principal point.
    """
    corner = max(rig.cx, rig.width - 1 - rig.cx) ** 2 + max(rig.cy, rig.height - 1 - rig.cy) ** 2
    steepness: Array = -2.0 * RAMP_PX * (columns.mean(axis=(2, 4)) - rig.cx) / corner
    return steepness


def _measure_vignetting(blocks: RowBlocks, profile: Array) -> Array:
    """Return by how much each camera's loss of light in the corner differs from the expected one, (2,)."""
    ramp = blocks.measure_ramp()
    known, found = ramp[..., 0] * profile**2 * blocks.usable, ramp[..., 1] * profile * blocks.usable
    # A camera whose stripes pass the principal point says nothing: the loss stays what it was.
    least = blocks.variance / _MAX_VIGNETTING**2
    loss: Array = found.sum(axis=(1, 2)) / np.maximum(known.sum(axis=(1, 2)), least)
    return loss


def _start_widths(
    images: tuple[Image, Image], pattern: LanePattern, rig: StereoRig, start: Extrinsics
) -> Array:
    """Return the widths of all stripes [m] that put their right edges on falling grey values."""
    horizon = float(pattern.vanishing_point[1])
    rows = np.arange(int(horizon) + 2 * BLOCK_ROWS, rig.height, 2)
    px_per_m = (rows - horizon) / start.height_m * rig.fx / rig.fy
    score = np.zeros((len(pattern.columns[0]), len(_WIDTHS_M)))
    for image, lines in zip(images, pattern.lines, strict=True):
        pixels = image[rows].astype(np.int16)  # differences may be negative
        for stripe, line in enumerate(lines):
            left = line.column_at(rows.astype(np.float64))[:, None]
            columns = np.rint(left + px_per_m[:, None] * _WIDTHS_M).astype(np.intp)
            seen = (columns > 0) & (columns < rig.width - 1) & (left > 0)
            columns = np.clip(columns, 1, rig.width - 2)
            before, after = (np.take_along_axis(pixels, columns + beside, axis=1) for beside in (-1, 1))
            falling = before - after
            score[stripe] += np.where(seen, falling, 0.0).sum(axis=0)
    widths: Array = _WIDTHS_M[np.argmax(score, axis=1)]
    return widths
