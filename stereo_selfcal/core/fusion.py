"""Fusion of the frames a calibrator has accepted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from .combination import covariance_by_rectification
from .extrinsics import Array, Extrinsics
from .results import CalibrationResult, announce
from .rig import StereoRig

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


def fuse_results(
    accepted: Sequence[CalibrationResult],
    rig: StereoRig,
    motion: Array | None = None,
    inflation: float = 1.0,
) -> CalibrationResult:
    """Combine accepted frames of one pose into one result.

    Args:
        accepted: The frames, at least one.
        rig: The rig all come from.
        motion: (3,) variances of what the pose does from frame to frame, None where the frames are of one
            moment.
        inflation: By how much the variance of the mean is greater than if frames were independent.
    """
    poses = np.array([r.extrinsics.as_array() for r in accepted if r.extrinsics is not None])
    covariances = np.array([r.covariance for r in accepted])
    moving = covariances if motion is None else covariances + np.diag(motion)
    mean, covariance, used = fuse(poses, moving)
    frames = [r for r, use in zip(accepted, used, strict=True) if use]
    yaws = [r.lane_yaw_rad for r in frames if r.lane_yaw_rad is not None]
    bends = [r.lane_curvature_per_m for r in frames if r.lane_curvature_per_m is not None]
    pose, covariance = Extrinsics.from_array(mean), inflation * covariance + shared(covariances[used])
    if any("textured" in r.stages for r in frames):
        # What the calibration of the cameras has left is the same in all frames.
        covariance = covariance + covariance_by_rectification(rig, pose)
    fused = CalibrationResult(
        message="",
        extrinsics=pose,
        covariance=covariance,
        lane_yaw_rad=float(np.mean(yaws)) if yaws else None,
        lane_curvature_per_m=float(np.mean(bends)) if bends else None,
        stages={
            name: Extrinsics.from_array(np.mean([r.stages[name].as_array() for r in frames], axis=0))
            for name in frames[0].stages
            if all(name in r.stages for r in frames)
        },
        stamp_s=accepted[-1].stamp_s,
        n_frames=len(frames),
    )
    return replace(fused, message=announce(fused, len(accepted) - len(frames)))
