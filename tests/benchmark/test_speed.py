import numpy as np
import pytest

from tensionlab.benchmark.speed import quantile, shifted_geometric_mean


def test_the_shifted_geometric_mean_by_hand():
    # (0 + 1)(3 + 1) = 4, whose root is 2; less the shift, 1.
    assert shifted_geometric_mean(np.array([0.0, 3.0, np.nan]), shift=1.0) == pytest.approx(1.0)
    # Without a shift worth mentioning: the geometric mean.
    assert shifted_geometric_mean(np.array([1.0, 100.0])) == pytest.approx(10.0, rel=1e-5)
    assert np.isnan(shifted_geometric_mean(np.array([np.nan])))


def test_a_quantile_is_a_value_that_was_measured():
    values = np.append(np.arange(1.0, 101.0), np.nan)
    assert [quantile(values, share) for share in (0.5, 0.99, 0.999, 1.0)] == [50.0, 99.0, 100.0, 100.0]
    assert quantile(np.array([7.0]), 0.999) == 7.0
    assert np.isnan(quantile(np.array([]), 0.5))
