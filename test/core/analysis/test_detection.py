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

"""The least delay of any test, against the frames' covariance itself."""

import math

import numpy as np
import pytest

from stereo_selfcal.core.analysis.detection import least_delay_s


def nats_after(n, change, std, memory_s, noise, period_s, n_past=400):
    """Return what n frames after a change tell for it, by the covariance of all frames."""
    times = period_s * np.arange(n_past + n)
    covariance = std**2 * np.exp(-np.abs(times[:, None] - times) / memory_s) + noise**2 * np.eye(len(times))
    past, after = slice(0, n_past), slice(n_past, None)
    known = np.linalg.solve(covariance[past, past], covariance[past, after])
    left = covariance[after, after] - covariance[after, past] @ known
    return change**2 / 2.0 * np.linalg.solve(left, np.ones(n)).sum()


@pytest.mark.parametrize("period_s", [2.0, 0.5])
@pytest.mark.parametrize(("change", "noise"), [(0.3, 0.02), (0.1, 0.05), (0.1, 0.0)])
def test_the_frames_of_the_least_delay_tell_as_much_as_is_needed(period_s, change, noise):
    delay_s = least_delay_s(change, 0.15, 2.0, noise, period_s, 100.0)
    needed = math.log(100.0 * 3600.0 / period_s)
    n = delay_s / period_s
    told = [nats_after(int(k), change, 0.15, 2.0, noise or 1e-6, period_s) for k in (np.floor(n), np.ceil(n))]
    if n == int(n):
        assert (
            nats_after(int(n) - 1, change, 0.15, 2.0, noise or 1e-6, period_s)
            < needed
            <= told[0] * (1 + 1e-6)
        )
    else:
        assert told[0] * (1 - 1e-6) <= needed <= told[1] * (1 + 1e-6)


def test_independent_frames_need_their_number():
    """Without memory, each frame tells d^2 / (2 s^2)."""
    delay_s = least_delay_s(0.1, 0.2, 1e-3, 0.0, 2.0, 100.0)
    assert delay_s == pytest.approx(2.0 * math.log(100 * 1800) / (0.1**2 / (2 * 0.2**2)), abs=2.0)


def test_frames_faster_than_the_motion_add_little():
    """In the limit, a second tells d^2 / (4 s^2 tau), and the step itself a little more."""
    slow, fast = (least_delay_s(0.1, 0.2, 4.0, 0.0, period_s, 100.0) for period_s in (2.0, 0.5))
    assert 0.9 < fast / slow < 1.15
