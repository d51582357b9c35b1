"""What brakes are to hold against."""

import numpy as np
import pytest

from tensionlab.errors import ScenarioError
from tensionlab.haptics.effects import Plane
from tensionlab.scenarios import Hold


def test_a_plane_is_as_far_as_it_is():
    hold = Hold(40.0, plane=Plane(point=(0.3, 0.0, 0.0), normal=(-2.0, 0.0, 0.0)))
    wall = hold.wall(np.array([0.1, 5.0, 5.0]))
    assert wall.normal == pytest.approx([-1.0, 0.0, 0.0])
    assert wall.distance == pytest.approx(0.2)
    assert wall.force == 40.0


def test_the_end_of_a_reach_is_a_wall_across_it():
    wall = Hold(50.0, reach=0.8).wall(np.array([0.0, -0.6, 0.0]))
    assert wall.normal == pytest.approx([0.0, 1.0, 0.0])
    assert wall.distance == pytest.approx(0.2)


def test_a_late_loop_locks_sooner():
    hold = Hold(50.0, reach=0.8)
    assert hold.late_by(0.03).latency == pytest.approx(hold.timing.latency + 0.03)
    assert hold.late_by(0.03).slack == hold.timing.slack


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Hold(1.0), "a plane or a reach"),
        (lambda: Hold(1.0, plane=Plane(), reach=1.0), "a plane or a reach"),
        (lambda: Hold(1.0, reach=0.0), "reach is 0.0"),
        (lambda: Hold(0.0, reach=1.0), "force is 0.0"),
    ],
)
def test_what_cannot_be_is_refused(make, said):
    with pytest.raises(ScenarioError, match=said):
        make()
