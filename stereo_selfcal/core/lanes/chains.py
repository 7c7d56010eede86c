"""Chains of stripe points from row to row, which tell stripes from foliage.

The direction of a point leads to another point two rows farther. Both are linked when the direction of the
other point leads back, and they are about as wide and as bright. Points of a painted line make long chains
with little scatter about a straight line; leaves, grass and noise make short ones. The direction of a chain
is much more accurate than that of the few pixels around a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import Array
from .stripe_points import StripePoints

# Wide filters mark points in every second row, so chains go from even row to even row.
ROW_STEP = 2
# A point is linked to one this close to where its direction leads [px]: half a pixel of error in either
# column, and a direction from 3 x 3 pixels that is off by 0.5 columns a row.
_REACH_PX = 2.0
# Largest ratio of the widths, and of the contrasts, of one stripe two rows apart. Widths are whole pixels,
# and the contrast of a thin stripe depends on where its edges lie within a pixel.
_MAX_RATIO = 1.6
# Points of one row closer than this [px] are one edge, found by two filters.
_SAME_PX = 2.0
_DOUBLINGS = 10  # chains of up to 2^10 points
# Directions are fitted to pieces of this many rows, over which a bend is nearly straight: a lane of 100 m
# radius bends by 0.1 px over 32 rows near the camera, by a pixel 20 m ahead.
_PIECE_ROWS = 32
# Largest scatter of a piece about its straight line [px]: a fifth of a pixel by noise, as much by ragged
# paint, and its bend.
_MAX_SCATTER_PX = 1.0
_SCATTER_FLOOR_PX = 0.3  # least scatter of a column, for the direction of short chains


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """The chain of each point.

    Attributes:
        length: (N,) rows that the chain of each point spans; 0 where it has none.
        slope: (N,) du/dv of the chain, or of the point alone.
        slope_std: (N,) its standard deviation.
    """

    length: Array
    slope: Array
    slope_std: Array


def chain_points(points: StripePoints, width: int) -> Chains:
    """Link stripe points from row to row.

    Args:
        points: Marked points of one image.
        width: Of the image [px].
    """
    n_all = len(points.rows)
    length, slope, slope_std = np.zeros(n_all), points.slopes.copy(), points.slope_std.copy()
    chosen = _strongest_of_each_edge(points, width)
    if len(chosen) < 2:
        return Chains(length, slope, slope_std)
    v, u = points.rows[chosen], points.columns[chosen]
    key = _sort_key(v, u, width)
    links = [_successors(points, chosen, key, width, step) for step in (-ROW_STEP, ROW_STEP)]
    own = np.arange(len(chosen))
    up, down = links
    mutual = (up >= 0) & (down[np.maximum(up, 0)] == own)
    piece = _chain_starts(np.where(mutual & (v % _PIECE_ROWS != 0), up, own))
    straight, slopes, spread = _fit_pieces(v, u, piece)
    whole = _chain_starts(np.where(mutual, up, own))
    spans = ROW_STEP * np.bincount(whole, straight[piece], len(v))[whole]
    # Points that other filters have marked at the same edge belong to the chain as well.
    nearest = _nearest(key, _sort_key(points.rows, points.columns, width))
    same = (v[nearest] == points.rows) & (np.abs(u[nearest] - points.columns) < _SAME_PX)
    owner = piece[nearest[same]]
    of_chain = np.where(straight[owner], spans[nearest[same]], 0.0)
    length[same], slope[same], slope_std[same] = of_chain, slopes[owner], spread[owner]
    return Chains(length, slope, slope_std)


def _chain_starts(up: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Return the first point of the chain of each point, given the predecessor of each."""
    for _ in range(_DOUBLINGS):
        up = up[up]
    return up


def _sort_key(v: Array, u: Array, width: int) -> Array:
    """Return one number that sorts points by row, then by column."""
    key: Array = v * (2.0 * width) + u
    return key


def _strongest_of_each_edge(points: StripePoints, width: int) -> npt.NDArray[np.intp]:
    """Return the points of even rows, sorted; of points that mark one edge, only the strongest."""
    even = np.nonzero(points.rows % ROW_STEP == 0)[0]
    order = even[np.argsort(_sort_key(points.rows[even], points.columns[even], width), kind="stable")]
    for _ in range(2):  # up to three filters may mark one edge
        v, u, contrast = points.rows[order], points.columns[order], points.contrast[order]
        close = (np.diff(v) == 0) & (np.diff(u) < _SAME_PX)
        weaker = np.zeros(len(order), dtype=bool)
        weaker[:-1] |= close & (contrast[:-1] < contrast[1:])
        weaker[1:] |= close & (contrast[1:] <= contrast[:-1])
        order = order[~weaker]
    return order


def _nearest(key: Array, wanted: Array) -> npt.NDArray[np.intp]:
    """Return the indices of the values in a sorted array that are nearest to the wanted values."""
    after = np.clip(np.searchsorted(key, wanted), 1, len(key) - 1)
    return np.where(wanted - key[after - 1] <= key[after] - wanted, after - 1, after)


def _successors(
    points: StripePoints, chosen: npt.NDArray[np.intp], key: Array, width: int, step: int
) -> npt.NDArray[np.intp]:
    """Return the point to which each one leads, ``step`` rows farther down, -1 where there is none."""
    v, u = points.rows[chosen], points.columns[chosen]
    expected = u + step * np.clip(points.slopes[chosen], -6.0, 6.0)
    found = _nearest(key, _sort_key(v + step, expected, width))
    good = (v[found] == v + step) & (np.abs(u[found] - expected) <= _REACH_PX)
    for values in (points.widths[chosen], points.contrast[chosen]):
        good &= np.maximum(values, values[found]) <= _MAX_RATIO * np.minimum(values, values[found]) + 1.0
    return np.where(good, found, -1)


def _fit_pieces(v: Array, u: Array, root: npt.NDArray[np.intp]) -> tuple[npt.NDArray[np.bool_], Array, Array]:
    """Return by first point of each piece: is it straight, its slope, the slope's standard deviation."""
    n = len(v)
    count = np.bincount(root, minlength=n).astype(np.float64)
    full = np.maximum(count, 1.0)
    mean_v, mean_u = (np.bincount(root, x, n) / full for x in (v, u))
    dv, du = v - mean_v[root], u - mean_u[root]
    vv, uv, uu = (np.bincount(root, x, n) for x in (dv * dv, dv * du, du * du))
    vv = np.maximum(vv, ROW_STEP**2 / 2.0)  # the sum for two points
    slope = uv / vv
    scatter = np.sqrt(np.maximum(uu - slope * uv, 0.0) / full)
    straight = (count > 1) & (scatter <= _MAX_SCATTER_PX)
    spread = np.maximum(scatter, _SCATTER_FLOOR_PX) / np.sqrt(vv)
    return straight, slope, spread
