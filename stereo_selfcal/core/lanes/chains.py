"""Chains of stripe points from row to row: what a stripe has and foliage has not.

A point is linked to the one it leads to in the next row that is looked at, when that one leads back to it and
is about as wide and as bright. Points of a painted line make long chains with little scatter about a straight
line; leaves, grass and noise make short ones. A chain also knows its direction much better than the
few pixels around a point do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import Array
from .stripe_points import StripePoints

# Wide filters see every second row, so chains go from even row to even row.
ROW_STEP = 2
# A point leads to one this close to where its edge points [px]: half a pixel of error in either column, and a
# direction from 3 x 3 pixels that is off by 0.5 columns a row.
_REACH_PX = 2.0
# The same stripe two rows further on: widths are whole pixels, contrasts of thin stripes depend on the place
# of their edges within a pixel.
_MAX_RATIO = 1.6
# Points of one row closer than this are one edge, found by two filters.
_SAME_PX = 2.0
_DOUBLINGS = 10  # chains of up to 2^10 points
# Directions are those of pieces of this many rows, over which a bend is straight: a lane of 100 m radius
# bends by 0.1 px over 32 rows near the camera, by a pixel 20 m ahead.
_PIECE_ROWS = 32
# Scatter of an edge about a straight line [px] that a piece may have: a fifth of a pixel by noise, as much
# by ragged paint, and its bend.
_MAX_SCATTER_PX = 1.0
_SCATTER_FLOOR_PX = 0.3  # of a column, for the direction of short chains


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """The chain of each point.

    Attributes:
        length: (N,) rows the chain of each point spans; 0 where it has none.
        slope: (N,) du/dv of the chain.
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
    chosen = _one_of_each_edge(points, width)
    if len(chosen) < 2:
        return Chains(length, slope, slope_std)
    v, u = points.rows[chosen], points.columns[chosen]
    key = _key(v, u, width)
    links = [_lead(points, chosen, key, width, step) for step in (-ROW_STEP, ROW_STEP)]
    own = np.arange(len(chosen))
    up, down = links
    mutual = (up >= 0) & (down[np.maximum(up, 0)] == own)
    piece = _first(np.where(mutual & (v % _PIECE_ROWS != 0), up, own))
    straight, slopes, spread = _describe(v, u, piece)
    whole = _first(np.where(mutual, up, own))
    spans = ROW_STEP * np.bincount(whole, straight[piece], len(v))[whole]
    # What the other filters marked at the same edge belongs to the chain as well.
    nearest = _nearest(key, _key(points.rows, points.columns, width))
    same = (v[nearest] == points.rows) & (np.abs(u[nearest] - points.columns) < _SAME_PX)
    owner = piece[nearest[same]]
    of_chain = np.where(straight[owner], spans[nearest[same]], 0.0)
    length[same], slope[same], slope_std[same] = of_chain, slopes[owner], spread[owner]
    return Chains(length, slope, slope_std)


def _first(up: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Return the first point of the chain of each point, given the one before each."""
    for _ in range(_DOUBLINGS):
        up = up[up]
    return up


def _key(v: Array, u: Array, width: int) -> Array:
    """Return one number that sorts points by row, then by column."""
    key: Array = v * (2.0 * width) + u
    return key


def _one_of_each_edge(points: StripePoints, width: int) -> npt.NDArray[np.intp]:
    """Return the points of even rows, sorted, the strongest one of those that mark one edge."""
    even = np.nonzero(points.rows % ROW_STEP == 0)[0]
    order = even[np.argsort(_key(points.rows[even], points.columns[even], width), kind="stable")]
    for _ in range(2):  # three filters may see one edge
        v, u, contrast = points.rows[order], points.columns[order], points.contrast[order]
        close = (np.diff(v) == 0) & (np.diff(u) < _SAME_PX)
        weaker = np.zeros(len(order), dtype=bool)
        weaker[:-1] |= close & (contrast[:-1] < contrast[1:])
        weaker[1:] |= close & (contrast[1:] <= contrast[:-1])
        order = order[~weaker]
    return order


def _nearest(key: Array, wanted: Array) -> npt.NDArray[np.intp]:
    """Return the places in a sorted array that are nearest to the wanted values."""
    after = np.clip(np.searchsorted(key, wanted), 1, len(key) - 1)
    return np.where(wanted - key[after - 1] <= key[after] - wanted, after - 1, after)


def _lead(
    points: StripePoints, chosen: npt.NDArray[np.intp], key: Array, width: int, step: int
) -> npt.NDArray[np.intp]:
    """Return the point each one leads to, ``step`` rows further down, -1 where there is none."""
    v, u = points.rows[chosen], points.columns[chosen]
    expected = u + step * np.clip(points.slopes[chosen], -6.0, 6.0)
    found = _nearest(key, _key(v + step, expected, width))
    good = (v[found] == v + step) & (np.abs(u[found] - expected) <= _REACH_PX)
    for values in (points.widths[chosen], points.contrast[chosen]):
        good &= np.maximum(values, values[found]) <= _MAX_RATIO * np.minimum(values, values[found]) + 1.0
    return np.where(good, found, -1)


def _describe(v: Array, u: Array, root: npt.NDArray[np.intp]) -> tuple[npt.NDArray[np.bool_], Array, Array]:
    """Return whether a piece is straight, its slope and the slope's standard deviation, by root."""
    n = len(v)
    count = np.bincount(root, minlength=n).astype(np.float64)
    full = np.maximum(count, 1.0)
    mean_v, mean_u = (np.bincount(root, x, n) / full for x in (v, u))
    dv, du = v - mean_v[root], u - mean_u[root]
    vv, uv, uu = (np.bincount(root, x, n) for x in (dv * dv, dv * du, du * du))
    vv = np.maximum(vv, ROW_STEP**2 / 2.0)  # of two points
    slope = uv / vv
    scatter = np.sqrt(np.maximum(uu - slope * uv, 0.0) / full)
    straight = (count > 1) & (scatter <= _MAX_SCATTER_PX)
    spread = np.maximum(scatter, _SCATTER_FLOOR_PX) / np.sqrt(vv)
    return straight, slope, spread
