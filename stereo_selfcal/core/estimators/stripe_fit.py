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

"""Refinement: a maximum-likelihood fit of the stripes' grey values in both images at once.

The genetic algorithm compares lines that were fitted to one edge of each stripe. Here one road
(pose, yaw, position and width of all stripes) predicts both edges of all stripes in both images. It is fitted
to the grey values around the edges by Gauss-Newton.

Grey levels, ramps and blur are nuisances (`core.estimators.row_blocks`). The model is linearised about the
predicted edges. Each block of rows then gives the displacements of its edges, with their information. These
displacements are linear in the parameters of the road, and are combined robustly. A stripe beside the two
boundaries has a height of its own, with a prior that follows from the flatness of roads. Whatever its height,
it shows the direction of the lane.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..geometry.pose import Extrinsics
from ..lanes.lane_pair import LanePattern, row_towards
from ..numerics.derivatives import central_difference, point_by_point
from ..numerics.linear import is_covariance, rank_of
from ..rejection import Bound, NotFitted
from ..road.stripe_model import N_POSE, bent_columns, predict_edges
from ..types import Array, Image
from .gauss_newton import MIN_BLOCKS, RoadPrior, Step, solve_step
from .row_blocks import BLOCK_ROWS, RAMP_PX, EdgeResiduals, RowBlocks, measure_blocks
from .stripe_start import start_road

# Steps of the numerical derivative by the parameters of the road (`core.road.stripe_model`): height [m],
# pitch, roll, yaw [rad], curvature [1/m].
_POSE_STEPS = (1e-5, 1e-6, 1e-6, 1e-6, 1e-7)
_STRIPE_STEP = 1e-5  # of positions, widths and heights of the stripes [m]
_CURVATURE = 4  # index of the curvature among the parameters


@dataclass(frozen=True, slots=True)
class _Pass:
    """Settings of one Gauss-Newton step. The steps go from coarse to fine.

    Attributes:
        half_width: Half width of the window around each edge [px].
        added_blur: Blur added to the template [px].
        row_step: Distance between the rows of a block that are read [px].
        reweightings: Rounds of robust weights.
    """

    half_width: int
    added_blur: float
    row_step: int
    reweightings: int


# The first pass tolerates edges that are 3 px off (a width that is 10 % wrong). The last pass is the final
# fit and reads every row. Before it, two passes fit the blur without added blur. With only one of them, a
# lens that is sharper than assumed by half a pixel biases the pitch by a fifth of a standard deviation.
_PASSES = (
    _Pass(6, 2.0, 2, 2),
    _Pass(5, 0.5, 2, 2),
    _Pass(5, 0.0, 2, 2),
    _Pass(5, 0.0, 2, 2),
    _Pass(7, 0.0, 1, 5),
)

# Where the stripes of the frame before are known, with their widths and the blur: the first pass allows for
# the motion between two frames, and the second one fits the blur again.
_PASSES_AGAIN = (_Pass(6, 1.0, 2, 2), _PASSES[-1])

# First row, as a fraction of the way from the bottom of the image up to the vanishing point. Closer to the
# vanishing point, stripes are thinner than a pixel, and roads bend or change their slope.
_FIRST_ROW = 0.97

# Rows of blocks that all passes but the last one take at most, evenly: they need not be as accurate.
_MOST_ROWS_OF_BLOCKS = 60
_LEAST_ROWS_OF_BLOCKS = MIN_BLOCKS // 4  # two stripes in two images give four blocks to a row of blocks

_MAX_VIGNETTING = 0.6  # share of the light lost in the farthest corner: more than with any lens on a car

# A fit that turns the camera further has diverged: the search allows 60 deg at most.
_MOST_TURN_DEG = 75.0

_BLUR_START_PX, _BLUR_MIN_PX, BLUR_MAX_PX = 0.5, 0.05, 3.0


@dataclass(frozen=True, slots=True, eq=False)
class StripeFit:
    """Outcome of the refinement.

    Attributes:
        extrinsics: Height, pitch and roll.
        covariance: (3, 3) of height, pitch and roll: inverse information times the scale of the residuals.
        lane_yaw_rad: Yaw of the camera against the lane [rad].
        curvature_per_m: Curvature of the lane, > 0: to the left [1/m]; 0 where the lane was modelled as
            straight.
        positions_m: (L,) lateral positions of the stripes' middles at x = 0, left positive [m].
        widths_m: (L,) widths of the stripes [m].
        heights_m: (L,) heights of the stripes over the plane of the boundaries [m]; those of the boundaries
            are 0.
        blur_px: (2,) standard deviation of the blur of the left and right lens [px].
        noise_grey: Standard deviation of the grey values about the model.
        scale: Deviance of the blocks over the deviance that the noise explains; 1 where the model is exact.
        n_blocks: Number of blocks of rows that count.
        residuals: Residual displacements of the stripes' edges after the fit.
        vignetting: (2,) share of the light that the left and the right lens lose in the farthest corner.
        height_stds_m: (L,) standard deviations of the prior of the heights [m]; 0 for the boundaries.
        rows_of_blocks: Number of rows of blocks that were looked at, from the lowest row of the image on.
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
    vignetting: Array = field(default_factory=lambda: np.zeros(2))
    height_stds_m: Array = field(default_factory=lambda: np.zeros(2))
    rows_of_blocks: int = 0

    def road_under(self, pose: Extrinsics) -> Array:
        """Return the parameters (5 + 3 L,) of the same road under another pose."""
        lane = self.lane_yaw_rad, self.curvature_per_m
        return np.array([*pose.as_array(), *lane, *self.positions_m, *self.widths_m, *self.heights_m])


@dataclass(frozen=True, slots=True, eq=False)
class _FitStart:
    """Where a fit starts.

    Attributes:
        road: (5 + 3 L,) parameters of the road.
        height_stds_m: (L,) standard deviations of the prior of the stripes' heights [m].
        rows_of_blocks: Number of rows of blocks, from the lowest row of the image on.
        bent: Whether the lane has a curvature.
        blur_px: (2,) standard deviation of the blur of either lens [px].
        vignetting: (2,) share of the light that either lens loses in the farthest corner.
        variance: Variance of the grey values; 0 where it is not known.
    """

    road: Array
    height_stds_m: Array
    rows_of_blocks: int
    bent: bool
    blur_px: Array
    vignetting: Array
    variance: float


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
        curvature_per_m: Curvature of the lane to start from [1/m]; None where the road is straight.

    Returns:
        The fit, or the reason why there is none: too few blocks of rows show both edges of a stripe, the
        parameters are not determined, or the fit diverges.
    """
    first = row_towards(pattern.vanishing_point, _FIRST_ROW, rig)
    n_blocks = (rig.height - int(np.ceil(first))) // BLOCK_ROWS
    if n_blocks < _LEAST_ROWS_OF_BLOCKS:
        return NotFitted(
            "blocks of rows below the vanishing point", n_blocks, Bound.LEAST, _LEAST_ROWS_OF_BLOCKS
        )
    road = start_road(images, pattern, rig, start, curvature_per_m or 0.0)
    if isinstance(road, NotFitted):
        return road
    start_fit = _FitStart(
        road,
        pattern.height_stds_m,
        n_blocks,
        curvature_per_m is not None,
        np.full(2, _BLUR_START_PX),
        np.zeros(2),
        0.0,
    )
    return _fit(images, rig, start_fit, _PASSES)


def refine_again(
    images: tuple[Image, Image], rig: StereoRig, before: StripeFit, road: Array
) -> StripeFit | NotFitted:
    """Fit the stripes of the frame before in the next one.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        before: The fit in the frame before, of a straight lane.
        road: (5 + 3 L,) parameters of the road to start from, whose edges are good to three pixels.

    Returns:
        The fit, or the reason why there is none, as of :func:`refine`.
    """
    start = _FitStart(
        road,
        before.height_stds_m,
        before.rows_of_blocks,
        False,
        before.blur_px,
        before.vignetting,
        before.noise_grey**2,
    )
    return _fit(images, rig, start, _PASSES_AGAIN)


def _fit(
    images: tuple[Image, Image], rig: StereoRig, start: _FitStart, passes: tuple[_Pass, ...]
) -> StripeFit | NotFitted:
    """Fit a road by Gauss-Newton passes, the last of which is the final fit."""
    road, blur, vignetting = start.road, start.blur_px, start.vignetting
    heights = np.split(road[N_POSE:], 3)[2]
    varied = _varied(start.height_stds_m, start.bent)
    variance, n_blocks = start.variance, start.rows_of_blocks
    all_rows = np.arange(rig.height - n_blocks * BLOCK_ROWS, rig.height).reshape(n_blocks, BLOCK_ROWS)
    solution: Step | NotFitted | None = None
    thinning = -(-n_blocks // _MOST_ROWS_OF_BLOCKS)
    for one in passes:
        rows = all_rows[:: 1 if one is passes[-1] else thinning, :: one.row_step]
        columns, slopes, jac_columns_road = _predict(road, rows, varied, rig, start.bent)
        window = (one.half_width, one.added_blur)
        darkening = _vignetting_profile(columns, rig)
        steepness = vignetting[:, None, None] * darkening
        blocks = measure_blocks(images, columns, slopes, rows, blur, window, variance, steepness)
        variance = blocks.variance
        prior = RoadPrior(varied, heights, start.height_stds_m)
        solution = solve_step(blocks, jac_columns_road, one.reweightings, prior)
        if isinstance(solution, NotFitted):
            return solution
        step = solution.step
        road = road + step[: len(road)]
        # Far from the solution the blur cannot be measured, so its step is not applied. It is a free
        # parameter all the same; otherwise the blocks of a sharper or softer camera would be outliers.
        if one.added_blur == 0.0:
            blur = np.clip(blur + step[len(road) :], _BLUR_MIN_PX, BLUR_MAX_PX)
            if one is not passes[-1]:
                loss = vignetting + _measure_vignetting(blocks, darkening)
                vignetting = np.clip(loss, 0.0, _MAX_VIGNETTING)
        middles, widths, heights = np.split(road[N_POSE:], 3)
        diverged = _divergence(road)
        if diverged is not None:
            return diverged
    assert isinstance(solution, Step)  # there are passes
    covariance = _covariance_of_pose(solution, blocks.variance)
    if isinstance(covariance, NotFitted):
        return covariance
    return StripeFit(
        extrinsics=Extrinsics.from_array(road[:3]),
        covariance=covariance,
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
        vignetting=vignetting,
        height_stds_m=start.height_stds_m,
        rows_of_blocks=n_blocks,
    )


def _divergence(road: Array) -> NotFitted | None:
    """Return how the parameters of a road show that the fit has diverged; None where they do not."""
    widths = np.split(road[N_POSE:], 3)[1]
    least_m = float(min(road[0], widths.min())) if np.all(np.isfinite(road)) else -np.inf
    if least_m <= 0.0:
        return NotFitted("least of the height and the stripes' widths", least_m, Bound.LEAST, 0.0, "m")
    turn_deg = float(np.degrees(np.abs(road[1:4]).max()))
    if turn_deg >= _MOST_TURN_DEG:
        return NotFitted("greatest angle of the fit", turn_deg, Bound.MOST, _MOST_TURN_DEG, "deg")
    return None


def _covariance_of_pose(solution: Step, variance: float) -> Array | NotFitted:
    """Return the covariance (3, 3) of the pose, or why there is none."""
    covariance = solution.covariance(variance)
    if isinstance(covariance, NotFitted):
        return covariance
    of_pose: Array = (covariance[:3, :3] + covariance[:3, :3].T) / 2.0
    if not is_covariance(of_pose):
        rank = min(rank_of(of_pose), len(of_pose) - 1)
        return NotFitted("numbers of the pose that the stripes determine", rank, Bound.LEAST, len(of_pose))
    return of_pose


def _predict(
    road: Array, rows: npt.NDArray[np.intp], varied: npt.NDArray[np.bool_], rig: StereoRig, bent: bool
) -> tuple[Array, Array, Array]:
    """Return the predicted edges of the stripes, and their derivative by the free parameters of the road.

    Args:
        road: (P,) parameters of the road.
        rows: (N, R) rows of the blocks [px].
        varied: (P,) which parameters are free.
        rig: Intrinsics and baseline.
        bent: Whether the lane has a curvature.

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
    """Return the displacements of the edges that remain after a step, also for blocks that do not count."""
    explained = np.moveaxis(np.tensordot(step[: len(jac_columns_road)], jac_columns_road, axes=1), 2, -1)
    remainder = blocks.displacement[..., :2] - explained
    return EdgeResiduals(remainder, blocks, columns.mean(axis=-1), slopes, rows.mean(axis=1))


def _varied(height_stds_m: Array, bent: bool) -> npt.NDArray[np.bool_]:
    """Return which parameters of the road are free, (5 + 3 L,).

    The curvature is free where the lane is bent. The height of a stripe is free where its prior has a
    deviation.
    """
    beside = height_stds_m > 0.0
    varied = np.ones(N_POSE + 3 * len(beside), bool)
    varied[_CURVATURE] = bent
    varied[-len(beside) :] = beside
    return varied


def _vignetting_profile(columns: Array, rig: StereoRig) -> Array:
    """Return the steepness (2, L, N) of the ramp for a lens that loses all light in the farthest corner.

    The loss of light is modelled as the square of the distance from the principal point.
    """
    corner = max(rig.cx, rig.width - 1 - rig.cx) ** 2 + max(rig.cy, rig.height - 1 - rig.cy) ** 2
    steepness: Array = -2.0 * RAMP_PX * (columns.mean(axis=(2, 4)) - rig.cx) / corner
    return steepness


def _measure_vignetting(blocks: RowBlocks, profile: Array) -> Array:
    """Return each camera's loss of light in the farthest corner minus the expected loss, (2,)."""
    ramp = blocks.measure_ramp()
    information = ramp[..., 0] * profile**2 * blocks.usable
    gradient = ramp[..., 1] * profile * blocks.usable
    # Stripes that pass near the principal point give no information. The loss then keeps its former value.
    least = blocks.variance / _MAX_VIGNETTING**2
    loss: Array = gradient.sum(axis=(1, 2)) / np.maximum(information.sum(axis=(1, 2)), least)
    return loss
