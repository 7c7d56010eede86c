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

"""When the right images of a drive are taken, in words."""

from __future__ import annotations

import math

from .geometry.travel import RightDelay

# Standard deviations within which a normal error lies in 997 of 1000 cases.
_SIGMAS = 3.0
# Where the speed varies by less than this part of itself, the prior of the rig tells a delay from a camera
# that sits elsewhere, and the drive does not.
_VARIED = 0.2
_MS = 1e3


def is_late(delay: RightDelay | None) -> bool:
    """Whether the right images are surely not taken when their stamps say so."""
    return delay is not None and abs(delay.delay_s) > _SIGMAS * float(delay.std[0])


def describe_delay(delay: RightDelay | None) -> str:
    """Return the delay of the right images in one sentence, "" where nothing tells it.

    Args:
        delay: The delay.
    """
    if delay is None:
        return ""
    value_s, std_s = delay.delay_s, float(delay.std[0])
    if is_late(delay):
        when = "later" if value_s > 0.0 else "earlier"
        amount = f"{_ms(abs(value_s), std_s)} +- {_ms(std_s, std_s)} ms"
        text = f"right images are taken {amount} {when} than the left ones of the same stamps"
    else:
        doubt_s = math.hypot(value_s, std_s)
        text = f"both images of a pair are taken when their stamps say, to {_ms(doubt_s, doubt_s)} ms"
    slowest, fastest = delay.speeds_mps
    if fastest - slowest < _VARIED * fastest:
        text += (
            f"; at a constant speed, here {fastest:.1f} m/s, 1 ms looks like a right camera that sits "
            f"{fastest:.0f} mm farther ahead: drive slower and faster to tell which it is"
        )
    return text


def _ms(value_s: float, std_s: float) -> str:
    """Return milliseconds with the decimals of the first digit of a standard deviation, at most two."""
    std_ms = _MS * std_s
    decimals = min(max(-math.floor(math.log10(std_ms)), 0), 2) if 0.0 < std_ms < math.inf else 1
    return f"{_MS * value_s:.{decimals}f}"
