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

"""A coarse plane of the road from dense disparities at low resolution, without any prior pose.

Both images are made small and matched densely (semi-global matching: Hirschmueller, PAMI 2008; OpenCV's
SGBM). Planes through three points are tried, as far as they may be a road below the rig, and the one that
most of the road ahead agrees with is fitted (MSAC: Torr and Zisserman, 2000). It is good to a part of a pixel
of the small images: enough for a search for lines, as a start of the alignment of the texture, and to exclude
lines that are far above it or below it. It is no estimate of its own: semi-global matching prefers whole
pixels and surfaces that face the camera, which draws the pitch.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.rig import StereoRig
from ..config import SearchConfig
from ..geometry.plane import (
    DisparityPlane,
    PlaneCamera,
    jacobian_pose_wrt_plane,
    plane_from_pose,
    pose_from_plane,
)
from ..geometry.pose import Extrinsics
from ..geometry.rays import pixel_rays
from ..numerics.robust import tukey_weights
from ..rejection import Bound, NotFitted
from ..types import Array, Floats, Image, Mask
from .dense_disparity import DenseDisparities, SmallImages, in_images

_LEAST_DISPARITIES, _STEP_DISPARITIES = 32, 16  # SGBM's number is a multiple of 16
_MOST_OF_WIDTH = 1 / 3  # disparities searched, over the width: beyond, too little of the right image is left

# The road ahead that counts: to either side as the alignment of the texture samples it, and up to its end.
_HALF_WIDTH_M, _FAR_M = 2.5, 30.0
_LEAST_DISPARITY_PX = 2.0  # of the small images: beyond, a plane is not told from what stands on it
_HORIZON = 0.4  # part of the image's height above which no road is looked for
# Nearly all cars carry their cameras as high as this. So many disparities are matched first, and all of the
# search range only where they show no road within them, or where most of it may hide nearer things: what is
# nearer has no disparity among these.
USUAL_HEIGHT_M = 1.0
_MOSTLY = 0.5  # of the road in view
# All planes are tried with a few points, and the best ones of them with more.
_N_TRIPLES, _N_POINTS = 300, 500
_N_BEST, _N_POINTS_OF_BEST = 40, 2500
_PLANES_AT_ONCE = 64
_NEAR_FACTOR = 2.0  # of the disparities of a plane, by which the fit surely does not change them
# Errors of semi-global matching [px of the small images]: it is good to half a pixel on slanted surfaces, and
# a smooth error of a fifth of a pixel remains in a plane (pixel locking: Shimizu and Okutomi, 2005).
_AGREES_PX, _BIAS_PX = 0.5, 0.2
_BELOW_PX = 2.0  # surely below a plane
# Half of what both images show is common to them. Chance correlates so many pixels with a standard deviation
# of 0.11. Nine tenths of recorded roads correlate by more, a fifth of rendered ones without texture.
_LEAST_CORRELATION, _NEIGHBOURHOOD = 0.5, (9, 9)
_ROUNDING_VARIANCE = 1.0 / 12.0  # of whole grey levels
_ROUNDS = 6
_MOST_FITTED = 6000  # points: neighbours share their errors, so that more tell no more
_REACH_PX = 1.5  # limit of Tukey's weights
_LEAST_POINTS = 100
_POINTS = "points of the disparity image that may lie on a road"

LEAST_SHARE = 0.5  # of the road in view that has to agree with a plane that excludes lines


@dataclass(frozen=True, slots=True, eq=False)
class CoarseRoad:
    """A coarse plane of the road.

    Attributes:
        extrinsics: Pose over it.
        covariance: (3, 3) of the pose, by what semi-global matching leaves in a plane.
        share: Part of the road in view, up to 30 m ahead, that agrees with the plane, 0 ... 1.
        matched_share: Part of it that has a disparity.
        scale: Pixels of the images for one pixel of the small images.
    """

    extrinsics: Extrinsics
    covariance: Array
    share: float
    matched_share: float
    scale: int

    @property
    def clear(self) -> bool:
        """Whether enough of the road agrees with the plane for it to contradict other estimates."""
        return self.share >= LEAST_SHARE

    @property
    def mostly_matched(self) -> bool:
        """Whether most of the road in view has a disparity: nothing that is too near is in front of it."""
        return self.matched_share >= _MOSTLY


def find_coarse_road(
    images: tuple[Image, Image], rig: StereoRig, search: SearchConfig, seed: int
) -> tuple[CoarseRoad | NotFitted, DenseDisparities]:
    """Find the plane of the road in dense disparities.

    Args:
        images: Left and right image, (H, W) uint8.
        rig: Intrinsics and baseline.
        search: Poses of a road below the rig.
        seed: Seed of the planes that are tried.

    Returns:
        The plane, or the reason why there is none; and the disparities.
    """
    small = SmallImages.of(images)
    usual, every = (
        n_disparities(rig, least_m, small.scale) for least_m in (USUAL_HEIGHT_M, search.height_min_m)
    )
    if usual < every:
        disparities = small.match(usual)
        found = _find(disparities, small, rig, search, seed)
        if not isinstance(found, NotFitted) and found.mostly_matched and _reaches(found, rig, usual):
            return found, disparities
    disparities = small.match(every)
    return _find(disparities, small, rig, search, seed), disparities


def _find(
    disparities: DenseDisparities, small: SmallImages, rig: StereoRig, search: SearchConfig, seed: int
) -> CoarseRoad | NotFitted:
    """Find the plane of the road in disparities."""
    disparity, scale = disparities.values, disparities.scale
    u, v = (in_images(np.arange(length), scale) for length in disparity.shape[::-1])
    first = int(np.count_nonzero(v <= _HORIZON * rig.height))
    lower = disparity[first:].ravel()
    known = np.flatnonzero(lower > 0.0)
    row, column = np.divmod(known, len(u))
    rays, measured = (
        pixel_rays(rig, u.take(column), v[first:].take(row)),
        lower.take(known).astype(np.float64) * scale,
    )
    if len(measured) < _LEAST_POINTS:
        return NotFitted(_POINTS, len(measured), Bound.LEAST, _LEAST_POINTS)
    start = _most_agreed(rays, measured, rig, search, scale, np.random.default_rng(seed))
    if isinstance(start, NotFitted):
        return start
    plane = _fit(rays, measured, start, rig, scale)
    if isinstance(plane, NotFitted):
        return plane
    pose = pose_from_plane(plane, rig)
    lower_end, upper_end = (np.array(bound) for bound in search.bounds())
    if not np.all((lower_end < pose.as_array()) & (pose.as_array() < upper_end)):
        return NotFitted("planes of a road within the search range", 0, Bound.LEAST, 1)
    # A smooth error of the disparities: a constant, one that grows with the column and one with the row.
    reach = np.array([1.0, rig.width / (2.0 * rig.fx), rig.height / (2.0 * rig.fy)])
    spread = jacobian_pose_wrt_plane(plane, rig) * (_BIAS_PX * scale / reach)
    share, matched = _shares(disparity, small, plane, rig)
    return CoarseRoad(pose, spread @ spread.T, share, matched, scale)


def n_disparities(rig: StereoRig, height_m: float, scale: int) -> int:
    """Return how many disparities of the small images a road this far below the rig has."""
    width, height = rig.width // scale, rig.height // scale
    # The nearest road is seen in the last row.
    nearest = rig.baseline_m / height_m * (1.0 - _HORIZON) * height * rig.fx / rig.fy
    most = min(nearest, _MOST_OF_WIDTH * width)
    return _STEP_DISPARITIES * max(_LEAST_DISPARITIES // _STEP_DISPARITIES, round(most / _STEP_DISPARITIES))


def _reaches(found: CoarseRoad, rig: StereoRig, number: int) -> bool:
    """Whether so many disparities are enough for all of the road in view."""
    plane = plane_from_pose(found.extrinsics, rig, PlaneCamera.LEFT)
    corners = pixel_rays(rig, np.array([0.0, rig.width - 1.0]), rig.height - 1.0)
    return bool(plane.disparities(corners).max() + _BELOW_PX * found.scale < number * found.scale)


def _most_agreed(
    rays: Array, measured: Array, rig: StereoRig, search: SearchConfig, scale: int, rng: np.random.Generator
) -> Array | NotFitted:
    """Return the plane (3,) through three points that the road ahead agrees with most.

    Points that lie surely below a plane count against it: nothing is seen below a road.
    """
    chosen = rng.integers(len(rays), size=(_N_TRIPLES, 3))
    determinants = np.abs(np.linalg.det(rays[chosen]))
    chosen = chosen[determinants > np.finfo(np.float32).eps]
    planes = np.linalg.solve(rays[chosen], measured[chosen][..., None])[..., 0]
    length = np.linalg.norm(planes, axis=1)
    poses = np.column_stack(
        [
            rig.fx * rig.baseline_m / length,
            np.arcsin(np.clip(planes[:, 0] / length, -1.0, 1.0)),
            np.arctan2(-planes[:, 1], -planes[:, 2]),
        ]
    )
    lower, upper = (np.array(bound) for bound in search.bounds())
    planes = planes[np.all((lower < poses) & (poses < upper), axis=1)]
    if not len(planes):
        return NotFitted("planes of a road within the search range", 0, Bound.LEAST, 1)
    some = rng.permutation(len(rays))[:_N_POINTS_OF_BEST]
    rays, measured = rays[some], measured[some]
    votes = _votes(planes, rays[:_N_POINTS], measured[:_N_POINTS], rig, scale)
    planes = planes[np.argsort(-votes, kind="stable")[:_N_BEST]]
    best: Array = planes[int(np.argmax(_votes(planes, rays, measured, rig, scale)))]
    return best


def _votes(planes: Array, rays: Array, measured: Array, rig: StereoRig, scale: int) -> Floats:
    """Return how many of some points (N,) agree with each plane (P, 3), less those surely below it."""
    # In single precision, which is good to a thousandth of a pixel, and a few planes at a time, whose numbers
    # fit the processor's cache.
    points = rays.T.astype(np.float32)
    tangents = _tangents(points[1], rig)
    disparities, reach = measured.astype(np.float32), np.float32(2.0 * _AGREES_PX * scale)
    votes = np.empty(len(planes), np.float32)
    for first in range(0, len(planes), _PLANES_AT_ONCE):
        which = slice(first, first + _PLANES_AT_ONCE)
        predicted = planes[which].astype(np.float32) @ points
        ahead = _is_ahead(predicted, tangents, rig, scale)
        off = np.subtract(disparities, predicted, out=predicted)
        below = off < np.float32(-_BELOW_PX * scale)
        off /= reach
        off *= off
        agrees = np.maximum(np.subtract(np.float32(1.0), off, out=off), np.float32(0.0), out=off)
        agrees -= below
        agrees *= ahead
        votes[which] = agrees.sum(axis=1)
    return votes


def _tangents(aside: Array, rig: StereoRig) -> Array:
    """Return the disparities [px] up to which points are farther aside than the road ahead is wide.

    Args:
        aside: Tangents of the angle to the left of the optical axis.
        rig: Intrinsics and baseline.
    """
    # At a disparity d, a metre is d / baseline pixels wide.
    tangents: Array = np.abs(aside) * aside.dtype.type(rig.fx * rig.baseline_m / _HALF_WIDTH_M)
    return tangents


def _is_ahead(predicted: Array, tangents: Array, rig: StereoRig, scale: int) -> Mask:
    """Whether points lie on the road ahead, where a plane predicts their disparity [px].

    Args:
        predicted: Disparities by the plane.
        tangents: Those up to which the points are too far aside, of a shape that broadcasts.
        rig: Intrinsics and baseline.
        scale: Pixels of the images for one of the small images.
    """
    least = max(_LEAST_DISPARITY_PX * scale, rig.fx * rig.baseline_m / _FAR_M)
    inside: Mask = predicted > least
    inside &= tangents < predicted
    return inside


def _fit(
    rays: Array, measured: Array, start: Array, rig: StereoRig, scale: int
) -> DisparityPlane | NotFitted:
    """Fit a plane to the road ahead, from one that is good to a pixel of the small images."""
    plane: Array = start
    # The fit moves the plane by parts of its disparities: what is far from the road ahead never counts.
    tangents, predicted = _tangents(rays[:, 1], rig), rays @ plane
    near = np.flatnonzero(_is_ahead(_NEAR_FACTOR * predicted, tangents, rig, scale))
    near = near[:: -(-len(near) // _MOST_FITTED) or 1]
    rays, measured, tangents = rays[near], measured[near], tangents[near]
    columns = np.ascontiguousarray(rays.T)
    for _ in range(_ROUNDS):
        predicted = rays @ plane
        off = measured - predicted
        weights = tukey_weights((off * (1.0 / (_REACH_PX * scale))) ** 2)
        weights *= _is_ahead(predicted, tangents, rig, scale)
        counted = int(np.count_nonzero(weights))
        if counted < _LEAST_POINTS:
            return NotFitted(_POINTS, counted, Bound.LEAST, _LEAST_POINTS)
        weighted = columns * weights
        plane = plane + np.linalg.lstsq(weighted @ rays, weighted @ off, rcond=None)[0]
    return DisparityPlane(plane, PlaneCamera.LEFT)


def _shares(
    disparity: Floats, small: SmallImages, plane: DisparityPlane, rig: StereoRig
) -> tuple[float, float]:
    """Return which parts of the road in view agree with a plane, and have a disparity at all.

    Where a road is bare, semi-global matching fills it by what is around it. So only what both images show
    under the plane agrees with it.
    """
    height, width = disparity.shape
    scale = small.scale
    u, v = in_images(np.arange(width), scale), in_images(np.arange(height), scale)[:, None]
    rays = pixel_rays(rig, u, v)
    predicted = plane.disparities(rays)
    # What only the left camera sees does not count.
    road = _is_ahead(predicted, _tangents(rays[..., 1], rig), rig, scale) & (u > predicted)
    n_road = max(int(np.count_nonzero(road)), 1)
    matched = road & (disparity > 0.0)
    agrees = matched & (np.abs(disparity * np.float32(scale) - predicted) < _AGREES_PX * scale)
    agrees &= _correlation(small.images, predicted / scale) > _LEAST_CORRELATION
    return np.count_nonzero(agrees) / n_road, np.count_nonzero(matched) / n_road


def _correlation(images: tuple[Image, Image], disparity: Array) -> Floats:
    """Return the correlation (h, w) of both images under disparities (h, w), each over its neighbourhood."""
    height, width = disparity.shape
    columns = np.arange(width, dtype=np.float32) - disparity.astype(np.float32)
    rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    left = images[0].astype(np.float32)
    right = cv2.remap(images[1], columns, rows, cv2.INTER_LINEAR).astype(np.float32)

    def mean(values: Floats) -> Floats:
        return np.asarray(cv2.blur(values, _NEIGHBOURHOOD), np.float32)

    of_left, of_right = mean(left), mean(right)
    both = mean(left * right) - of_left * of_right
    squares = (mean(left * left) - of_left**2) * (mean(right * right) - of_right**2)
    return np.asarray(both / np.sqrt(np.maximum(squares, _ROUNDING_VARIANCE**2)), np.float32)
