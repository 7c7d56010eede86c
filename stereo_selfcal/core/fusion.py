"""Fusion of the frames a calibrator has accepted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .extrinsics import Array

# Frames farther from the median than this many robust standard deviations are left out.
_OUTLIER_SIGMAS = 4.0
_SIGMA_OVER_MAD = 1.4826
# Part of a frame's variance that the next frame repeats: the edges of the paint are as ragged, and the
# template of an edge as imperfect, in all frames of a drive. On the rendered straight_road, where asphalt
# texture is most of the noise, ten frames together are 4 of their own standard deviations off in
# pitch without it. Real roads repeat more; the spread between frames does not show that.
_SHARED_VARIANCE = 0.1
_MIN_FOR_OUTLIERS = 4  # with three, the median absolute deviation is decided by one frame


def fuse(estimates: Array, covariances: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Combine estimates of one pose, weighted by their information.

    The covariance of the mean is enlarged by Birge's ratio (R. T. Birge, "The calculation of errors by
    the method of least squares", Phys. Rev. 40, 1932) where the estimates scatter more than
    their covariances promise.

    Args:
        estimates: (N, 3) height_m, pitch_rad, roll_rad.
        covariances: (N, 3, 3).

    Returns:
        The mean (3,), its covariance (3, 3), and which frames were used (N,).
    """
    n = len(estimates)
    used = np.ones(n, dtype=bool)
    if n >= _MIN_FOR_OUTLIERS:
        deviation = np.abs(estimates - np.median(estimates, axis=0))
        formal = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        scale = np.maximum(_SIGMA_OVER_MAD * np.median(deviation, axis=0), np.median(formal, axis=0))
        used = np.all(deviation <= _OUTLIER_SIGMAS * scale, axis=1)
        if not used.any():  # each frame is off in another value: none can be told from the rest
            used[:] = True
    information = np.linalg.inv(covariances[used])
    covariance = np.linalg.inv(information.sum(axis=0))
    mean = covariance @ np.einsum("nij,nj->i", information, estimates[used])
    residual = estimates[used] - mean
    freedom = 3 * (np.count_nonzero(used) - 1)
    if freedom > 0:
        chi2 = float(np.einsum("ni,nij,nj->", residual, information, residual))
        covariance = covariance * max(1.0, chi2 / freedom)
    return mean, (covariance + covariance.T) / 2.0, used


def shared(covariances: Array) -> Array:
    """Return the covariance (3, 3) that frames of one drive have in common, however many there are."""
    common: Array = _SHARED_VARIANCE * covariances.mean(axis=0)
    return common
