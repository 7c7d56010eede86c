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

import numpy as np
import pytest

from stereo_selfcal.core.numerics.statistics import median, quantile


@pytest.mark.parametrize("n", [1, 2, 7, 60])
def test_median_is_that_of_numpy(n):
    values = np.random.default_rng(n).normal(size=n)
    assert median(values) == np.median(values)


@pytest.mark.parametrize("n", [1, 2, 7, 60])
@pytest.mark.parametrize("part", [0.0, 0.25, 0.5, 1.0])
def test_quantile_is_that_of_numpy(n, part):
    values = np.sort(np.random.default_rng(n).integers(-50, 50, n).astype(np.int16))
    assert quantile(values, part) == pytest.approx(np.quantile(values, part))
