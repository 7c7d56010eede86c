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

"""Grey values beside and within a stripe: they tell a painted line from a kerb or a rail.

The bright top of a kerb is as straight, as parallel and as bright as a painted line. Two lines alone do not
tell that one of them lies too high. Beside paint, the road surface of the lane begins at the edge of the
stripe. Beside the top of a kerb, its face lies between the stripe and the road surface; beside a guard rail,
its lower half does. Such a face appears as a strip of another grey value.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..estimators.stripe_fit import StripeFit
from ..geometry.plane import DisparityPlane, plane_from_pose
from ..geometry.rays import pixel_rays
from ..lanes.lane_pair import ImageLine, LanePattern
from ..lanes.stripe_points import MIN_CONTRAST_GREY
from ..numerics.statistics import SIGMA_OVER_MAD, upper_median
from ..types import Array, Image
from .kerb_face import NOT_MEASURED, EdgeStep, measure_edge_steps

# Strip beside the stripe, on the side of the lane [m]. A camera that is as high above a kerb as it is beside
# it sees there the face of a kerb of 6 cm and more. The lane is read in two ranges, and the one that differs
# less from the strip counts. The narrow range begins beyond a face of 15 cm, where a shadow is least likely
# to begin; but a second line may lie in it. A second line covers less than half of the wide range.
_STRIP_M, _LANE_RANGES_M = (0.02, 0.08), ((0.20, 0.40), (0.15, 0.90))
_STRIP_SAMPLES, _LANE_SAMPLES = 12, 27  # across each
_HALVES = ((0.2, 0.4), (0.6, 0.8))  # of a stripe, counted from the lane, without its edges
_MAX_SHADED_DIFFERENCE = 0.06  # of the contrast: both sides of a stripe in a shadow may differ by this
# The face of the lowest kerbs is 6 cm high. Its width along the row grows with the slope of its line, so it
# may be narrower than the strip. Such a narrow strip is read apart, from a pixel farther from the edge, as
# lines that bend a little are off by as much. It is read where it is at least a quarter of a pixel wide.
_LOWEST_KERB_M, _NARROW_GAP_PX, _LEAST_NARROW_PX = 0.06, 1.0, 0.25
# No pixel is read nearer to an edge than lens and pixel smear it: there, 0.6 % of the edge remains.
# The strip beside the stripe must be as wide as that. Within the stripe, both edges add the same to both
# halves, so 0.6 of the distance is enough.
_SMEAR_SIGMAS, _INNER_SMEAR = 2.5, 0.6
_PIXEL_VARIANCE = 1.0 / 12.0
_LEAST_ROWS, _MOST_ROWS = 12, 400  # all rows of usual images
_CONTRAST_PERCENTILE = 75.0  # of the rows: at least a quarter of a dashed line is painted
# A strip of another grey is surely there where it differs by more than three standard deviations, and by more
# than lens and pixel leave of the two edges of the stripe.
_SURELY_SIGMAS, EDGE_REMAINDER = 3.0, 0.01
# A face of 12 % of the contrast is four times this standard deviation. Where the median of the rows is less
# certain, and by another cause than noise, such a face may be missed. With noise, the whole variance of the
# rows is from row to row; with dapples or glare, little of it is.
_MAX_MEDIAN_STD, _MIN_NOISE_SHARE = 0.03, 0.25


@dataclass(frozen=True, slots=True)
class StripeBorder:
    """Grey values beside and within a stripe, mean of both cameras, as fractions of the stripe's contrast.

    Attributes:
        step: Grey of the strip beside the stripe minus grey of the lane; not 0 where a kerb shows its face.
            It is set to 0 where a shadow darkens both sides of the stripe.
        step_std: Its standard deviation by the scatter of the rows.
        half_difference: Grey of the half of the stripe on the side of the lane minus grey of the other half.
            It is not 0 where the fit takes a face for a part of the stripe, or a rail for a stripe.
        half_difference_std: Its standard deviation.
        narrow_step: As ``step``, for a strip as narrow as the face of the lowest kerb. A face has the same
            step far and near; where the steps differ, the smaller one is given. NaN where such a strip is too
            narrow in the image.
        narrow_step_std: Its standard deviation.
        edge_step: How low the edge towards the lane lies below the other edge of the stripe.
        line: Index of the boundary: 0 the left one, 1 the right one.
        may_hide_face: Whether the grey values beside the stripe vary so much that most faces of kerbs would
            be missed.
        unshaded_difference: The part of ``half_difference`` that no shadow explains. A shadow whose edge lies
            within the stripe changes the paint by no more than it changes the road surface on either side.
    """

    step: float
    step_std: float
    half_difference: float = 0.0
    half_difference_std: float = 0.0
    narrow_step: float = np.nan
    narrow_step_std: float = np.nan
    edge_step: EdgeStep = NOT_MEASURED
    line: int = 0
    may_hide_face: bool = False
    unshaded_difference: float = 0.0

    @property
    def doubtful(self) -> bool:
        """Whether a kerb cannot be ruled out: a faint strip is surely there, or a face would be missed."""
        return self.may_hide_face or not all(
            abs(value) <= max(EDGE_REMAINDER, _SURELY_SIGMAS * std)  # false for NaN
            for value, std in ((self.step, self.step_std), (self.narrow_step, self.narrow_step_std))
        )


def measure_borders(
    images: tuple[Image, Image], pattern: LanePattern, refined: StripeFit, rig: StereoRig
) -> tuple[StripeBorder, ...]:
    """Measure the grey values between the boundaries of a lane and its road surface, in both cameras.

    Args:
        images: Left and right image, (H, W) uint8.
        pattern: The lines.
        refined: Fit of the stripes: their widths, blur and residuals, and the pose.
        rig: Intrinsics and baseline.

    Returns:
        One for each boundary whose strip is wide enough in at least 12 rows of a camera.
    """
    plane = plane_from_pose(refined.extrinsics, rig)
    edge_steps = measure_edge_steps(refined.residuals, refined.widths_m, rig)
    borders = []
    for index, lines in enumerate(zip(pattern.left, pattern.right, strict=True)):
        width_m = float(refined.widths_m[index])
        measured = (
            _measure_border(image, line, (width_m, float(blur)), index == 0, plane, rig)
            for image, line, blur in zip(images, lines, refined.blur_px, strict=True)
        )
        seen = [border for border in measured if border is not None]
        if seen:
            step = _mean_of([(each.step, each.step_std) for each in seen])
            halves = _mean_of([(each.half_difference, each.half_difference_std) for each in seen])
            unshaded, _ = _mean_of([(each.unshaded_difference, each.half_difference_std) for each in seen])
            narrow = _mean_of(
                [(each.narrow_step, each.narrow_step_std) for each in seen if np.isfinite(each.narrow_step)]
            )
            may_hide_face = any(each.may_hide_face for each in seen)
            edge_step = edge_steps[index]
            borders.append(StripeBorder(*step, *halves, *narrow, edge_step, index, may_hide_face, unshaded))
    return tuple(borders)


def _mean_of(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of independent values and its standard deviation; NaN of none."""
    if not pairs:
        return np.nan, np.nan
    values, stds = np.array(pairs).T
    return float(values.mean()), float(np.sqrt((stds**2).mean() / len(stds)))


def _measure_border(
    image: Image,
    line: ImageLine,
    stripe: tuple[float, float],
    lane_is_right: bool,
    plane: DisparityPlane,
    rig: StereoRig,
) -> StripeBorder | None:
    """Measure one boundary in one image; None where too few rows show enough of it.

    Args:
        image: (H, W) uint8.
        line: Left edge of the stripe.
        stripe: Width of the stripe [m] and blur of its edges [px].
        lane_is_right: Whether the lane lies to the right of the stripe.
        plane: The road, of the camera in the middle.
        rig: Intrinsics and baseline.
    """
    width_m, blur_px = stripe
    # The blur is measured across the edge; along the row, an inclined edge is smeared more.
    smear_px = _SMEAR_SIGMAS * float(np.sqrt((blur_px**2 + _PIXEL_VARIANCE) * (1.0 + line.slope**2)))
    top, bottom = int(np.ceil(line.rows.min())), int(line.rows.max())
    rows = np.arange(top, bottom + 1, max(1, (bottom - top) // _MOST_ROWS)).astype(np.float64)
    edge = line.column_at(rows)
    px_per_m = plane.disparities(pixel_rays(rig, edge, rows)) / rig.baseline_m
    side = 1.0 if lane_is_right else -1.0
    if lane_is_right:
        edge = edge + width_m * px_per_m
    seen = (_STRIP_M[1] - _STRIP_M[0]) * px_per_m >= smear_px
    farthest = edge + side * (_LANE_RANGES_M[1][1] * px_per_m + smear_px)
    seen &= (farthest > 0) & (farthest < image.shape[1] - 1)
    if np.count_nonzero(seen) < _LEAST_ROWS:
        return None
    rows, edge, px_per_m = rows[seen, None], edge[seen, None], px_per_m[seen, None]

    # One read for each row: the strip beside the stripe, the lane twice, the other side, both halves.
    near_m = np.linspace(*_STRIP_M, _STRIP_SAMPLES)
    parts = [near_m, *(np.linspace(*reach, _LANE_SAMPLES) for reach in _LANE_RANGES_M), -near_m - width_m]
    gaps_px = [smear_px, smear_px, smear_px, -smear_px, 0.0, 0.0]
    parts += [-width_m * np.linspace(first, last, _STRIP_SAMPLES) for first, last in _HALVES]
    reach = np.concatenate(parts) * px_per_m + np.repeat(gaps_px, [len(part) for part in parts])
    narrow_px = _LOWEST_KERB_M * abs(line.slope) * rig.fy / rig.fx * px_per_m
    beside_px = smear_px + _NARROW_GAP_PX
    reach = np.column_stack(
        [beside_px + (narrow_px - beside_px) * np.linspace(0.0, 1.0, _STRIP_SAMPLES), reach]
    )
    u = (edge + side * reach).astype(np.float32)
    v = np.broadcast_to(rows, u.shape).astype(np.float32)
    read = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    strips = np.split(read, np.cumsum([_STRIP_SAMPLES, *(len(part) for part in parts)])[:-1], axis=1)
    narrow_usable = narrow_px[:, 0] >= beside_px + _LEAST_NARROW_PX
    halves_usable = _HALVES[0][0] * width_m * px_per_m[:, 0] >= _INNER_SMEAR * smear_px
    return _compare(strips, narrow_usable, halves_usable)


def _compare(
    strips: list[Array], narrow_usable: npt.NDArray[np.bool_], halves_usable: npt.NDArray[np.bool_]
) -> StripeBorder | None:
    """Compare the strips beside and within a stripe with its lane.

    Args:
        strips: (N, samples) grey values of each: the narrow strip, the strip beside the stripe, the lane in
            two ranges, the other side, the half of the stripe towards the lane, the other half.
        narrow_usable: (N,) whether the narrow strip is wide enough in a row.
        halves_usable: (N,) whether the stripe is wide enough in a row to tell its halves apart.
    """
    narrow, near, *lanes, beyond, first_half, second_half = strips
    near, beyond = near.mean(axis=1), beyond.mean(axis=1)
    lane = min((np.median(each, axis=1) for each in lanes), key=lambda each: abs(upper_median(near - each)))
    halves = [first_half.mean(axis=1), second_half.mean(axis=1)]
    stripe_contrast = np.mean(halves, axis=0) - near
    contrast = float(np.percentile(stripe_contrast, _CONTRAST_PERCENTILE))
    if contrast < MIN_CONTRAST_GREY:
        return None
    step, step_std = _median_and_std(near - lane)
    may_hide_face = _may_hide_face(near - lane, contrast)
    # Only rows that show paint, and enough of it between its edges.
    halves_usable = halves_usable & (stripe_contrast > contrast / 2.0)
    differences = _half_differences(*(each[halves_usable] for each in (*halves, near, beyond)))
    shadow = abs(upper_median(near - beyond)) <= _MAX_SHADED_DIFFERENCE * contrast
    if step < 0.0 and not shadow and _brightens_towards_lane(differences, contrast):
        shadow = may_hide_face = True
    if step < 0.0 and shadow:
        step = 0.0
    narrow_step = narrow_std = np.nan
    if np.count_nonzero(narrow_usable) >= _LEAST_ROWS:
        narrow_step, narrow_std, hidden = _step_along((narrow.mean(axis=1) - lane)[narrow_usable])
        may_hide_face = may_hide_face or hidden > _MAX_MEDIAN_STD * contrast
        if narrow_step < 0.0 and shadow:
            narrow_step = 0.0
    half_difference, half_difference_std, unshaded_difference = differences
    return StripeBorder(
        step / contrast,
        step_std / contrast,
        half_difference / contrast,
        half_difference_std / contrast,
        narrow_step / contrast,
        narrow_std / contrast,
        may_hide_face=may_hide_face,
        unshaded_difference=unshaded_difference / contrast,
    )


def _half_differences(
    first_half: Array, second_half: Array, near: Array, beyond: Array
) -> tuple[float, float, float]:
    """Return the difference of a stripe's halves, its standard deviation, and what no shadow explains.

    Args:
        first_half: (N,) grey of the half towards the lane.
        second_half: (N,) grey of the other.
        near: (N,) grey of the road surface beside the first half.
        beyond: (N,) grey of that beside the second half.
    """
    if len(near) < _LEAST_ROWS:
        return 0.0, 0.0, 0.0
    half_difference, std = _median_and_std(first_half - second_half)
    first, second, beside_first, beside_second = map(upper_median, (first_half, second_half, near, beyond))
    # Light on the first half over light on the second half.
    ratio = max(beside_first, 1.0) / max(beside_second, 1.0)
    shadow_effect = second * (ratio - 1.0) if ratio < 1.0 else first * (1.0 - 1.0 / ratio)
    # A shadow may end anywhere in the stripe, so it explains any part of its full effect.
    explained = float(np.clip(half_difference, min(shadow_effect, 0.0), max(shadow_effect, 0.0)))
    return half_difference, std, half_difference - explained


def _brightens_towards_lane(differences: tuple[float, float, float], contrast: float) -> bool:
    """Whether the paint is surely brighter towards the lane, and a shadow explains all of that.

    The edge of a shadow brightens the paint towards the lane, and leaves the strip beside the stripe darker
    than the lane. A face does not make the paint brighter; but such an edge may hide a face.
    """
    half_difference, std, unshaded_difference = differences
    surely_not_zero = max(EDGE_REMAINDER * contrast, _SURELY_SIGMAS * std)
    return half_difference > surely_not_zero and unshaded_difference == 0.0


def _step_along(values: Array) -> tuple[float, float, float]:
    """Return the median of the rows, its standard deviation, and the size of a face that may be hidden.

    A face runs along the whole stripe; an edge that is off where a stripe bends does not. So the far and the
    near half of the rows are compared. Where they agree within three standard deviations, all rows are taken
    together. Where they differ and have the same sign, the smaller median is returned. Where they differ in
    sign, the median is 0, and the last value is half their difference: a face of that size may be hidden.
    """
    halves = [_median_and_std(half) for half in np.array_split(values, 2)]
    (far, far_std), (near, near_std) = halves
    if abs(far - near) <= _SURELY_SIGMAS * float(np.hypot(far_std, near_std)):
        return *_median_and_std(values), 0.0
    if far * near <= 0.0:
        return 0.0, max(far_std, near_std), abs(far - near) / 2.0
    return *min(halves, key=lambda half: abs(half[0])), 0.0


def _median_and_std(values: Array) -> tuple[float, float]:
    """Return the median of the rows and its standard deviation, the rows taken as independent."""
    return upper_median(values), _scatter(values) / float(np.sqrt(len(values)))


def _may_hide_face(values: Array, contrast: float) -> bool:
    """Whether the rows vary so much by other causes than noise that their median may miss a face.

    Neighbouring rows see the same dapples, glare or second line. Where they differ less from row to row than
    they scatter, they count as fewer independent rows. Their number is that of a first order autoregression
    (Box, Jenkins and Reinsel, Time Series Analysis, 1994, section 3.2).
    """
    scatter = _scatter(values)
    if scatter == 0.0:
        return False
    row_to_row = SIGMA_OVER_MAD * upper_median(np.abs(np.diff(values)))
    noise_share = float(np.clip(row_to_row**2 / (2.0 * scatter**2), 1.0 / len(values), 1.0))
    std = scatter * float(np.sqrt((2.0 - noise_share) / noise_share / len(values)))
    return noise_share < _MIN_NOISE_SHARE and std > _MAX_MEDIAN_STD * contrast


def _scatter(values: Array) -> float:
    """Return the standard deviation of the rows by their median absolute deviation."""
    return SIGMA_OVER_MAD * upper_median(np.abs(values - upper_median(values)))
