"""What clients receive of a run, by real cycles of a real rig."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from tensionlab.demand import Demand, EffectDemand, Impedance
from tensionlab.haptics.bridge.events import RunEvents
from tensionlab.haptics.bridge.messages import KINDS
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.hardware.protocol.codes import BrakeState, Limit
from tests.helpers.runs import cycles, four

RIG = four()
FORCE = Demand(np.array([0.0, 1.0, 0.0]))


class Received:
    """Events that a client receives, and how many frames there have been."""

    def __init__(self):
        self.frames, self.events, self.renderer = 0, [], Renderer(RIG)
        names = ({int(each): each.name for each in kind} for kind in (Limit, BrakeState))
        self.run = RunEvents(RIG, *names, lambda: self.frames)
        self.run.send = self.events.append

    def take(self, state, demand=FORCE, share=1.0):
        self.run.take(state, demand, share, self.renderer)

    def of(self, kind):
        return [event for event in self.events if event.kind == kind]


def states(count):
    """At 50 Hz; all is well."""
    for cycle in islice(cycles(RIG, count + 1), count):
        yield replace(cycle.state, limiters=np.zeros(RIG.m, dtype=np.int64))


def test_rates_are_sent_once_a_second_as_numbers():
    received = Received()
    for state in states(160):
        received.frames += 2 if state.cycle % 10 else 0
        late = 0.013 if state.cycle == 70 else 0.0
        received.take(replace(state, time=state.time + late))
    found = received.of("rate")
    assert [event.time for event in found] == pytest.approx([1.0, 2.0, 3.0])
    assert [event.cycles for event in found] == pytest.approx([50.0] * 3)
    assert [event.gap for event in found] == pytest.approx([0.02, 0.033, 0.02])
    assert [event.frames for event in found] == pytest.approx([90.0] * 3)


def test_a_ceiling_that_moves_by_a_quarter_is_sent():
    received = Received()
    for state, ceiling in zip(states(6), (4.0, 33.0, 33.0, 40.0, 26.0, 24.0), strict=True):
        received.renderer.ceiling, received.renderer.delay = ceiling, 1.0 / ceiling
        received.take(state)
    assert [event.ceiling for event in received.of("ceiling")] == [4.0, 33.0, 24.0]
    assert received.of("ceiling")[1].delay == pytest.approx(1.0 / 33.0)


def test_an_effect_that_is_rendered_softer_is_named_as_it_begins_and_ends():
    received = Received()
    for state in states(160):
        there = state.cycle < 60 or state.cycle >= 130
        floor = EffectDemand(np.zeros(3), 300.0, softened={"stiffness": (300.0, 14.0)} if there else {})
        received.take(state, replace(FORCE, effects={"floor": floor}))
    found = received.of("stiff")
    assert [event.time for event in found] == pytest.approx([0.0, 2.18, 2.6])
    assert (found[0].effect, found[0].stiffness, found[0].ceiling) == ("floor", 300.0, 14.0)
    assert found[0].text == '"floor": stiffness is 300 N/m, 14 are rendered'
    assert found[1].text == '"floor": stiffness is 300 N/m again, as desired'
    assert received.run.state(1).softened == {"floor": {"stiffness": 14.0}}


def test_the_state_says_what_a_person_would_notice():
    """All cables pull as desired, but with half of the force."""
    received = Received()
    for state in states(100):
        pull = 2.0 * (state.structure @ np.nan_to_num(state.tensions))
        received.take(state, Demand(pull, effects={"push": EffectDemand(pull)}))
    said = received.run.state(1)
    assert said.fidelity["push"]["force_rendered"] == pytest.approx(0.5 * said.fidelity["push"]["force"])
    assert said.noticed["push"][0].startswith(f"{said.fidelity['push']['force_rendered']:.2f} of ")
    assert received.run.state(2).fidelity is not None


def test_the_state_has_brakes_and_who_renders():
    received = Received()
    nothing = received.run.state(3)
    assert (nothing.sequence, nothing.brakes, nothing.ceiling) == (3, ["UNKNOWN"] * 4, 0.0)
    first, second = states(2)
    received.take(first)
    assert received.run.state(4).brakes == ["UNKNOWN"] * 4
    demand = Demand(np.zeros(3), {"top": Impedance(1.0, 50.0)}, frozenset({"floor-2"}))
    brakes = np.array([BrakeState.OPEN, BrakeState.CLOSED, BrakeState.OPEN, BrakeState.OPENING])
    received.renderer.ceiling, received.renderer.delay = 20.0, 0.04
    received.take(replace(second, brakes=brakes), demand)
    said = received.run.state(5)
    assert said.brakes == ["OPEN", "CLOSED", "OPEN", "OPENING"]
    assert said.braked == [False, True, False, False]
    assert said.rendering == [False, False, False, True]
    assert (said.ceiling, said.delay) == (20.0, 0.04)
    texts = {event.module: event.text for event in received.of("brake")}
    assert texts["floor-2"] == "its brake is CLOSED"


def test_what_changes_is_sent_of_the_module():
    received = Received()
    first, second, third = states(3)
    received.take(first)
    received.take(replace(second, limiters=np.array([0, Limit.UPPER, 0, 0]), faults=np.array([0, 0, 1, 0])))
    received.take(replace(third, active=np.array([False, True, True, True])))
    assert [event.module for event in received.of("limit")] == ["floor-2"]
    assert [event.module for event in received.of("fault")] == ["floor-3"]
    assert [event.module for event in received.of("lost")] == ["floor-1"]
    assert {event.kind for event in received.events} <= set(KINDS)


def test_a_limiter_that_comes_and_goes_is_told_when_it_begins_and_when_it_has_ended():
    received = Received()
    for state in states(200):
        limiters = np.zeros(RIG.m, dtype=np.int64)
        if state.cycle < 80 or state.cycle >= 180:
            limiters[3] = (Limit.SLEW, Limit.NONE, Limit.UPPER)[state.cycle % 3]
        received.take(replace(state, limiters=limiters))
    assert [(round(event.time, 2), event.text) for event in received.of("limit")] == [
        (0.0, "limited by: SLEW"),
        (0.04, "limited by: UPPER"),
        (2.54, "no longer limited by: UPPER"),
        (2.56, "no longer limited by: SLEW"),
        (3.6, "limited by: SLEW"),
        (3.64, "limited by: UPPER"),
    ]


def test_a_module_that_may_not_pull_as_hard_is_sent_and_when_it_may_again():
    received = Received()
    whole = RIG.limits.upper
    for state, top in zip(states(6), (6.0, 5.8, 5.4, 5.2, 4.9, 6.0), strict=True):
        received.take(replace(state, upper_now=np.array([*whole[:3], top])))
    found = received.of("derated")
    assert [(event.module, event.upper) for event in found] == [("top", 5.4), ("top", 4.9), ("top", 6.0)]
    assert found[0].text == "pulls with up to 5.40 N of 6 N, to stay cool enough"
