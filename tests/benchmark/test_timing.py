import numpy as np
import pytest

from tensionlab.benchmark.timing import (
    maximum,
    profile,
    quantile,
    shifted_geometric_mean,
)

NAN, INF = np.nan, np.inf


def test_the_shifted_geometric_mean_by_hand():
    # (0 + 1)(3 + 1) = 4, whose root is 2; less the shift, 1.
    assert shifted_geometric_mean(np.array([0.0, 3.0, NAN]), shift=1.0) == pytest.approx(1.0)
    # Without a shift worth mentioning: the geometric mean.
    assert shifted_geometric_mean(np.array([1.0, 100.0])) == pytest.approx(10.0, rel=1e-5)
    assert np.isnan(shifted_geometric_mean(np.array([NAN])))


def test_a_quantile_is_a_value_that_was_measured():
    values = np.append(np.arange(1.0, 101.0), NAN)
    assert [quantile(values, share) for share in (0.5, 0.99, 0.999, 1.0)] == [50.0, 99.0, 100.0, 100.0]
    assert quantile(np.array([7.0]), 0.999) == 7.0
    assert np.isnan(quantile(np.array([]), 0.5))
    assert maximum(np.array([1.0, NAN, 5.0])) == 5.0
    assert np.isnan(maximum(np.array([NAN])))


def test_a_performance_profile_by_hand():
    # Problems by row; entries A, B and C. A fails the third, C does not try the first, no entry solves the last.
    seconds = np.array([[1.0, 2.0, NAN], [4.0, 1.0, 2.0], [1.0, 3.0, 6.0], [1.0, 1.0, 1.0]])
    solved = np.array([[1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 0, 0]], dtype=bool)
    tried = np.array([[1, 1, 0], [1, 1, 1], [1, 1, 1], [1, 1, 1]], dtype=bool)
    a, b, c = profile(seconds, solved, tried)
    np.testing.assert_array_equal(a, [1.0, 4.0, INF])
    np.testing.assert_array_equal(b, [1.0, 1.0, 2.0])
    np.testing.assert_array_equal(c, [2.0, 2.0])
