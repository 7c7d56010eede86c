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

"""The mean of the frames that a calibrator has accepted: an estimate of the mount, not of a moment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from ..camera.rig import StereoRig
from ..evidence.rig_unknowns import RIG_TERMS, response_of_surface, rig_terms
from ..geometry.mount import MountEvidence
from ..geometry.pose import Extrinsics
from ..geometry.uncertainty import UncertaintyTerm, merge_terms, total_covariance
from ..numerics.gauss_markov import variance_of_mean
from ..reservations import Reservation, merge_reservations
from ..results import CalibrationResult, announce
from ..road.priors import LEAN_STD_RAD
from ..types import Array, Mask
from .frame_series import FrameSeries
from .motion import CarMotion, weights_of_mean, without_outliers

# Terms that are new in every frame, because its pixels are.
_OF_PIXELS = frozenset({"noise"})
# Terms that are new with every piece of road, and the same in all frames of one stop.
_OF_TEXTURE = frozenset({"misfit", "mismatch"})
# Terms that are the same in all frames that were followed from one cold frame.
_OF_COLD = frozenset({"turn_before"})
# Terms whose cause is the same in all frames of a drive. The right images are late by one time.
_OF_CAMERAS = RIG_TERMS | {"synchronisation"}
# All others are by the shape of the road. Its cross-section and the lines on it stay the same for minutes.
# Its profile is another one after some ten metres, which take seconds. What is of both, or of neither, lasts
# by half.
_OF_CROSS_SECTION = frozenset({"camber", "crown", "kerb", "paint_angle"})
_OF_PROFILE = frozenset({"roughness", "slope_seen", "slope_unseen"})
_PROFILE_MEMORY_S = 3.0
# So many frames do not check each other: one of them decides what is usual.
_FEW_FRAMES = 3
# A frame that starts from the frame before looks at the same lines and cells again: half of the variance of
# its own is that of the frame before.
_SAME_LOOK_PART = 0.5


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

    @property
    def known_start(self) -> bool:
        """Whether the frame started from the known camera."""

    @property
    def stood(self) -> bool:
        """Whether the car stood since the frame before."""


def own_covariance(frame: AcceptedFrame) -> Array:
    """Return the covariance (3, 3) of a frame, or of a mean, without the terms by the cameras.

    Their causes are the same in all frames. They do not make frames scatter, and do not average out.

    Args:
        frame: An accepted frame. Where its terms are not known, its covariance is taken as it is.

    Raises:
        ValueError: The frame has no covariance.
    """
    return total_covariance(each for each in _terms(frame) if each.name not in _OF_CAMERAS)


def scatter_variances(frame: AcceptedFrame) -> Array:
    """Return the variances (3,) by which a frame scatters about its neighbours, without the car's motion.

    Args:
        frame: An accepted frame.
    """
    return _scatter(frame, lambda name: True)


def _scatter(frame: AcceptedFrame, counts: Callable[[str], bool]) -> Array:
    """Return the variances (3,) of what is new in a frame, by the terms that count."""
    total = np.zeros(3)
    for term in _terms(frame):
        if counts(term.name):
            total += (1.0 - _lasting_part(term.name)) * term.covariance.diagonal()
    return total


def _lasting_part(name: str) -> float:
    """Return the part of the variance of a term that is the same in all frames of a drive."""
    if name in _OF_CAMERAS | _OF_CROSS_SECTION:
        return 1.0
    return 0.0 if name in _OF_PIXELS | _OF_TEXTURE | _OF_PROFILE else 0.5


def frame_series(frames: Sequence[AcceptedFrame]) -> FrameSeries:
    """Return accepted frames, in the order of time, as a series."""
    return FrameSeries.of(
        np.array([frame.stamp_s for frame in frames], dtype=np.float64),
        np.array([frame.extrinsics.as_array() for frame in frames if frame.extrinsics is not None]),
        np.array([scatter_variances(frame) for frame in frames]),
        np.array([frame.stood for frame in frames], dtype=bool),
        np.array([_scatter(frame, lambda name: name not in _OF_PIXELS) for frame in frames]),
    )


def fuse_frames(frames: Sequence[AcceptedFrame], rig: StereoRig) -> CalibrationResult:
    """Return the mount by accepted frames: their mean over time, with what the car's motion leaves of it.

    Args:
        frames: At least one accepted frame, in any order.
        rig: The rig that the frames come from.

    Returns:
        The estimate. One frame has the uncertainty of the usual motion of a car.
    """
    frames = sorted(frames, key=lambda frame: frame.stamp_s)
    terms = [_terms(frame, rig) for frame in frames]
    whole = np.array([np.diag(total_covariance(each)) for each in terms])
    own = np.array([np.diag(own_covariance(frame)) for frame in frames])
    series, motion = without_outliers(frame_series(frames), own)
    good = [frame for frame, use in zip(frames, series.used, strict=True) if use]
    terms = [each for each, use in zip(terms, series.used, strict=True) if use]
    series, whole = series.good(), whole[series.used]
    alike, off = weights_of_mean(series, series.variances, motion)
    weights = _weights(alike, series, whole, motion)
    weights = _between_all_and_best(weights, good, terms, series, whole, motion)
    mean = (weights * series.values).sum(axis=0)
    of_motion, _ = motion.of_mean(series, weights)
    uncertainty = merge_terms(
        (
            *_terms_of_mean(good, terms, series, weights),
            UncertaintyTerm("standing" if series.all_stood else "motion", np.diag(of_motion)),
            UncertaintyTerm("scatter", np.diag(_scatter_beyond(off, series, weights))),
            UncertaintyTerm("lean", np.diag([0.0, 0.0, LEAN_STD_RAD**2])),
        )
    )
    yaws = [frame.lane_yaw_rad for frame in good if frame.lane_yaw_rad is not None]
    bends = [frame.lane_curvature_per_m for frame in good if frame.lane_curvature_per_m is not None]
    fused = CalibrationResult(
        message="",
        extrinsics=Extrinsics.from_array(mean),
        covariance=total_covariance(uncertainty),
        uncertainty=uncertainty,
        reservations=merge_reservations(frame.reservations for frame in good),
        confirmed_by_texture=any(frame.confirmed_by_texture for frame in good),
        lane_yaw_rad=float(np.mean(yaws)) if yaws else None,
        lane_curvature_per_m=float(np.mean(bends)) if bends else None,
        stages={
            name: Extrinsics.from_array(np.mean([frame.stages[name].as_array() for frame in good], axis=0))
            for name in good[0].stages
            if all(name in frame.stages for frame in good)
        },
        stamp_s=frames[-1].stamp_s,
        n_frames=len(good),
        mount=_evidence(good, len(frames) - len(good), series, motion, of_motion),
    )
    return replace(fused, message=announce(fused))


def _scatter_beyond(off: Array, series: FrameSeries, weights: Array) -> Array:
    """Return the variances (3,) of a mean by what its frames scatter beyond what motion and noise explain.

    Their noise may be more than they say, as in a standing car, whose motion explains nothing. Birge's ratio
    (Phys. Rev. 40, 1932) enlarges the variance that noise leaves in the mean. Few frames do not know it: a
    ratio of 1 counts as some more.

    Args:
        off: (N, 3) how far each frame is off what the others predict, over its standard deviation.
        series: The frames.
        weights: (N, 3) their weights.
    """
    free = len(off) - 1.0
    ratio = (_FEW_FRAMES + (off**2).sum(axis=0) * free / len(off)) / (_FEW_FRAMES + free)
    of_noise = (weights**2 * series.alone(series.variances)).sum(axis=0)
    return np.asarray(np.maximum(ratio - 1.0, 0.0) * of_noise)


def _weights(alike: Array, series: FrameSeries, whole: Array, motion: CarMotion) -> Array:
    """Return the weights (N, 3) of frames in their mean: less for frames whose error does not average out.

    The best linear mean averages motion and noise, to a variance k with weights w. What cameras and road do
    to frame i lasts, with a variance S_i. The weights v that minimise k sum v^2 / w + sum v S are w times
    (a - S_i) / 2 k, or 0 where that is negative. So a frame that is much worse than the others does no harm.

    Args:
        alike: (N, 3) weights of the best linear mean.
        series: The frames, all of which count.
        whole: (N, 3) their variances.
        motion: The motion of the car.
    """
    alike = np.maximum(alike, 0.0)
    alike /= alike.sum(axis=0)
    of_motion, _ = motion.of_mean(series, alike)
    scale = 2.0 * (of_motion + (alike**2 * series.variances).sum(axis=0))
    lasting = np.maximum(whole - series.variances, 0.0)
    weights = np.empty_like(alike)
    for column, (part, variance) in enumerate(zip(alike.T, lasting.T, strict=True)):
        order = np.argsort(variance, kind="stable")
        parts, of_parts = np.cumsum(part[order]), np.cumsum((part * variance)[order])
        # The level a, if the frames up to each one count; the last of them that it makes count is the one.
        level = (scale[column] + of_parts) / np.maximum(parts, np.finfo(float).tiny)
        counted = np.flatnonzero(level > variance[order])[-1]
        weights[:, column] = part * np.maximum(level[counted] - variance, 0.0) / scale[column]
    return np.asarray(weights / weights.sum(axis=0))


def _between_all_and_best(
    weights: Array,
    good: Sequence[AcceptedFrame],
    terms: Sequence[tuple[UncertaintyTerm, ...]],
    series: FrameSeries,
    whole: Array,
    motion: CarMotion,
) -> Array:
    """Return weights (N, 3) between those of a mean and of its best frame alone, where they are best.

    Two frames of one moment share the motion; so the mean of a good frame and a bad one may be worse than the
    good one. The more frames there are, the less the mean may rest on one of them: its own standard deviation
    may be wrong, and the others do not check it any more.

    Args:
        weights: (N, 3) weights of a mean.
        good: The frames.
        terms: Their terms.
        series: The same frames.
        whole: (N, 3) their variances.
        motion: The motion of the car.
    """
    best = np.zeros_like(weights)
    best[np.argmin(whole, axis=0), np.arange(3)] = 1.0
    of_all, of_both, of_best = (
        total_covariance(_terms_of_mean(good, terms, series, each)).diagonal()
        + motion.of_mean(series, each)[0]
        for each in (weights, (weights + best) / 2.0, best)
    )
    # On the way from one to the other, the variance is a parabola.
    bend = 2.0 * (of_all - 2.0 * of_both + of_best)
    slope = of_best - of_all - bend
    lowest = np.clip(-slope / np.where(bend > 0.0, 2.0 * bend, 1.0), 0.0, 1.0)
    share = np.where(bend > 0.0, lowest, of_best < of_all) * min(1.0, _FEW_FRAMES / len(weights))
    return np.asarray(weights + share * (best - weights))


def _evidence(
    good: Sequence[AcceptedFrame], n_outliers: int, series: FrameSeries, motion: CarMotion, of_motion: Array
) -> MountEvidence:
    """Return how the mean was reached.

    Args:
        good: Frames in the mean.
        n_outliers: Number of others.
        series: The frames in the mean.
        motion: The motion of the car.
        of_motion: (3,) variance that it leaves in the mean.
    """
    return MountEvidence(
        duration_s=float(series.times_s[-1] - series.times_s[0]),
        n_outliers=n_outliers,
        n_known=sum(frame.known_start for frame in good),
        stood=series.all_stood,
        motion=Extrinsics.from_array(np.sqrt(motion.variance)),
        memory_s=motion.memory_s,
        looks=np.ones(3) if series.all_stood else np.maximum(1.0, motion.variance / of_motion),
    )


def _terms(frame: AcceptedFrame, rig: StereoRig | None = None) -> tuple[UncertaintyTerm, ...]:
    """Return the terms of a frame; where they are not known, its covariance is noise."""
    if frame.uncertainty:
        return frame.uncertainty
    if frame.covariance is None:
        raise ValueError("only accepted frames have a covariance")
    noise = UncertaintyTerm("noise", frame.covariance)
    if rig is None or frame.extrinsics is None or not frame.confirmed_by_texture:
        return (noise,)
    # A frame from a file without terms: such files hold no unknowns of the rig.
    return (noise, *rig_terms(response_of_surface(rig, frame.extrinsics)))


def _terms_of_mean(
    frames: Sequence[AcceptedFrame],
    terms: Sequence[tuple[UncertaintyTerm, ...]],
    series: FrameSeries,
    weights: Array,
) -> list[UncertaintyTerm]:
    """Return what the terms of the frames leave in their mean.

    Args:
        frames: The frames.
        terms: Their terms.
        series: The same frames.
        weights: (N, 3) their weights.
    """
    of_profile = variance_of_mean(series.gaps_s, weights, np.full((1, 3), _PROFILE_MEMORY_S))[0]
    cold = np.array([not frame.known_start for frame in frames])
    found = []
    for name, covariances in _by_name(terms).items():
        if name in _OF_PIXELS | _OF_TEXTURE:
            new = ~series.stood if name in _OF_TEXTURE else np.ones(len(frames), dtype=bool)
            of_mean = (1.0 - _SAME_LOOK_PART) * _by_groups(covariances, weights, new)
            of_mean += _SAME_LOOK_PART * _by_groups(covariances, weights, new & cold)
        elif name in _OF_COLD:
            of_mean = _by_groups(covariances, weights, cold)
        else:
            # One error in all frames, as large as in a mean frame.
            part = np.sqrt(weights)
            lasting = _lasting_part(name)
            left = np.sqrt(lasting + (1.0 - lasting) * np.minimum(of_profile, 1.0))
            of_mean = np.outer(left, left) * np.einsum("ni,nij,nj->ij", part, covariances, part)
        found.append(UncertaintyTerm(name, of_mean))
    return found


def _by_name(terms: Sequence[tuple[UncertaintyTerm, ...]]) -> dict[str, Array]:
    """Return the covariances (N, 3, 3) of each term of N frames, zeros where a frame does not have it."""
    covariances: dict[str, Array] = {}
    for index, each in enumerate(terms):
        for term in each:
            of_name = covariances.setdefault(term.name, np.zeros((len(terms), 3, 3)))
            of_name[index] += term.covariance
    return covariances


def _by_groups(covariances: Array, weights: Array, new: Mask) -> Array:
    """Return the covariance (3, 3) of a mean whose frames have one error for each group.

    Args:
        covariances: (N, 3, 3) of the frames.
        weights: (N, 3) their weights.
        new: (N,) whether a frame begins a group; the first one does.
    """
    starts = np.flatnonzero(np.concatenate([[True], new[1:]]))
    total = np.add.reduceat(weights, starts)
    counts = np.diff(starts, append=len(weights))
    mean = np.add.reduceat(covariances, starts) / counts[:, None, None]
    return np.asarray(np.einsum("gi,gij,gj->ij", total, mean, total))
