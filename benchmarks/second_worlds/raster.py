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

"""Which polygon each pixel sees, and how much of it; silhouettes have sixteen samples a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from stereo_selfcal import StereoRig

from .cameras import Array, Array32, Camera
from .mesh import Ints, Mesh

NEAR_M = 0.25  # nearer things are cut away
SKY = -1
_SLACK_PX = 1e-3  # neighbours overlap by so much, so that no ray falls between them
_REACH_PX = 0.72  # half the diagonal of a pixel, and a little
# Sixteen points of a pixel of which no two share a row or a column (Hammersley's sequence).
_COUNT = 16
_STEPS = (np.arange(_COUNT) + 0.5) / _COUNT - 0.5
_REVERSED = np.array([int(f"{i:04b}"[::-1], 2) for i in range(_COUNT)])
_DX = _STEPS.astype(np.float32)
_DY = _STEPS[_REVERSED].astype(np.float32)


@dataclass(frozen=True)
class Samples:
    """Points of the image at which light is computed.

    Attributes:
        pixel: Index of the pixel (row * width + column), shape (n,).
        polygon: Index of the polygon that is seen, SKY for none, shape (n,).
        col: Column after the camera's shift [px], shape (n,).
        row: Row after the camera's shift [px], shape (n,).
        weight: Share of the pixel, shape (n,).
    """

    pixel: Ints
    polygon: Ints
    col: Array32
    row: Array32
    weight: Array32


@dataclass(frozen=True)
class Planes:
    """Planes of all polygons before one camera.

    Attributes:
        inverse_depth: Coefficients of column, row and one that give 1 / depth, shape (n, 3).
        distance_m: Distance of the camera from each plane, shape (n,).
    """

    inverse_depth: Array
    distance_m: Array


def planes_before(mesh: Mesh, camera: Camera) -> Planes:
    """Return the planes of a mesh as a camera sees them."""
    rig = camera.rig
    normals = mesh.normals() @ camera.optical_from_world.T
    middle = (mesh.corners_m.mean(axis=1) - camera.centre_m) @ camera.optical_from_world.T
    distance = np.einsum("ij,ij->i", normals, middle)
    safe = np.where(np.abs(distance) < 1e-9, 1e-9, distance)
    n = normals / safe[:, None]
    a, b = n[:, 0] / rig.fx, n[:, 1] / rig.fy
    return Planes(np.stack([a, b, n[:, 2] - a * rig.cx - b * rig.cy], axis=1), np.abs(distance))


def rasterise(mesh: Mesh, camera: Camera, planes: Planes) -> Samples:
    """Return what each pixel of a camera sees."""
    height, width = camera.rig.height, camera.rig.width
    outlines = _outlines(mesh, camera)
    depth = np.zeros((height, width), np.float32)
    seen = np.full((height, width), SKY, np.int32)
    for index, outline in outlines.items():
        _draw(index, outline, camera, planes.inverse_depth[index], depth, seen)
    edge = _edges(mesh, outlines, seen, camera)
    inner = np.flatnonzero(~edge.ravel()).astype(np.int32)
    at, polygon, count, dx, dy = _divide(mesh, camera, planes, outlines, edge)
    pixel = np.concatenate([inner, at])
    row = pixel // width
    fine_x = np.concatenate([np.zeros(len(inner), np.float32), dx])
    fine_y = np.concatenate([np.zeros(len(inner), np.float32), dy])
    return Samples(
        pixel,
        np.concatenate([seen.ravel()[inner], polygon]),
        (pixel - row * width + fine_x + camera.col_shift_px[row]).astype(np.float32),
        (row + fine_y + camera.row_shift_px[row]).astype(np.float32),
        np.concatenate([np.ones(len(inner), np.float32), count]),
    )


@dataclass(frozen=True)
class _Outline:
    """A polygon in the image: its corners, and its sides as a x + b y + c >= 0 inside."""

    corners_px: Array
    sides: Array


def _outlines(mesh: Mesh, camera: Camera) -> dict[int, _Outline]:
    rig = camera.rig
    optical = (mesh.corners_m - camera.centre_m) @ camera.optical_from_world.T
    ahead = optical[..., 2] > NEAR_M
    whole = np.flatnonzero(ahead.all(axis=1))
    result = _seen(whole, optical[whole], rig)
    for index in np.flatnonzero(ahead.any(axis=1) & ~ahead.all(axis=1)):
        result |= _seen(np.array([index]), _cut(optical[index])[None], rig)
    return result


def _seen(index: npt.NDArray[np.intp], optical: Array, rig: StereoRig) -> dict[int, _Outline]:
    """Return the outlines of polygons before the camera of which something lies in the image."""
    pixels = optical[..., :2] / optical[..., 2:] * (rig.fx, rig.fy) + (rig.cx, rig.cy)
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    size = (rig.width, rig.height)
    chosen = np.flatnonzero(((high >= -1) & (low <= size)).all(axis=1))
    pixels = pixels[chosen]
    step = np.roll(pixels, -1, axis=1) - pixels
    length = np.hypot(step[..., 0], step[..., 1])
    real = length > 1e-9
    safe = np.where(real, length, 1.0)
    a, b = -step[..., 1] / safe, step[..., 0] / safe
    c = -(a * pixels[..., 0] + b * pixels[..., 1])
    centre = pixels.mean(axis=1)
    sign = np.sign((a * centre[:, 0:1] + b * centre[:, 1:2] + c).sum(axis=1, where=real))
    # A corner given twice has no side between: 0 x + 0 y + 1 >= 0 holds everywhere.
    sides = np.stack([a, b, c], axis=-1) * sign[:, None, None]
    sides = np.where(real[..., None], sides, [0.0, 0.0, 1.0])
    flat = (real.sum(axis=1) < 3) | (sign == 0)
    return {
        int(index[each]): _Outline(pixels[number], sides[number])
        for number, each in enumerate(chosen)
        if not flat[number]
    }


def _cut(corners: Array) -> Array:
    """Return the part of a polygon that lies before the camera."""
    following = np.roll(corners, -1, axis=0)
    kept: list[Array] = []
    for here, there in zip(corners, following, strict=True):
        if here[2] > NEAR_M:
            kept.append(here)
        if (here[2] > NEAR_M) != (there[2] > NEAR_M):
            share = (NEAR_M - here[2]) / (there[2] - here[2])
            kept.append(here + share * (there - here))
    return np.array(kept)


def _spans(outline: _Outline, camera: Camera, margin_px: float) -> tuple[int, int, Array, Array] | None:
    """Return first and last row of a polygon, and where it begins and ends in each, before the shift."""
    rows, shift = camera.row_shift_px, camera.col_shift_px
    low, high = outline.corners_px[:, 1].min() - margin_px, outline.corners_px[:, 1].max() + margin_px
    most = float(np.abs(rows).max())
    first = max(int(np.floor(low - most)), 0)
    last = min(int(np.ceil(high + most)), camera.rig.height - 1)
    if last < first:
        return None
    y = np.arange(first, last + 1) + rows[first : last + 1]
    a, b, c = outline.sides[:, 0:1], outline.sides[:, 1:2], outline.sides[:, 2:3]
    rest = b * y + c + margin_px + _SLACK_PX
    flat = np.abs(a) < 1e-9
    bound = -rest / np.where(flat, 1.0, a)
    begin = np.where((a > 0) & ~flat, bound, -np.inf).max(axis=0)
    end = np.where((a < 0) & ~flat, bound, np.inf).min(axis=0)
    end = np.where((flat & (rest < 0)).any(axis=0), -np.inf, end)
    return first, last, begin - shift[first : last + 1], end - shift[first : last + 1]


def _draw(index: int, outline: _Outline, camera: Camera, inverse: Array, depth: Array32, seen: Ints) -> None:
    spans = _spans(outline, camera, 0.0)
    if spans is None:
        return
    first, last, begin, end = spans
    some = begin <= end
    if not some.any():
        return
    left = max(int(np.floor(max(begin[some].min(), 0))), 0)
    right = min(int(np.ceil(min(end[some].max(), camera.rig.width))), camera.rig.width - 1)
    if right < left:
        return
    rows = slice(first, last + 1)
    col = np.arange(left, right + 1, dtype=np.float32)
    y = np.arange(first, last + 1) + camera.row_shift_px[rows]
    base = inverse[1] * y + inverse[2] + inverse[0] * camera.col_shift_px[rows]
    value = (inverse[0] * col).astype(np.float32) + base.astype(np.float32)[:, None]
    nearest = depth[rows, left : right + 1]
    inside = value > nearest
    inside &= col >= begin.astype(np.float32)[:, None]
    inside &= col <= end.astype(np.float32)[:, None]
    np.copyto(nearest, value, where=inside)
    np.copyto(seen[rows, left : right + 1], np.int32(index), where=inside)


def _edges(mesh: Mesh, outlines: dict[int, _Outline], seen: Ints, camera: Camera) -> npt.NDArray[np.bool_]:
    """Return the pixels that may see more than one surface."""
    groups = np.concatenate([mesh.group, np.array([-1], np.int32)])[seen]  # the sky is the last
    edge = np.zeros(seen.shape, np.uint8)
    down, right = groups[1:] != groups[:-1], groups[:, 1:] != groups[:, :-1]
    edge[1:] |= down
    edge[:-1] |= down
    edge[:, 1:] |= right
    edge[:, :-1] |= right
    thin = [index for index in outlines if mesh.thin[index]]
    if thin:
        mask = np.zeros_like(edge)
        for index in thin:
            points = np.clip(outlines[index].corners_px, -1e4, 1e4)
            cv2.polylines(mask, [np.round(points * 16).astype(np.int32)], True, 1, 1, cv2.LINE_8, 4)
        edge |= cv2.dilate(mask, np.ones((3, 3), np.uint8)).astype(np.uint8)
    edges: npt.NDArray[np.bool_] = edge > 0
    return edges


def _divide(
    mesh: Mesh, camera: Camera, planes: Planes, outlines: dict[int, _Outline], edge: npt.NDArray[np.bool_]
) -> tuple[Ints, Ints, Array32, Array32, Array32]:
    """Return the parts of the edge pixels: pixel, polygon, share, and the middle of the part in the pixel."""
    height, width = edge.shape
    at = np.flatnonzero(edge.ravel()).astype(np.int32)
    place = np.full(height * width, -1, np.int32)
    place[at] = np.arange(len(at), dtype=np.int32)
    place = place.reshape(height, width)
    row = at // width
    x = (at - row * width + camera.col_shift_px[row]).astype(np.float32)[:, None] + _DX
    y = (row + camera.row_shift_px[row]).astype(np.float32)[:, None] + _DY
    depth = np.zeros(x.shape, np.float32)
    seen = np.full(x.shape, SKY, np.int32)
    for index, outline in outlines.items():
        chosen = _near(outline, camera, place)
        if not len(chosen):
            continue
        u, v = x[chosen], y[chosen]
        a, b, c = planes.inverse_depth[index]
        value = np.float32(a) * u + np.float32(b) * v + np.float32(c)
        inside = value > depth[chosen]
        for p, q, r in outline.sides:
            inside &= np.float32(p) * u + np.float32(q) * v >= np.float32(-r - _SLACK_PX)
        depth[chosen] = np.where(inside, value, depth[chosen])
        seen[chosen] = np.where(inside, np.int32(index), seen[chosen])
    return _parts(mesh, at, seen)


def _near(outline: _Outline, camera: Camera, place: Ints) -> Ints:
    """Return the edge pixels that a polygon may touch."""
    nothing = np.zeros(0, np.int32)
    spans = _spans(outline, camera, _REACH_PX)
    if spans is None:
        return nothing
    first, last, begin, end = spans
    some = begin <= end
    if not some.any():
        return nothing
    left = max(int(np.floor(max(begin[some].min(), 0))), 0)
    right = min(int(np.ceil(min(end[some].max(), place.shape[1]))), place.shape[1] - 1)
    if right < left:
        return nothing
    part = place[first : last + 1, left : right + 1]
    rows, cols = np.nonzero(part >= 0)
    fits = (cols + left >= begin[rows]) & (cols + left <= end[rows])
    chosen: Ints = part[rows[fits], cols[fits]]
    return chosen


def _parts(mesh: Mesh, at: Ints, seen: Ints) -> tuple[Ints, Ints, Array32, Array32, Array32]:
    """Return the sixteen samples of each pixel, gathered by polygon."""
    order = np.argsort(seen, axis=1, kind="stable")
    ordered = np.take_along_axis(seen, order, axis=1)
    new = np.ones(ordered.shape, bool)
    new[:, 1:] = ordered[:, 1:] != ordered[:, :-1]
    starts = np.flatnonzero(new.ravel())
    if not len(starts):
        empty = np.zeros(0, np.float32)
        return at, at.copy(), empty, empty, empty
    sizes = np.diff(np.append(starts, ordered.size)).astype(np.float32)
    dx = (np.add.reduceat(_DX[order].ravel(), starts) / sizes).astype(np.float32)
    dy = (np.add.reduceat(_DY[order].ravel(), starts) / sizes).astype(np.float32)
    share = (sizes / _COUNT).astype(np.float32)
    return at[starts // _COUNT], ordered.ravel()[starts], share, dx, dy
