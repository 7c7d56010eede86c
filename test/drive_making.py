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

"""Drives of a car on its suspension, as estimates of its frames: with their noise, and without images."""

from typing import Any

import numpy as np

from stereo_selfcal.core.drive.frame_series import FrameSeries

# Of a frame: what the camera does while the car pitches and rolls, and the noise of its estimate; height [m],
# pitch, roll [rad].
MOTION = np.array([0.006, np.radians(0.2), np.radians(0.3)])
NOISE = np.array([0.008, np.radians(0.06), np.radians(0.15)])
POSE = np.array([1.4, np.radians(3.0), np.radians(0.5)])


def make_drive(
    duration_s: float = 3600.0,
    rate_hz: float = 0.5,
    correlation_s: float = 2.0,
    seed: int = 0,
    steps: tuple[tuple[float, Any], ...] = (),
    outliers: float = 0.03,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps (N,), poses (N, 3), covariances (N, 3, 3).

    ``steps`` are times [s] and by how much height, pitch and roll change then.
    """
    rng = np.random.default_rng(seed)
    n = round(duration_s * rate_hz)
    stamps = 100.0 + np.arange(n) / rate_hz
    keep = np.exp(-1.0 / (rate_hz * correlation_s))
    moved = np.empty((n, 3))
    now = rng.normal(size=3)
    for i in range(n):
        moved[i] = now
        now = keep * now + np.sqrt(1 - keep**2) * rng.normal(size=3)
    poses = POSE + moved * MOTION + rng.normal(size=(n, 3)) * NOISE
    for at_s, step in steps:
        poses[stamps - 100.0 >= at_s] += step
    wild = rng.random(n) < outliers
    poses[wild] += rng.normal(size=(np.count_nonzero(wild), 3)) * [0.05, 0.01, 0.02]
    return stamps, poses, np.broadcast_to(np.diag(NOISE**2), (n, 3, 3))


def series_of(stamps: np.ndarray, poses: np.ndarray, covariances: np.ndarray) -> FrameSeries:
    """Return the same as a series, of a car that never stands."""
    return FrameSeries.of(stamps, poses, np.diagonal(covariances, axis1=1, axis2=2))
