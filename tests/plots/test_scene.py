import numpy as np
import pytest
from matplotlib.figure import Figure

from tensionlab.plots.scene import draw_person
from tensionlab.scenarios.scenery import JOINT_HEIGHTS_M, LIMB_M, SHOULDER_M


def drawn(*places, feet=(0.0, 0.0, 0.0)):
    """The lines of a person, in the world: nothing is projected."""
    lines = []
    axes = Figure().subplots()

    def view(points):
        lines.append(points)
        return points[..., :2]

    draw_person(axes, view, 2, np.array(feet), places)
    return lines[:-1], lines[-1]  # the last is the head


@pytest.mark.parametrize("hand", [(0.5, 0.1, 1.2), (0.3, -0.2, 1.0)])
def test_an_arm_ends_where_the_hand_is_and_is_as_long_as_arms_are(hand):
    lines, _ = drawn(("draw hand", np.array(hand)))
    (arm,) = [line for line in lines if np.allclose(line[-1], hand)]
    np.testing.assert_allclose(np.linalg.norm(np.diff(arm, axis=0), axis=1), LIMB_M)
    assert arm[1][2] < (arm[0][2] + arm[2][2]) / 2  # the elbow hangs


def test_two_hands_are_those_of_two_arms():
    places = [("left hand", np.array([0.4, 0.3, 1.3])), ("right hand", np.array([0.4, -0.3, 1.3]))]
    lines, head = drawn(*places)
    for _, where in places:
        assert sum(np.allclose(line[-1], where) for line in lines) == 1
    assert head[2] == JOINT_HEIGHTS_M["head"]


def test_one_shoulder_is_that_of_its_side():
    where = np.array([0.02, -0.2, 1.42])
    lines, head = drawn(("shoulder", where), ("pistol hand", np.array([0.55, -0.2, 1.42])))
    assert sum(np.allclose(line[0], where) for line in lines) >= 1
    assert head[1] == pytest.approx(-0.2 + SHOULDER_M, abs=0.02)  # they turn a little towards the hand


def test_a_head_that_leans_takes_the_body_along():
    head, torso = np.array([0.3, 0.0, 1.65]), np.array([0.25, 0.0, 1.43])
    lines, there = drawn(("head", head), ("torso", torso))
    np.testing.assert_allclose(there, head)
    assert any(np.allclose(line[1], torso) and len(line) == 3 for line in lines)
