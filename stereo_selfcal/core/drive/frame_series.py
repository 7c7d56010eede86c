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

"""Frames of a drive in the order of time, as numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..road.priors import STANDING_STD
from ..types import Array, Mask


@dataclass(frozen=True, slots=True, eq=False)
class FrameSeries:
    """Frames in the order of time.

    Attributes:
        times_s: (N,) times [s], rising.
        values: (N, 3) height_m, pitch_rad, roll_rad.
        variances: (N, 3) variances of their noise.
        used: (N,) False for outliers.
        stood: (N,) whether the car stood since the frame before.
        of_place: (N, 3) the parts of the variances that are the same in all frames of one stop.
    """

    times_s: Array
    values: Array
    variances: Array
    used: Mask
    stood: Mask
    of_place: Array

    @classmethod
    def of(
        cls,
        times_s: Array,
        values: Array,
        variances: Array,
        stood: Mask | None = None,
        of_place: Array | None = None,
    ) -> FrameSeries:
        """Return a series without outliers; a car that is not known to stand moves."""
        n = len(times_s)
        return cls(
            times_s,
            values,
            variances,
            np.ones(n, dtype=bool),
            np.zeros(n, dtype=bool) if stood is None else stood,
            np.zeros_like(variances) if of_place is None else of_place,
        )

    def __len__(self) -> int:
        return len(self.times_s)

    def part(self, which: slice | Mask) -> FrameSeries:
        """Return some of the frames."""
        return FrameSeries(
            self.times_s[which],
            self.values[which],
            self.variances[which],
            self.used[which],
            self.stood[which],
            self.of_place[which],
        )

    def joined(self, other: FrameSeries) -> FrameSeries:
        """Return these frames and later ones."""
        return FrameSeries(
            np.concatenate([self.times_s, other.times_s]),
            np.concatenate([self.values, other.values]),
            np.concatenate([self.variances, other.variances]),
            np.concatenate([self.used, other.used]),
            np.concatenate([self.stood, other.stood]),
            np.concatenate([self.of_place, other.of_place]),
        )

    def good(self) -> FrameSeries:
        """Return the frames that are used; a stop goes on over an outlier."""
        kept = np.flatnonzero(self.used)
        moved = np.concatenate([[0], np.cumsum(~self.stood)])
        stood = self.stood[kept].copy()
        if len(kept):
            stood[1:] = moved[kept[1:] + 1] == moved[kept[:-1] + 1]
        return replace(self.part(self.used), stood=stood)

    @property
    def gaps_s(self) -> Array:
        """(N,) time of motion since the frame before [s]: none while the car stood."""
        gaps_s: Array = np.where(self.stood, 0.0, np.maximum(np.diff(self.times_s, prepend=0.0), 0.0))
        return gaps_s

    @property
    def at_rest(self) -> Mask:
        """(N,) whether the car stood at a frame: before it or after it."""
        rest: Mask = self.stood.copy()
        rest[:-1] |= self.stood[1:]
        return rest

    @property
    def forgets_s(self) -> Array:
        """(N,) time in which the motion forgets the frame before [s].

        A place where the car stands, and its motion before and after that, have nothing in common.
        """
        rest = self.at_rest
        forgets_s: Array = np.where(np.diff(rest, prepend=rest[:1]), np.inf, self.gaps_s)
        return forgets_s

    def response(self, driving: Array) -> Array:
        """Return the standard deviations (N, ..., 3) that the state of the motion has at each frame.

        Args:
            driving: (..., 3) standard deviations of the motion while the car drives.
        """
        shape = (len(self), *(1,) * (driving.ndim - 1), 3)
        at_place = np.sqrt(np.square(STANDING_STD) + self.of_place).reshape(shape)
        return np.where(self.at_rest.reshape(-1, *(1,) * driving.ndim), at_place, driving)

    def alone(self, variances: Array) -> Array:
        """Return variances (N, 3) of frames without what all frames of a stop have in common."""
        return np.asarray(np.maximum(variances - np.where(self.at_rest[:, None], self.of_place, 0.0), 0.0))

    @property
    def all_stood(self) -> bool:
        """Whether all frames are of one stop."""
        return len(self) > 1 and bool(np.all(self.stood[1:]))
