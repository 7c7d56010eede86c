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
