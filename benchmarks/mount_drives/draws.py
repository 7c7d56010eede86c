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

"""Frames of a drive, drawn from the errors that were measured: no image is needed for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stereo_selfcal import CalibrationResult, Extrinsics, StereoRig
from stereo_selfcal.core.estimators.landmarks import Landmarks
from stereo_selfcal.core.geometry.uncertainty import TERMS, total_covariance
from stereo_selfcal.core.rejection import Bound, Rejection, RejectReason
from stereo_selfcal.core.types import Array, Mask

from ..frames import READABLE
from .frame_errors import FrameError, measured_scale
from .rides import STEP_S, Ride, driven

# How far a car drives until the error of each cause is another one [m]. The road's profile along the lane
# changes with the part of it that is seen, some 10 to 40 m. Its cross-section stays for minutes: kilometres.
_ALWAYS_NEW, _CROSS_SECTION_M = 0.0, 2000.0
_LENGTHS_M = {
    "noise": _ALWAYS_NEW,
    "misfit": 20.0,
    "mismatch": 30.0,
    "roughness": 12.0,
    "camber": _CROSS_SECTION_M,
    "paint_angle": 100.0,  # painted in one go
    "stage_disagreement": 30.0,
    "slope_seen": 40.0,
    "slope_unseen": 40.0,
    "crown": _CROSS_SECTION_M,
    "kerb": 200.0,
    "part_of_road": 150.0,  # planes of nearer and farther, narrower and wider road: of both kinds
    "combination_disagreement": 50.0,
}
_USUAL_LENGTH_M = 50.0
# A delay stays. Of the way to the side in it, half the variance is a camera that is not mounted straight, and
# half a drift in the lane, for a few seconds.
_DRIFT_LENGTH_M, _DRIFTS_PART = 60.0, 0.5
# Lines come and go: after so many metres, a stretch of the road shows what another measured frame shows.
_STRETCH_M = (50.0, 300.0)
# Bad frames: tens of millimetres, up to a degree or two; each lasts for a moment or for some frames.
_BAD_MM, _BAD_DEG = (20.0, 80.0), (0.2, 2.0)
_BAD_LASTS = 2.0
BAD_PART = 0.1
# Frames are refused for stretches: a quarter of the time.
_REFUSED_PART, _REFUSED_S = 0.25, (0.5, 5.0)
REFUSAL = Rejection(
    RejectReason.ROAD_NOT_SEEN, "part of the road that is seen", 0.1, Bound.LEAST, 0.3, "", "drive on"
)


# Points by which a car sees whether it stands, and the noise of their places [px].
_N_POINTS, _POINT_NOISE_PX = 60, 0.1
_POINTS_AHEAD_M = (5.0, 60.0)


@dataclass(frozen=True, slots=True)
class Kind:
    """What a drive is drawn from.

    Attributes:
        ride: How the car is driven.
        duration_s: For how long [s].
        rate_hz: Frames per second.
        bad_part: Part of the accepted frames that are bad.
        gaps: Whether frames are refused for stretches.
        measured: Whether errors are as large as those that were measured; otherwise as the frames say.
        lasting: Whether a bad frame is followed by some that are wrong in the same way.
        noise_alone: Whether frames have no other error than noise, and say so.
    """

    ride: Ride
    duration_s: float
    rate_hz: float
    bad_part: float = BAD_PART
    gaps: bool = True
    measured: bool = True
    lasting: bool = True
    noise_alone: bool = False


@dataclass(frozen=True, eq=False)
class DrawnDrive:
    """Results of frames, and where the mount really is.

    Attributes:
        frames: Those of the rig.
        mount: The mount.
        results: Results of the frames, in order of time; refused ones among them.
        bad: Which of them are bad.
    """

    frames: list[FrameError]
    mount: Extrinsics
    results: list[CalibrationResult]
    bad: Mask


def drawn(kind: Kind, frames: list[FrameError], rng: np.random.Generator) -> DrawnDrive:
    """Draw a drive.

    Args:
        kind: What it is like.
        frames: Measured frames of one rig, from which its frames are drawn.
        rng: Source of everything.
    """
    if kind.noise_alone:
        frames = [with_noise_alone(frame) for frame in frames]
    drive = driven(kind.ride, kind.duration_s, rng)
    times = np.arange(0.0, kind.duration_s, 1.0 / kind.rate_hz)
    times = np.clip(times + rng.normal(0.0, 0.002, len(times)), 0.0, kind.duration_s)
    steps = np.round(times / STEP_S).astype(int)
    way_m, standing = drive.way_m[steps], drive.standing[steps]
    shown = _stretches(way_m, len(frames), rng)
    scale = measured_scale(frames) if kind.measured else np.ones(3)
    errors = _errors_of_road(frames, shown, way_m, rng) * scale + _errors_of_rig(frames, shown, rng)
    errors += _errors_of_delay(frames, shown, way_m, rng)
    bad = _bad_frames(kind, len(times), rng)
    errors += _gross(bad, kind.lasting, rng)
    refused = _refused(times, rng) if kind.gaps else np.zeros(len(times), bool)
    mount = frames[0].pose
    poses = mount + drive.motion[steps] + errors
    results = []
    points = _points(frames[0].rig, rng)
    for index, time_s in enumerate(times):
        if not (index and standing[index] and standing[index - 1]):
            points = _points(frames[0].rig, rng)  # all is new that is seen
        # Clocks start far from zero. Matching points takes time: only cars that stand need any.
        seen = _seen(points, rng) if standing.any() else None
        common = CalibrationResult("", stamp_s=1000.0 + float(time_s), landmarks=seen)
        if refused[index]:
            results.append(replace(common, message=REFUSAL.message, rejection=REFUSAL))
            continue
        terms = frames[shown[index]].terms
        results.append(
            replace(
                common,
                extrinsics=Extrinsics.from_array(poses[index]),
                covariance=total_covariance(terms),
                uncertainty=terms,
                n_frames=1,
            )
        )
    return DrawnDrive(frames, Extrinsics.from_array(mount), results, bad & ~refused)


def with_noise_alone(frame: FrameError) -> FrameError:
    """Return a frame of a perfect rig over a perfect road."""
    return replace(frame, terms=tuple(term for term in frame.terms if term.name == "noise"))


def _points(rig: StereoRig, rng: np.random.Generator) -> Landmarks:
    """Return points of a world that was not seen before."""
    left = rng.uniform([0.0, 0.0], [rig.width, rig.height], (_N_POINTS, 2))
    disparity = rig.fx * rig.baseline_m / rng.uniform(*_POINTS_AHEAD_M, _N_POINTS)
    right = left - np.stack([disparity, np.zeros(_N_POINTS)], axis=1)
    descriptors = rng.integers(256, size=(_N_POINTS, 32), dtype=np.uint8)
    return Landmarks(left.astype(np.float32), right.astype(np.float32), descriptors)


def _seen(points: Landmarks, rng: np.random.Generator) -> Landmarks:
    """Return the same points, seen once more."""
    places = (
        (side + rng.normal(0.0, _POINT_NOISE_PX, side.shape)).astype(np.float32)
        for side in (points.left, points.right)
    )
    return Landmarks(*places, points.descriptors)


def _stretches(way_m: Array, number: int, rng: np.random.Generator) -> Array:
    """Return which of the measured frames each frame (T,) is like."""
    ends = np.cumsum(rng.uniform(*_STRETCH_M, 2 + int(way_m[-1] / _STRETCH_M[0])))
    shown = rng.integers(number, size=len(ends) + 1)
    like: Array = shown[np.searchsorted(ends, way_m)]
    return like


def _errors_of_road(frames: list[FrameError], shown: Array, way_m: Array, rng: np.random.Generator) -> Array:
    """Return the errors (T, 3) by all that is not the rig's, each cause as long the same as it lasts."""
    unit = np.diag(READABLE)
    errors = np.zeros((len(shown), 3))
    for name in TERMS:
        roots = {
            index: _root(unit @ term.covariance @ unit)
            for index in np.unique(shown)
            for term in frames[index].of_road
            if term.name == name
        }
        hidden = _lasting(way_m, _LENGTHS_M.get(name, _USUAL_LENGTH_M), rng)
        for index, root in roots.items():
            mine = shown == index
            errors[mine] += hidden[mine] @ root.T
    return errors / READABLE


def _errors_of_rig(frames: list[FrameError], shown: Array, rng: np.random.Generator) -> Array:
    """Return the errors (T, 3) by the unknowns of the rig, which are drawn once."""
    unit = np.diag(READABLE)
    names = sorted({term.name for frame in frames for term in frame.of_rig})
    hidden = dict(zip(names, rng.normal(size=(len(names), 3)), strict=True))
    per_frame = np.zeros((len(frames), 3))
    for index in np.unique(shown):
        for term in frames[index].of_rig:
            per_frame[index] += _root(unit @ term.covariance @ unit) @ hidden[term.name]
    errors: Array = per_frame[shown] / READABLE
    return errors


def _errors_of_delay(frames: list[FrameError], shown: Array, way_m: Array, rng: np.random.Generator) -> Array:
    """Return the errors (T, 3) by a delay of one camera."""
    unit = np.diag(READABLE)
    drift = _lasting(way_m, _DRIFT_LENGTH_M, rng)
    hidden = np.sqrt(1.0 - _DRIFTS_PART) * rng.normal(size=3) + np.sqrt(_DRIFTS_PART) * drift
    errors = np.zeros((len(shown), 3))
    for index in np.unique(shown):
        for term in frames[index].of_delay:
            mine = shown == index
            errors[mine] += hidden[mine] @ _root(unit @ term.covariance @ unit).T
    return errors / READABLE


def _root(covariance: Array) -> Array:
    """Return the symmetric root: the same unknown has the same sign in frames that are alike."""
    values, vectors = np.linalg.eigh(covariance)
    root: Array = (vectors * np.sqrt(np.clip(values, 0.0, None))) @ vectors.T
    return root


def _lasting(way_m: Array, length_m: float, rng: np.random.Generator) -> Array:
    """Return unknowns (T, 3) of variance one that are forgotten over a way, not while the car stands."""
    noise = rng.normal(size=(len(way_m), 3))
    if length_m == _ALWAYS_NEW:
        return noise
    keeps = np.exp(-np.diff(way_m) / length_m)
    news = np.sqrt(1.0 - keeps**2)
    for index, (kept, new) in enumerate(zip(keeps, news, strict=True)):
        noise[index + 1] = kept * noise[index] + new * noise[index + 1]
    return noise


def _bad_frames(kind: Kind, n: int, rng: np.random.Generator) -> Mask:
    if not kind.lasting:
        return rng.random(n) < kind.bad_part
    bad = np.zeros(n, bool)
    for start in np.flatnonzero(rng.random(n) < kind.bad_part / _BAD_LASTS):
        bad[start : start + int(rng.geometric(1.0 / _BAD_LASTS))] = True
    return bad


def _gross(bad: Mask, lasting: bool, rng: np.random.Generator) -> Array:
    """Return the errors (T, 3) of bad frames; 0 of the others."""
    n = len(bad)
    low, high = np.array([_BAD_MM, _BAD_DEG, _BAD_DEG]).T
    # Small ones are more frequent.
    sizes = low * (high / low) ** rng.random((n, 3)) * rng.choice([-1.0, 1.0], (n, 3))
    for index in range(1, n):
        if lasting and bad[index] and bad[index - 1]:
            sizes[index] = sizes[index - 1]
    errors: Array = np.where(bad[:, None], sizes / READABLE, 0.0)
    return errors


def _refused(times: Array, rng: np.random.Generator) -> Mask:
    """Return which frames (T,) are refused; the first and the last ones are not."""
    refused = np.zeros(len(times), bool)
    for start, length in _gaps(times[-1], rng):
        refused |= (times >= start) & (times < start + length)
    refused[[0, 1, -1]] = False
    return refused


def _gaps(duration_s: float, rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    low, high = _REFUSED_S
    time_s = 0.0
    while time_s < duration_s:
        length = rng.uniform(low, high)
        time_s += rng.exponential((low + high) / 2 * (1.0 - _REFUSED_PART) / _REFUSED_PART)
        yield time_s, length
        time_s += length
