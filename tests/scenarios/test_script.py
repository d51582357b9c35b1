"""Where somebody means to be."""

import numpy as np
import pytest

from tensionlab.errors import ScenarioError
from tensionlab.scenarios import Script, Sway, Waypoint


@pytest.fixture
def reach():
    return Script((Waypoint(1.0, (0.0, 0.0)), Waypoint(3.0, (0.4, -0.2))))


def test_it_is_at_its_waypoints_and_stays_at_the_last(reach):
    start, middle, end = (0.0, 0.0), (0.2, -0.1), (0.4, -0.2)
    for time, place in ((0.0, start), (1.0, start), (2.0, middle), (3.0, end), (9.0, end)):
        assert reach.position(time) == pytest.approx(place)


def test_it_goes_from_rest_to_rest_with_the_least_jerk(reach):
    """The way of least jerk is fastest in the middle, 1.875 times as fast as on average, and begins at rest."""
    time = np.linspace(1.0, 3.0, 2001)
    place = np.array([reach.position(each)[0] for each in time])
    speed = np.gradient(place, time)
    assert speed.max() == pytest.approx(1.875 * 0.4 / 2.0, rel=1e-4)
    assert np.argmax(speed) == 1000
    assert speed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-5)
    acceleration = np.gradient(speed, time)
    assert np.abs(acceleration).max() == pytest.approx(5.7735 * 0.4 / 2.0**2, rel=1e-2)


def test_it_sways_from_the_beginning_on():
    script = Script((Waypoint(0.0, (1.0, 2.0, 3.0)),), Sway((0.01, 0.02, 0.0), 0.5))
    assert script.position(0.0) == pytest.approx([1.0, 2.0, 3.0])
    places = np.array([script.position(time) for time in np.arange(0.0, 60.0, 0.01)])
    assert np.ptp(places, axis=0) == pytest.approx([0.02, 0.04, 0.0], rel=1e-2)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Script(()), "no waypoints"),
        (lambda: Script((Waypoint(1.0, (0.0,)), Waypoint(1.0, (1.0,)))), "each later than the last"),
        (lambda: Script((Waypoint(float("nan"), (0.0,)),)), "finite"),
        (lambda: Script((Waypoint(0.0, (0.0, 0.0)), Waypoint(1.0, (1.0,)))), "same number"),
        (lambda: Script((Waypoint(0.0, (0.0, 0.0)),), Sway((0.1,))), "same number"),
        (lambda: Script((Waypoint(0.0, (float("inf"), 0.0)),)), "finite"),
    ],
)
def test_what_cannot_be_is_refused(make, said):
    with pytest.raises(ScenarioError, match=said):
        make()
