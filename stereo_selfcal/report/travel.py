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

"""The camera against the direction of travel, in words."""

from __future__ import annotations

from ..core.geometry.pose import DEGREES
from ..core.geometry.travel import Travel
from ..files.frames import unknown_yaw_cause

_LABEL = "The yaw against the direction of travel"


def travel_sentence(travel: Travel | None) -> str:
    """Return how well the yaw is known, or why it is not; a sentence without a full stop.

    Args:
        travel: The camera against the direction of travel; None where nothing tells it.
    """
    if travel is None:
        return f"{_LABEL} is not known: {unknown_yaw_cause(travel)}"
    seen = f"{travel.n_steps} steps of {travel.driven_s:.1f} s of drive"
    std, pitch_std = (DEGREES.text(float(value)) for value in travel.std)
    if not travel.tells_yaw:
        return (
            f"{_LABEL} is not known better than that of any mount (std {std} after {seen}): the car drove "
            "bends only, or too short a way"
        )
    yaw, pitch = (DEGREES.text(value, "+") for value in (travel.yaw_rad, travel.pitch_rad))
    return f"{_LABEL} is {yaw} (std {std}), the pitch against it {pitch} (std {pitch_std}), by {seen}"
