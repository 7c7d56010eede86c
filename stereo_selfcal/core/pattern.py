"""The calibration pattern: two lane lines seen by both cameras, sampled row by row."""

from __future__ import annotations

from dataclasses import dataclass

from .extrinsics import Array
from .rig import StereoRig


@dataclass(frozen=True, slots=True, eq=False)
class ImageLine:
    """A straight line in one image: ``u(v) = u_mid + slope * (v - v_mid)``.

    It is the left edge (the positive gradient) of a painted stripe.

    Attributes:
        u_mid: Column at row ``v_mid`` [px].
        slope: du/dv.
        v_mid: Row about which ``u_mid`` and ``slope`` are least correlated [px].
        covariance: (2, 2) covariance of (u_mid, slope).
        rows: (N,) rows [px] of the measured points.
        columns: (N,) sub-pixel columns [px] of the measured points.
        weights: (N,) relative weights of the measured points in the fit.
        n_rows: Number of image rows behind the measured points.
        width_px: Median width of the stripe along the rows [px].
        contrast: Median contrast of its weaker edge [grey levels].
    """

    u_mid: float
    slope: float
    v_mid: float
    covariance: Array
    rows: Array
    columns: Array
    weights: Array
    n_rows: int
    width_px: float
    contrast: float

    def column_at(self, v: Array) -> Array:
        """Return the column [px] at rows ``v`` [px], the same shape."""
        return self.u_mid + self.slope * (v - self.v_mid)


@dataclass(frozen=True, slots=True, eq=False)
class LanePattern:
    """The two lane lines of both cameras, matched and sampled (paper section 2.2, figure 3b).

    Attributes:
        left: The lines of the left camera: left lane boundary, right lane boundary.
        right: The same two lines seen by the right camera.
        vanishing_point: (2,) column and row where the lines meet [px].
        rows: (N,) sampled image rows [px].
        columns: (2, 2, N) columns [px] of camera (left, right), line (left, right), row.
    """

    left: tuple[ImageLine, ImageLine]
    right: tuple[ImageLine, ImageLine]
    vanishing_point: Array
    rows: Array
    columns: Array


def row_towards(vanishing_point: Array, fraction: float, rig: StereoRig) -> float:
    """Return the row [px], not above the image, at a fraction of the vanishing point's height."""
    bottom = rig.height - 1.0
    return max(0.0, bottom - fraction * (bottom - float(vanishing_point[1])))
