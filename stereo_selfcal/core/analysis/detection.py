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

"""How soon any test can see that a camera was moved, at a rate of false alarms.

The frames of a drive show a mean, the motion of the car and noise: the motion is a Gauss-Markov process. A
change of the mean by a known amount at an unknown time is what a test looks for. No test that raises a false
alarm once in a mean time of ``exp(h)`` frames has a smaller worst mean delay than the one in which the frames
after the change tell ``h`` nats more for it than against it, to first order in ``h`` (Lorden, Ann. Math.
Statist. 42, 1971; Page's CUSUM attains it: Moustakides, Ann. Statist. 14, 1986). A test that knows neither
the amount nor the motion, as the watch (:mod:`..drive.drift`), needs more.
"""

from __future__ import annotations

import math

_HOUR_S = 3600.0
_SETTLED = 1e-12  # relative change of a variance, below which a filter has come to rest


def least_delay_s(
    change: float, motion_std: float, memory_s: float, noise_std: float, period_s: float, alarm_hours: float
) -> float:
    """Return the least mean delay with which a change is seen [s].

    The mean before is known, and frames come without a pause.

    Args:
        change: Change of the mean.
        motion_std: Standard deviation of the motion, in the same unit.
        memory_s: Its correlation falls by 1 / e in this time [s].
        noise_std: Standard deviation of the noise of a frame.
        period_s: Time between two frames [s].
        alarm_hours: Mean time between two false alarms [h].
    """
    keep = math.exp(-period_s / memory_s)
    predicted = _predicted_variance(motion_std**2, keep, noise_std**2)
    innovation = predicted + noise_std**2
    gain = predicted / innovation
    needed = math.log(alarm_hours * _HOUR_S / period_s)
    # A filter that takes the mean for unchanged follows the change as if it were motion.
    followed, told, n = 0.0, 0.0, 0
    while told < needed:
        seen = change - followed
        step = seen**2 / (2.0 * innovation)
        followed_next = keep * (followed + gain * seen)
        if n and math.isclose(followed_next, followed, rel_tol=_SETTLED):
            # From now on every frame tells as much.
            return (n + (needed - told) / step) * period_s
        told, followed, n = told + step, followed_next, n + 1
    return n * period_s


def _predicted_variance(variance: float, keep: float, noise: float) -> float:
    """Return the variance with which all frames before predict the motion in the next one."""
    fresh = variance * (1.0 - keep**2)
    predicted = variance
    while True:
        left = predicted * noise / (predicted + noise) if noise else 0.0
        after = keep**2 * left + fresh
        if math.isclose(after, predicted, rel_tol=_SETTLED):
            return after
        predicted = after
