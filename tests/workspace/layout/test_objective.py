import numpy as np
import pytest

from tensionlab.errors import ShapeError
from tensionlab.workspace.layout.objective import Objective

MARGINS = np.array([[3.0, 2.0, 1.0, -1.0], [2.0, 2.0, 2.0, 2.5], [0.0, 0.0, 5.0, 5.0]])


def test_the_score_is_the_worst_margin_or_a_share_of_the_points():
    np.testing.assert_array_equal(Objective().score(MARGINS), [-1, 2, 0])
    np.testing.assert_array_equal(Objective(2.0).score(MARGINS), [0.5, 1, 0.5])
    assert Objective(2.0).score(MARGINS[0]) == 0.5


@pytest.mark.parametrize("climb", [Objective(2.0).merit, lambda margins: Objective(2.0).smooth(margins, 0.004)])
def test_what_is_climbed_ranks_by_share_then_by_what_is_missing_then_by_what_is_spare(climb):
    better = [
        [0.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0, 0.0],
        [2.0, 1.9, 0.0, 0.0],
        [2.0, 2.0, 0.0, 0.0],
        [2.0, 2.0, 2.0, 1.9],
        [2.0, 2.0, 2.0, 2.0],
        [2.1, 2.1, 2.1, 2.1],
    ]
    assert (np.diff(climb(np.array(better))) > 0).all()


def test_without_a_force_all_of_them_are_the_worst_margin():
    np.testing.assert_array_equal(Objective().merit(MARGINS), Objective().score(MARGINS))
    np.testing.assert_array_equal(Objective().smooth(MARGINS, 0.1), Objective().score(MARGINS))


def test_the_sharper_the_likeness_the_less_it_matters_how_much_is_missing():
    slight, severe = np.array([1.9, 2.0]), np.array([0.0, 2.0])

    def ratio(sharp):
        return Objective(2.0).smooth(severe, sharp) / Objective(2.0).smooth(slight, sharp)

    assert ratio(0.1) > ratio(0.004) > 1


@pytest.mark.parametrize("force", [0.0, -1.0, np.nan, np.inf])
def test_a_force_that_is_none_is_refused(force):
    with pytest.raises(ShapeError, match="give a force in N above zero"):
        Objective(force)
