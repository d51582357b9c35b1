"""Motions of a simulated platform."""

import numpy as np

from tensionlab.demand import Pose
from tensionlab.hardware.simulation.motions import FASTEST, GuidedHand


def test_a_leap_becomes_a_movement_of_a_hand():
    places = np.array([[0.0, 0.0, 0.0], [0.3, -0.1, 0.0]])
    hand = GuidedHand(lambda time: Pose(places[int(time > 0.1)]))
    path = np.array([hand(0.005 * step).position for step in range(200)])
    speeds = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.005
    np.testing.assert_array_equal(path[:20], 0.0)
    assert 0.9 < speeds.max() <= FASTEST + 1e-9
    np.testing.assert_allclose(path[-1], places[1], atol=1e-4)
    assert (path[:, 0] <= 0.3 + 1e-3).all()


def test_bodies_are_followed_as_well():
    where = {"hip": (np.zeros(3), None)}
    hand = GuidedHand(lambda time: Pose(np.zeros(3), frames=where))
    hand(0.0)
    where["hip"] = (np.array([0.1, 0.0, 0.0]), None)
    assert 0.0 < hand(0.02).frames["hip"][0][0] < 0.05
    assert abs(hand(1.0).frames["hip"][0][0] - 0.1) < 1e-6
