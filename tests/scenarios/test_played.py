"""The scenarios render what is expected, on simulated modules with a simulated person."""

from __future__ import annotations

import numpy as np
import pytest

from tensionlab.haptics.effects import Bow, Recoil, Texture, Vibration, Weight
from tensionlab.haptics.effects.effect import Motion
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.module import WORLD
from tensionlab.scenarios import SCENARIOS, load_scenario
from tensionlab.scenarios.fidelity import between, rendered_force, scenario_fidelity
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.support.arrays import angles
from tests.helpers.examples import PROFILE

WALL = 0.30
# When it has begun to lean, when it turns back, and when it comes again: as in the file, in s.
LEANS, TURNS, RUNS = 3.2, 4.2, 5.4
PARTS = {"materials": 11.6, "collision": 6.4}  # duration in s, where the rest shows nothing that is expected here


# Which scenarios, and how long their links take, in s. `test_tracked.py` has all without a delay.
PLAYED = [(name, 0.02) for name in SCENARIOS] + [("collision", 0.0)]
if PROFILE == "nightly":
    PLAYED = [(name, delay) for name in SCENARIOS for delay in (0.0, 0.02)]


def decided(played):
    return [(event.time, event.text) for event in played.run.events if event.kind == "brake"]


def the_motors_warn_before_the_brakes_hold(played):
    locked = next(time for time, text in decided(played) if text.startswith("locked"))
    before = played.person.force[played.person.time < locked]
    assert np.linalg.norm(before, axis=1).max() < 2.5
    assert -before[-1, 0] > 1.8
    assert -before[:1500, 0].mean() < 1.4  # of taut cables, while it is far


def the_head_is_stopped_at_the_wall_and_held_while_it_leans(played):
    person = played.person
    leaning = (person.time > LEANS) & (person.time < TURNS)
    push = -person.force[leaning, 0]
    assert push.min() > 30.0
    assert push.max() < 40.0
    assert np.abs(person.force[leaning, 1:]).max() < 0.1 * push.min()
    reached = person.position[person.time < TURNS, 0].max()
    assert -0.012 < reached - WALL < 0.005
    assert np.ptp(person.position[leaning, 0]) < 0.001


def it_withdraws_freely(played):
    person, upper = played.person, played.scenario.rig.limits.upper
    leant = person.position[(person.time > LEANS) & (person.time < TURNS), 0].mean()
    back = person.time[(person.time > TURNS) & (person.position[:, 0] < leant - 0.002)][0]
    after = (person.time > back + 0.2) & (person.time < RUNS)
    assert (person.tensions[after] <= upper).all()
    assert person.position[after, 0].min() < 0.05


def what_is_too_fast_is_refused_with_a_reason(played):
    second = [text for time, text in decided(played) if time > RUNS]
    assert second[0] == "too fast"
    fast = played.person.time > RUNS
    assert played.person.position[fast, 0].max() > WALL + 0.1
    assert np.linalg.norm(played.person.force[fast], axis=1).max() < 10.0


def the_force_on_a_head_stays_below_60_newtons(played):
    assert np.linalg.norm(played.person.force, axis=1).max() < 60.0


def effect_of(played, kind):
    """Return the first effect of a kind, and the rendered force in its phase."""
    phases = [(phase, each) for phase in played.scenario.phases for each in phase.effects.values()]
    phase, effect = next((phase, each) for phase, each in phases if isinstance(each, kind))
    return effect, rendered_force(played).during(phase.begin + 0.3, phase.end)


def locked_from_to(played):
    locked = played.run.time[played.run.commanded_brakes.any(axis=1)]
    return float(locked[0]), float(locked[-1])


def a_shot_has_its_impulse_and_direction(played):
    pistol, _ = effect_of(played, Recoil)
    rendered, way = rendered_force(played), np.array(pistol.direction) / np.linalg.norm(pistol.direction)
    for shot, following in zip(pistol.shots, [*pistol.shots[1:], 5.0], strict=True):
        taut = rendered.during(shot - 0.1, shot).force.mean(axis=0)
        after = rendered.during(shot, min(shot + 0.3, following))
        along = after.force @ way
        desired = pistol.render(Motion(after.position, 0.0 * after.position, after.time)).force @ way
        impulses = [np.trapezoid(np.maximum(each - taut @ way, 0.0), after.time) for each in (along, desired)]
        assert 0.7 < impulses[0] / impulses[1] < 1.15
        assert 0.5 * pistol.peak < (along - taut @ way).max() < 1.1 * pistol.peak
        assert angles(way[None], after.force[[along.argmax()]] - taut)[0] < 45.0


def a_held_weight_pulls_and_a_box_on_brakes_stays_down(played):
    held, _ = effect_of(played, Weight)
    rendered, path = rendered_force(played), played.scenario.person.script.waypoints
    down, (begin, end) = np.array(held.gravity) / np.linalg.norm(held.gravity), locked_from_to(played)
    pull = rendered.force @ down
    rest = between(rendered.time, path[1].time + 0.3, path[2].time)
    assert pull[rest].mean() == pytest.approx(held.mass * np.linalg.norm(held.gravity), rel=0.07)
    box = between(rendered.time, begin + 0.1, end)
    assert 40.0 < pull[box].max() < 70.0
    assert np.ptp(rendered.position[box] @ down) < 0.02
    assert pull[rendered.time > end + 0.2].max() < 8.0


def a_drawn_string_stores_its_work_and_stops_the_hand(played):
    string, _ = effect_of(played, Bow)
    rendered, (begin, end) = rendered_force(played), locked_from_to(played)
    far = np.linalg.norm(rendered.position, axis=1)
    pull, draw = -np.vecdot(rendered.force, rendered.position) / far, np.maximum(far - string.brace, 0.0)
    drawing, held = between(rendered.time, 0.3, begin), between(rendered.time, begin + 0.1, end)
    work, energy = (np.trapezoid(each[drawing], draw[drawing]) for each in (pull, string.pull(draw)))
    assert work == pytest.approx(energy, rel=0.07)
    assert 40.0 < pull[held].max() < 65.0
    assert np.ptp(far[held & (pull > string.most)]) < 0.025
    gone = rendered.time[(rendered.time > string.loosed) & (pull < string.slack + 2.0 * string.hum)]
    assert gone[0] - string.loosed < 0.04 + np.nanmax(played.run.delays)


def a_surface_rubs_and_a_vibration_hums(played):
    rough, rendered = effect_of(played, Texture)
    load = rendered.force @ rough.wall.plane.n
    across = np.array(rough.ripples.direction)
    x = rendered.position @ across
    slides = (load > 0.5) & (np.gradient(x, rendered.time) > 0.01)
    order = np.argsort(x[slides])
    friction = (-rendered.force @ across / np.where(slides, load, 1.0))[slides][order]
    mean = np.trapezoid(friction, x[slides][order]) / np.ptp(x[slides])
    assert mean == pytest.approx(rough.friction.dynamic, rel=0.25)
    hum, rendered = effect_of(played, Vibration)
    shaking = rendered.force @ (np.array(hum.axis) / np.linalg.norm(hum.axis))
    assert abs(20.0 * np.log10(np.sqrt(2.0) * np.std(shaking) / hum.amplitude)) < 2.0  # dB
    spectrum = abs(np.fft.rfft((shaking - shaking.mean()) * np.hanning(shaking.size)))
    assert spectrum.argmax() / np.ptp(rendered.time) == pytest.approx(hum.frequency, abs=1.0)
    assert played.person.tensions[np.isin(played.person.time, rendered.time)].min() > 0.01


EXPECTED = {
    "materials": (a_surface_rubs_and_a_vibration_hums,),
    "collision": (
        the_motors_warn_before_the_brakes_hold,
        the_head_is_stopped_at_the_wall_and_held_while_it_leans,
        it_withdraws_freely,
        what_is_too_fast_is_refused_with_a_reason,
        the_force_on_a_head_stays_below_60_newtons,
    ),
    "recoil": (a_shot_has_its_impulse_and_direction,),
    "weight": (a_held_weight_pulls_and_a_box_on_brakes_stays_down,),
    "bow": (a_drawn_string_stores_its_work_and_stops_the_hand,),
}


def test_all_cables_together_cannot_reach_60_newtons():
    modules = load_scenario("collision").rig.modules
    assert sum(module.upper + (module.brake or 0.0) for module in modules) < 60.0 - 2.0


def test_no_brake_rides_on_the_body():
    modules = load_scenario("collision").rig.modules
    assert {module.name for module in modules if module.brake} == {"left-post", "right-post"}
    assert {module.frame for module in modules if module.brake} == {WORLD}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "delay"), PLAYED)
def test_a_scenario_is_as_expected_even_over_a_slow_link(name, delay):
    scenario = load_scenario(name)
    modules = simulate_modules(scenario, Conditions(delay) if delay else None)
    played = play(scenario, modules, seconds=PARTS.get(name))
    modules.group.close()
    assert played.statistics.ended == "duration reached"
    assert not played.statistics.lost
    for holds in EXPECTED[name]:
        holds(played)
    if not delay:  # a late loop is told, and is no failure of the scenario
        assert all(each.passed is not False for each in scenario_fidelity(played).values())
