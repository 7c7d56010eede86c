"""Whether a stripe is paint on the asphalt of the lane: there, the asphalt goes on up to the paint.

The bright top of a kerb is as straight, as parallel and as bright as a painted line, and two lines alone do
not tell that one of them lies too high. But a kerb shows its face to the lane, a guard rail its lower half:
between the stripe and the asphalt there is a strip of another grey.
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
from .kerb_face import UNSEEN, EdgeStep, measure_edge_steps

# Beside the stripe, on the side of the lane [m]: where a kerb of 6 cm and more shows its face to a camera as
# high above it as it is aside. The lane begins beyond a face of 15 cm: next to that a shadow is least likely
# to begin, but a second line may lie there, which takes less than half of what is wider.
_NEAR_M, _LANES_M = (0.02, 0.08), ((0.20, 0.40), (0.15, 0.90))
_NEAR_SAMPLES, _LANE_SAMPLES = 12, 27  # across each
_HALVES = ((0.2, 0.4), (0.6, 0.8))  # of a stripe from the lane on, without its edges
_ALIKE = 0.06  # of the contrast, by which both sides of a stripe in a shadow may differ
# The face of the lowest kerbs is 6 cm high; a camera sees it as wide along the row as its line is inclined,
# which may be narrower than the strip. So it is looked for apart: a pixel farther from the edge, as lines
# that bend a little are off by as much, and where a quarter of a pixel is left of it.
_LOWEST_FACE_M, _FACE_PX, _LEAST_FACE_PX = 0.06, 1.0, 0.25
# Nothing is read nearer to an edge than what lens and pixel smear: of the edge, 0.6 % is left there. The
# strip beside the stripe must be as wide. Within the stripe both edges leave the same: less will do.
_SMEAR_SIGMAS, _INNER_SMEAR = 2.5, 0.6
_PIXEL_VARIANCE = 1.0 / 12.0
_LEAST_ROWS, _MOST_ROWS = 12, 400  # all rows of usual images
_CONTRAST_PERCENTILE = 75.0  # of the rows: at least a quarter of a dashed line is painted
# A strip of another grey is surely there beyond three standard deviations, and beyond what lens and pixel
# leave of the stripe's two edges.
_SURELY_SIGMAS, LEFT_OF_EDGES = 3.0, 0.01
# Where the median of the rows is less sure than this, by what lies there and not by noise, a face of 12 % may
# go unseen (four standard deviations). Of noise, all of the rows' variance is from row to row; of dapples or
# glare, little.
_BLIND_STD, _LIKE_NOISE = 0.03, 0.25


@dataclass(frozen=True, slots=True)
class StripeBorder:
    """What speaks against a stripe being paint, mean of both cameras, over the contrast of the stripe.

    Attributes:
        step: Grey of the strip beside the stripe less that of the lane: the face of a kerb. 0 where a shadow
            darkens both sides of the stripe.
        step_std: Its standard deviation by the scatter of the rows.
        tone: Grey of the half of the stripe that is turned to the lane less that of the other: a face that
            passes for a part of the stripe, the halves of a rail.
        tone_std: Its standard deviation.
        face: As step, of what is as narrow as the face of the lowest kerb, and the same far and near: where
            these differ, the smaller of both. NaN where that is too narrow in the image.
        face_std: Its standard deviation.
        lower: How low the edge towards the lane lies: a face that is a part of the stripe.
        line: Which of the two boundaries it is.
        covered: Whether so much else lies beside the stripe that most faces of kerbs would not be seen.
        own_tone: The part of the tone that is not a shadow's which ends within the stripe: that changes the
            paint by no more than it does the asphalt to either side.
    """

    step: float
    step_std: float
    tone: float = 0.0
    tone_std: float = 0.0
    face: float = np.nan
    face_std: float = np.nan
    lower: EdgeStep = UNSEEN
    line: int = 0
    covered: bool = False
    own_tone: float = 0.0

    @property
    def doubtful(self) -> bool:
        """Whether there may be a kerb: something faint is surely there, or its face would not be seen."""
        return self.covered or not all(
            abs(value) <= max(LEFT_OF_EDGES, _SURELY_SIGMAS * std)  # false for NaN
            for value, std in ((self.step, self.step_std), (self.face, self.face_std))
        )


def measure_borders(
    images: tuple[Image, Image], pattern: LanePattern, refined: StripeFit, rig: StereoRig
) -> tuple[StripeBorder, ...]:
    """Measure what lies between the boundaries of a lane and its asphalt, in both cameras.

    Args:
        images: Left and right image, (H, W) uint8.
        pattern: The lines.
        refined: Width of the stripes, and the plane.
        rig: Intrinsics and baseline.

    Returns:
        One for each boundary of which enough is wide enough.
    """
    plane = plane_from_pose(refined.extrinsics, rig)
    edge_steps = measure_edge_steps(refined.residuals, refined.widths_m, rig)
    rims = []
    for index, lines in enumerate(zip(pattern.left, pattern.right, strict=True)):
        width_m = float(refined.widths_m[index])
        seen = [
            rim
            for image, line, blur in zip(images, lines, refined.blur_px, strict=True)
            if (rim := _rim(image, line, (width_m, float(blur)), index == 0, plane, rig)) is not None
        ]
        if seen:
            step = _mean_of([(rim.step, rim.step_std) for rim in seen])
            tone = _mean_of([(rim.tone, rim.tone_std) for rim in seen])
            own_tone, _ = _mean_of([(rim.own_tone, rim.tone_std) for rim in seen])
            face = _mean_of([(rim.face, rim.face_std) for rim in seen if np.isfinite(rim.face)])
            covered = any(rim.covered for rim in seen)
            rims.append(StripeBorder(*step, *tone, *face, edge_steps[index], index, covered, own_tone))
    return tuple(rims)


def _mean_of(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of independent values and its standard deviation; NaN of none."""
    if not pairs:
        return np.nan, np.nan
    values, stds = np.array(pairs).T
    return float(values.mean()), float(np.sqrt((stds**2).mean() / len(stds)))


def _rim(
    image: Image,
    line: ImageLine,
    stripe: tuple[float, float],
    lane_is_right: bool,
    plane: DisparityPlane,
    rig: StereoRig,
) -> StripeBorder | None:
    width_m, blur_px = stripe
    # Along the row, an inclined edge is smeared more.
    smear_px = _SMEAR_SIGMAS * float(np.sqrt((blur_px**2 + _PIXEL_VARIANCE) * (1.0 + line.slope**2)))
    top, bottom = int(np.ceil(line.rows.min())), int(line.rows.max())
    rows = np.arange(top, bottom + 1, max(1, (bottom - top) // _MOST_ROWS)).astype(np.float64)
    edge = line.column_at(rows)
    px_per_m = plane.disparities(pixel_rays(rig, edge, rows)) / rig.baseline_m
    side = 1.0 if lane_is_right else -1.0
    if lane_is_right:
        edge = edge + width_m * px_per_m
    seen = (_NEAR_M[1] - _NEAR_M[0]) * px_per_m >= smear_px
    farthest = edge + side * (_LANES_M[1][1] * px_per_m + smear_px)
    seen &= (farthest > 0) & (farthest < image.shape[1] - 1)
    if np.count_nonzero(seen) < _LEAST_ROWS:
        return None
    rows, edge, px_per_m = rows[seen, None], edge[seen, None], px_per_m[seen, None]

    # All places of a row at once: the strip beside the stripe, the lane, the other side, both halves.
    near_m = np.linspace(*_NEAR_M, _NEAR_SAMPLES)
    parts = [near_m, *(np.linspace(*reach, _LANE_SAMPLES) for reach in _LANES_M), -near_m - width_m]
    beyond_px = [smear_px, smear_px, smear_px, -smear_px, 0.0, 0.0]
    parts += [-width_m * np.linspace(first, last, _NEAR_SAMPLES) for first, last in _HALVES]
    reach = np.concatenate(parts) * px_per_m + np.repeat(beyond_px, [len(part) for part in parts])
    face_px = _LOWEST_FACE_M * abs(line.slope) * rig.fy / rig.fx * px_per_m
    beside_px = smear_px + _FACE_PX
    reach = np.column_stack([beside_px + (face_px - beside_px) * np.linspace(0.0, 1.0, _NEAR_SAMPLES), reach])
    u = (edge + side * reach).astype(np.float32)
    v = np.broadcast_to(rows, u.shape).astype(np.float32)
    read = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    strips = np.split(read, np.cumsum([_NEAR_SAMPLES, *(len(part) for part in parts)])[:-1], axis=1)
    broad = face_px[:, 0] >= beside_px + _LEAST_FACE_PX
    wide = _HALVES[0][0] * width_m * px_per_m[:, 0] >= _INNER_SMEAR * smear_px
    return _compare(strips, broad, wide)


def _compare(
    strips: list[Array], broad: npt.NDArray[np.bool_], wide: npt.NDArray[np.bool_]
) -> StripeBorder | None:
    """Compare what lies beside and in a stripe with its lane.

    Args:
        strips: (N, samples) each: the narrowest face, the strip beside the stripe, the lane in two reaches,
            the other side, the half of the stripe towards the lane, the other half.
        broad: (N,) whether the narrowest face can be seen in a row.
        wide: (N,) whether the stripe is wide enough there to tell its halves apart.
    """
    face, near, *lanes, beyond, first_half, second_half = strips
    near, beyond = near.mean(axis=1), beyond.mean(axis=1)
    lane = min((np.median(each, axis=1) for each in lanes), key=lambda each: abs(upper_median(near - each)))
    halves = [first_half.mean(axis=1), second_half.mean(axis=1)]
    painted = np.mean(halves, axis=0) - near
    contrast = float(np.percentile(painted, _CONTRAST_PERCENTILE))
    if contrast < MIN_CONTRAST_GREY:
        return None
    step, step_std = _middle(near - lane)
    covered = _hides_a_face(near - lane, contrast)
    # Only where there is paint, and enough of it between its edges.
    wide = wide & (painted > contrast / 2.0)
    tones = _tones(*(each[wide] for each in (*halves, near, beyond)))
    shadow = abs(upper_median(near - beyond)) <= _ALIKE * contrast
    if step < 0.0 and not shadow and _grows(tones, contrast):
        shadow = covered = True
    if step < 0.0 and shadow:
        step = 0.0
    faces = [np.nan, np.nan]
    if np.count_nonzero(broad) >= _LEAST_ROWS:
        *faces, hidden = _alike_along((face.mean(axis=1) - lane)[broad])
        covered = covered or hidden > _BLIND_STD * contrast
        if faces[0] < 0.0 and shadow:
            faces[0] = 0.0
    tone, tone_std, own_tone = (value / contrast for value in tones)
    step, step_std, narrow, narrow_std = (value / contrast for value in (step, step_std, *faces))
    return StripeBorder(
        step, step_std, tone, tone_std, narrow, narrow_std, covered=covered, own_tone=own_tone
    )


def _tones(first_half: Array, second_half: Array, near: Array, beyond: Array) -> tuple[float, float, float]:
    """Return by what the halves of a stripe differ, its deviation, and what no shadow explains of it.

    Args:
        first_half: (N,) grey of the half towards the lane.
        second_half: (N,) grey of the other.
        near: (N,) grey of the asphalt beside the first half.
        beyond: (N,) grey of that beside the second half.
    """
    if len(near) < _LEAST_ROWS:
        return 0.0, 0.0, 0.0
    tone, std = _middle(first_half - second_half)
    first, second, by_first, by_second = map(upper_median, (first_half, second_half, near, beyond))
    light = max(by_first, 1.0) / max(by_second, 1.0)  # that is left on the first half by a shadow
    by_shadow = second * (light - 1.0) if light < 1.0 else first * (1.0 - 1.0 / light)
    # It may end anywhere in the stripe, and change less of a half than all of it.
    return tone, std, tone - float(np.clip(tone, min(by_shadow, 0.0), max(by_shadow, 0.0)))


def _grows(tones: tuple[float, float, float], contrast: float) -> bool:
    """Whether the paint is surely brighter towards the lane, and all of it by the light that grows there.

    The edge of a shadow does that, and leaves the strip beside the stripe darker than the lane. No face makes
    the paint brighter; but one may be hidden there.
    """
    tone, std, own_tone = tones
    return tone > max(LEFT_OF_EDGES * contrast, _SURELY_SIGMAS * std) and own_tone == 0.0


def _alike_along(values: Array) -> tuple[float, float, float]:
    """Return the median and its deviation; where the far and the near half differ, that of the smaller.

    A face runs along the whole stripe; an edge that is off where a stripe bends does not. Halves that differ
    in sign show nothing, unless by no more than their scatter explains: then they are one. The last value is
    by how much they contradict each other to either side of nothing: a face as great may be hidden there.
    """
    halves = [_middle(half) for half in np.array_split(values, 2)]
    (far, far_std), (near, near_std) = halves
    if abs(far - near) <= _SURELY_SIGMAS * float(np.hypot(far_std, near_std)):
        return *_middle(values), 0.0
    if far * near <= 0.0:
        return 0.0, max(far_std, near_std), abs(far - near) / 2.0
    return *min(halves, key=lambda half: abs(half[0])), 0.0


def _middle(values: Array) -> tuple[float, float]:
    """Return the median of the rows and its standard deviation, as if they were independent."""
    return upper_median(values), _scatter(values) / float(np.sqrt(len(values)))


def _hides_a_face(values: Array, contrast: float) -> bool:
    """Return whether so much else lies along the rows that their median does not show a face.

    Neighbouring rows see the same dapples, glare, or second line: where they differ less than the scatter
    says, they count for fewer, as those of a first order autoregression do (Box, Jenkins and Reinsel, Time
    Series Analysis, 1994, section 3.2).
    """
    scatter = _scatter(values)
    if scatter == 0.0:
        return False
    by_row = SIGMA_OVER_MAD * upper_median(np.abs(np.diff(values)))
    of_noise = float(np.clip(by_row**2 / (2.0 * scatter**2), 1.0 / len(values), 1.0))
    std = scatter * float(np.sqrt((2.0 - of_noise) / of_noise / len(values)))
    return of_noise < _LIKE_NOISE and std > _BLIND_STD * contrast


def _scatter(values: Array) -> float:
    return SIGMA_OVER_MAD * upper_median(np.abs(values - upper_median(values)))
