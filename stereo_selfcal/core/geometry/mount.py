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

"""How an estimate of the mount was reached, as values."""

from __future__ import annotations

from dataclasses import dataclass

from ..types import Array
from .pose import Extrinsics


@dataclass(frozen=True, slots=True, eq=False)
class MountEvidence:
    """What a drive has shown of the mount: how the frames were spread over time, and how the car moved.

    Attributes:
        duration_s: Time from the first to the last accepted frame [s].
        n_outliers: Accepted frames that were set aside as outliers.
        n_known: Accepted frames that started from the known camera instead of from nothing.
        stood: Whether the car stood all the time: the frames are one view of one road.
        motion: Standard deviations by which the car moves its camera over the road, from moment to moment.
        memory_s: (3,) how long a state of this motion of height, pitch and roll lasts [s].
        looks: (3,) how many independent moments of height, pitch and roll the drive is worth.
    """

    duration_s: float
    n_outliers: int
    n_known: int
    stood: bool
    motion: Extrinsics
    memory_s: Array
    looks: Array
