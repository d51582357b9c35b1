"""Stick figure of a person, whichever axis is up; `tests/plots/test_scene.py` has its parts."""

import numpy as np

from tensionlab.scenarios.stick_figure import JOINT_HEIGHTS_M, stick_figure


def test_it_stands_along_any_axis():
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # z becomes y
    feet, hand = np.array([0.1, 0.2, 0.0]), np.array([0.6, 0.1, 1.2])
    one = stick_figure(feet, np.array([0.0, 0.0, 1.0]), [("hand", hand)])
    other = stick_figure(turn @ feet, turn @ [0.0, 0.0, 1.0], [("hand", turn @ hand)])
    np.testing.assert_allclose(other.head, turn @ one.head)
    for line, same in zip(one.lines, other.lines, strict=True):
        np.testing.assert_allclose(same, line @ turn.T)


def test_a_person_of_whom_nothing_is_known_stands_upright():
    figure = stick_figure(np.zeros(3), np.array([0.0, 1.0, 0.0]), [])
    assert figure.head.tolist() == [0.0, JOINT_HEIGHTS_M["head"], 0.0]
