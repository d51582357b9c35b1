"""Simulated person held by the cables: Newton's law, and the springs of an arm."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import ScenarioError
from tensionlab.scenarios import Person, PersonPlan, Script, Sway, Waypoint


@pytest.fixture
def rig():
    return tl.load_rig("datasets/rigs/bartels2026-validation.toml")


def still(rig, **how):
    how = {"mass": 1.0, "stiffness": 200.0, "damping": 20.0} | how
    return Person(PersonPlan(**how, script=Script((Waypoint(0.0, tuple(rig.home)),))), rig)


def tensions_of(rig, person, force):
    return tl.allocate(rig.structure_matrix(*person.pose), force, rig.limits).tensions


def pull(rig, person, force, seconds):
    """Have the cables render a force for some time from the beginning on."""
    person.begin()
    for time in np.arange(0.001, seconds, 0.001):
        person.apply_tensions(tensions_of(rig, person, force))
        person(time)


def test_a_steady_force_moves_it_by_force_over_stiffness(rig):
    person, force = still(rig), np.array([0.5, 0.0, -1.0])
    pull(rig, person, force, 2.0)
    assert person.pose.position - rig.home == pytest.approx(force / 200.0, abs=1e-6)
    assert person.record.force[-1] == pytest.approx(force, abs=1e-9)


def test_the_cables_hold_what_the_rig_requires_of_what_weighs_on_the_hand(rig):
    load = tl.Requirement(wrench=[0.2, 0.0, 0.0], gravity=True)
    heavy = replace(rig, platform=tl.Platform(0.1), required=load)
    person = still(heavy)
    pull(heavy, person, load.middle(heavy), 1.0)
    assert person.pose.position == pytest.approx(rig.home, abs=1e-9)
    assert person.record.force[-1] == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_push_begins_with_force_over_mass(rig):
    person, force = still(rig, mass=2.0), np.array([0.0, 1.0, 0.0])
    pull(rig, person, force, 0.0105)
    assert (person.pose.position - rig.home)[1] == pytest.approx(0.5 * 0.5 * 0.01**2, rel=0.12)


def test_it_swings_with_its_own_frequency_and_loses_energy(rig):
    """Let go from a place where a force held it: sqrt(k/m), and each swing smaller."""
    person = still(rig, stiffness=200.0, damping=2.0)
    person.begin()
    force = np.array([0.0, 1.0, 0.0])
    for time in np.arange(0.001, 6.0, 0.001):
        pulls = tensions_of(rig, person, force) if time < 2.0 else np.zeros(rig.m)
        person.apply_tensions(pulls)
        person(time)
    felt = person.record
    swing = (felt.position - rig.home)[felt.time > 2.0, 1]
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    assert 2 * np.mean(np.diff(crossings)) * 1e-3 == pytest.approx(2 * np.pi / np.sqrt(200.0 - 1.0), rel=1e-2)
    peaks = np.array([np.abs(swing[a:b]).max() for a, b in itertools.pairwise(crossings)])
    assert (np.diff(peaks) < 0.0).all()


def test_it_stands_still_until_it_begins_and_its_script_begins_then():
    rig = tl.load_rig("datasets/rigs/body-mounted.toml")
    start = Waypoint(0.0, tuple(rig.home))
    step = Script((Waypoint(0.0, (0.0, 0.0, 0.0)), Waypoint(1.0, (0.1, 0.0, 0.0))))
    bodies = dict.fromkeys(rig.frames, step)
    person = Person(PersonPlan(1.0, 200.0, 20.0, Script((start,), Sway((0.01, 0.0, 0.0))), bodies), rig)
    person.apply_tensions(np.full(rig.m, 6.0))
    person(5.0)
    assert person.pose.position == pytest.approx(rig.home)
    assert len(person.record.time) == 0
    person.begin()
    person(5.5)
    person.begin()  # again: no restart
    person(6.5)
    assert person.pose.frames["shoulder"][0] == pytest.approx([0.1, 0.0, 0.0])
    assert person.record.time[[0, -1]] == pytest.approx([0.001, 1.5])
    assert person.record.tensions.shape == (1500, rig.m)


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
        (lambda: Script((Waypoint(0.0, (0.0, 0.0)),), Sway((0.1,))), "same number"),
    ],
)
def test_what_cannot_be_is_refused(make, said):
    with pytest.raises(ScenarioError, match=said):
        make()
