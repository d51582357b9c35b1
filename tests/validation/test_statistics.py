import numpy as np
import pytest

from tensionlab.errors import ShapeError
from tensionlab.model.directions import grid18
from tensionlab.validation.statistics import deviations, score

FORCES = 1.5 * grid18()


def test_each_deviation_by_hand():
    found = deviations(
        np.array([[1.5, 0, 0], [1.5, 0, 0], [0, 2.0, 0]]), np.array([[0, 1.5, 0], [3.0, 0, 0], [0, 0, 0]])
    )
    assert found.angle[:2].tolist() == [90.0, 0.0]
    assert np.isnan(found.angle[2])
    assert found.magnitude.tolist() == [1.5, 3.0, 0.0]
    assert found.magnitude_error.tolist() == [0.0, 1.5, 2.0]
    assert found.vector == pytest.approx([1.5 * np.sqrt(2.0), 1.5, 2.0])


def test_a_perfect_rig_has_no_errors():
    found = score(FORCES, FORCES)
    assert found.angle.largest == 0.0
    assert found.magnitude.mean.value == pytest.approx(1.5)
    assert found.vector.weighted == (0.0, 0.0, 0.0)
    assert found.within == 1.0


def test_weights_take_the_poles_for_what_they_are():
    wrong = (
        np.where(np.abs(FORCES[:, [1]]) > 1.4, 2.0, 1.0) * FORCES
    )  # 42 vectors about the poles are twice too long
    found = score(FORCES, wrong).vector
    assert found.mean.value == pytest.approx(1.5 * 42 / 182)
    assert found.weighted.value == pytest.approx(1.5 * 0.0979, abs=2e-3)  # sin 18° of the sum of sines, twice
    assert found.mean.lower < found.mean.value < found.mean.upper


def test_bootstrap_intervals_are_as_wide_as_theory_says():
    random = np.random.default_rng(1)
    long = FORCES * (1.0 + 0.1 * random.standard_normal((182, 1)))
    found = score(FORCES, long).magnitude.mean
    sd = np.linalg.norm(long, axis=1).std() / np.sqrt(182)
    assert found.upper - found.lower == pytest.approx(2 * 1.96 * sd, rel=0.1)


def test_share_within_45_degrees():
    c = np.cos(np.radians(46.0))
    measured = np.array([[1.0, 0, 0], [c, np.sqrt(1 - c * c), 0]])
    assert score(np.array([[1.0, 0, 0]] * 2), measured).within == 0.5


def test_no_forces_are_refused():
    with pytest.raises(ShapeError, match="no forces"):
        score(np.empty((0, 3)), np.empty((0, 3)))
