"""Fusion of the frames a calibrator has accepted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..camera.rig import StereoRig
from ..evidence.rig_unknowns import RIG_TERMS, response_of_surface, rig_terms
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, propagate_terms, total_covariance
from ..numerics.statistics import OUTLIER_SIGMAS, SIGMA_OVER_MAD
from ..reservations import Reservation, merge_reservations
from ..results import CalibrationResult, announce
from ..types import Array

# Fraction of a frame's variance that all frames of a drive share: their paint has the same ragged edges, and
# the edge template the same imperfections. On the rendered straight_road, the texture of the road surface is
# most of the noise. Without this term, ten fused frames there are 4 of their own standard deviations off in
# pitch. Real roads share more; the spread between frames does not show it.
_SHARED_VARIANCE = 0.1
_MIN_FOR_OUTLIERS = 4  # with three frames, one of them determines the median absolute deviation


class AcceptedFrame(Protocol):
    """The attributes of an accepted frame that the fusion uses.

    A :class:`.CalibrationResult` has them, and so has what is stored of one.
    """

    @property
    def stamp_s(self) -> float:
        """Time stamp [s]."""

    @property
    def extrinsics(self) -> Extrinsics | None:
        """The calibration."""

    @property
    def covariance(self) -> Array | None:
        """(3, 3) covariance of the calibration."""

    @property
    def lane_yaw_rad(self) -> float | None:
        """Yaw against the lane [rad]."""

    @property
    def lane_curvature_per_m(self) -> float | None:
        """Curvature of the lane [1/m]."""

    @property
    def stages(self) -> dict[str, Extrinsics]:
        """Estimate of every stage."""

    @property
    def uncertainty(self) -> tuple[UncertaintyTerm, ...]:
        """Terms of the covariance; empty where they are not known."""

    @property
    def reservations(self) -> tuple[Reservation, ...]:
        """What could not be checked, or is not quite as it should be."""

    @property
    def confirmed_by_texture(self) -> bool:
        """Whether the texture of the road surface has confirmed the lines."""


def fuse(estimates: Array, covariances: Array) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Combine estimates of one pose, weighted by their information.

    The covariance of the mean is enlarged by Birge's ratio (R. T. Birge, "The calculation of errors by
    the method of least squares", Phys. Rev. 40, 1932) where the estimates scatter more than
    their covariances predict.

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
        scale = np.maximum(SIGMA_OVER_MAD * np.median(deviation, axis=0), np.median(formal, axis=0))
        used = np.all(deviation <= OUTLIER_SIGMAS * scale, axis=1)
        if not used.any():  # each frame deviates in a different value, so that no outlier can be identified
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


def own_covariance(frame: AcceptedFrame) -> Array:
    """Return the covariance (3, 3) of a frame without the terms by the unknowns of the rig.

    These unknowns are the same in all frames. They do not make frames scatter, and do not average out.

    Args:
        frame: An accepted frame. Where its terms are not known, its covariance is taken as it is.

    Raises:
        ValueError: The frame has no covariance.
    """
    return total_covariance(_own_terms(frame))


def _own_terms(frame: AcceptedFrame) -> tuple[UncertaintyTerm, ...]:
    if frame.uncertainty:
        return tuple(term for term in frame.uncertainty if term.name not in RIG_TERMS)
    if frame.covariance is None:
        raise ValueError("only accepted frames have a covariance")
    return (UncertaintyTerm("noise", frame.covariance),)  # a frame from a file without terms


def _rig_terms(frame: AcceptedFrame, rig: StereoRig) -> tuple[UncertaintyTerm, ...]:
    """Return the terms of a frame by the unknowns of the rig."""
    if frame.uncertainty:
        return tuple(term for term in frame.uncertainty if term.name in RIG_TERMS)
    if frame.extrinsics is None or not frame.confirmed_by_texture:
        return ()
    # A frame from a file without terms: such files hold no unknowns of the rig.
    return rig_terms(response_of_surface(rig, frame.extrinsics))


def shared(covariances: Array) -> Array:
    """Return the covariance (3, 3) of the errors that all frames of a drive share, whatever their number."""
    common: Array = _SHARED_VARIANCE * covariances.mean(axis=0)
    return common


def fuse_frames(
    frames: Sequence[AcceptedFrame],
    rig: StereoRig,
    motion: Array | None = None,
    inflation: float = 1.0,
) -> CalibrationResult:
    """Fuse accepted frames of one pose of the mount.

    Frames are weighted, and their scatter is judged, without the unknowns of the rig, which they share.

    Args:
        frames: At least one frame, in the order of time.
        rig: The rig that the frames come from.
        motion: (3, 3) covariance of the car's motion, None where it is not known. With it, frames of little
            noise do not outweigh the others.
        inflation: Variance of the mean over its variance for independent frames.
    """
    if len(frames) == 1 and motion is None and isinstance(frames[0], CalibrationResult):
        return frames[0]
    poses = np.array([frame.extrinsics.as_array() for frame in frames if frame.extrinsics is not None])
    covariances = np.array([own_covariance(frame) for frame in frames])
    single = covariances if motion is None else covariances + motion
    mean, covariance, used = fuse(poses, single)
    good = [frame for frame, use in zip(frames, used, strict=True) if use]
    yaws = [frame.lane_yaw_rad for frame in good if frame.lane_yaw_rad is not None]
    bends = [frame.lane_curvature_per_m for frame in good if frame.lane_curvature_per_m is not None]
    pose = Extrinsics.from_array(mean)
    weights = _weights(single[used])
    terms = _terms_of_mean(good, weights, single[used], motion, covariance)
    terms.append(UncertaintyTerm("motion", (inflation - 1.0) * covariance))
    terms.append(UncertaintyTerm("shared", shared(covariances[used])))
    # The unknowns of the rig are the same in all frames: their terms are those of a mean frame.
    for frame, part in zip(good, np.trace(weights, axis1=1, axis2=2) / 3.0, strict=True):
        terms += [UncertaintyTerm(term.name, part * term.covariance) for term in _rig_terms(frame, rig)]
    confirmed = any(frame.confirmed_by_texture for frame in good)
    uncertainty = merge_terms(terms)
    fused = CalibrationResult(
        message="",
        extrinsics=pose,
        covariance=total_covariance(uncertainty),
        uncertainty=uncertainty,
        reservations=merge_reservations(frame.reservations for frame in good),
        confirmed_by_texture=confirmed,
        lane_yaw_rad=float(np.mean(yaws)) if yaws else None,
        lane_curvature_per_m=float(np.mean(bends)) if bends else None,
        stages={
            name: Extrinsics.from_array(np.mean([frame.stages[name].as_array() for frame in good], axis=0))
            for name in good[0].stages
            if all(name in frame.stages for frame in good)
        },
        stamp_s=frames[-1].stamp_s,
        n_frames=len(good),
    )
    return replace(fused, message=announce(fused, len(frames) - len(good)))


def _weights(covariances: Array) -> Array:
    """Return the matrices (N, 3, 3) by which frames are weighted; their sum is the unit matrix.

    Args:
        covariances: (N, 3, 3) covariances of the frames.
    """
    information = np.linalg.inv(covariances)
    weights: Array = np.linalg.inv(information.sum(axis=0)) @ information
    return weights


def _terms_of_mean(
    frames: Sequence[AcceptedFrame],
    weights: Array,
    covariances: Array,
    motion: Array | None,
    covariance: Array,
) -> list[UncertaintyTerm]:
    """Return the terms of the mean of frames, without those by the unknowns of the rig.

    Args:
        frames: The frames.
        weights: (N, 3, 3) their weights.
        covariances: (N, 3, 3) covariances that the weights are made from.
        motion: (3, 3) part of each of these covariances that the car's motion causes.
        covariance: (3, 3) covariance of the mean.
    """
    expected = np.linalg.inv(np.linalg.inv(covariances).sum(axis=0))
    terms: list[UncertaintyTerm] = []
    for frame, weight in zip(frames, weights, strict=True):
        terms += propagate_terms(_own_terms(frame), weight)
        if motion is not None:
            terms += propagate_terms((UncertaintyTerm("motion", motion),), weight)
    # The scatter of the frames beyond their covariances enlarges the covariance of the mean.
    terms.append(UncertaintyTerm("scatter", covariance - (expected + expected.T) / 2.0))
    return terms
