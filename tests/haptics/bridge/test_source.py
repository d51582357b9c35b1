"""How what is in the mailbox becomes a demand."""

import time
from dataclasses import replace

import numpy as np
import pytest
from runs import cycles, four

from tensionlab.demand import Demand, Pose
from tensionlab.haptics.bridge.mailbox import Mailbox
from tensionlab.haptics.bridge.messages import Frame
from tensionlab.haptics.bridge.source import BridgedDemand, FreeEffects
from tensionlab.haptics.effects import Vibration, Viscous
from tensionlab.haptics.rendering import Renderer
from tensionlab.haptics.scenarios import ScenarioDemand, load_scenario

RIG = four()


class Shares:
    """Keeps the share of each cycle."""

    def __init__(self, rig):
        self.renderer, self.found = Renderer(rig), []

    def __call__(self, state, over, share):
        self.found.append(share)
        return Demand()


def frame(effects=None):
    return Frame.model_validate({"time": 0.0, "bodies": {"hand": {"position": [0, 0.31, 0]}}, "effects": effects})


def test_the_force_comes_and_goes_with_the_frames():
    box = Mailbox(RIG)
    inner = Shares(RIG)
    demand = BridgedDemand(box, inner)
    states = [cycle.state for cycle in cycles(RIG, 40)]
    demand(states[0])
    assert inner.found == [0.0]
    box.put(frame(), time.monotonic())
    for state in states[1:10]:
        demand(state)
    assert (np.diff(inner.found) >= 0.0).all()
    assert inner.found[4] == pytest.approx(0.55, abs=0.05)  # 80 of 150 ms, smoothly
    assert inner.found[-1] == 1.0
    time.sleep(0.26)
    demand(states[10])
    assert inner.found[-1] == 0.0
    assert not demand(states[11]).stop
    box.stop_wanted = True
    assert demand(states[12]).stop


def test_the_hand_is_where_the_client_says_or_else_the_cables():
    box = Mailbox(RIG)
    free = FreeEffects(RIG, box)
    spring = {"spring": {"kind": "spring", "centre": [0.0, 0.41, 0.0], "stiffness": 3.0}}
    state = replace(next(cycles(RIG, 2)).state, pose=Pose(np.array([0.0, 0.36, 0.0])))
    box.put(Frame.model_validate({"time": 0.0, "effects": spring}), time.monotonic())
    assert free(state, box.effects, 1.0).impedances["top"].rest == pytest.approx(state.lengths[3] - 0.05, abs=1e-3)
    box.put(frame(spring), time.monotonic())
    assert free(state, box.effects, 1.0).impedances["top"].rest == pytest.approx(state.lengths[3] - 0.10, abs=1e-3)


def test_a_clients_effects_take_the_place_of_the_scenarios_when_it_is_their_time():
    scenario = load_scenario("materials")
    told = []
    demand = ScenarioDemand(scenario, lambda *news: told.append(news), repeat=True)
    state = next(cycles(scenario.rig, 2)).state
    over = {"hum": Vibration(amplitude=0.1), "mine": Viscous(1.0)}
    hum = next(phase for phase in scenario.phases if "hum" in phase.effects)
    for begin in (0.0, 3 * scenario.seconds):
        then = replace(state, time=begin + 0.5 * (hum.begin + hum.end))
        amplitudes = [each.amplitude for each in demand(then).impedances.values()]
        assert amplitudes == [pytest.approx(hum.effects["hum"].amplitude, rel=0.2)]
        amplitudes = [each.amplitude for each in demand(then, over).impedances.values()]
        assert amplitudes == [pytest.approx(0.1, rel=0.2)]
        assert not demand(then, over, 0.0).impedances
        # In another phase there is none of it, but what is no scenario's own is felt.
        before = replace(state, time=begin + 1.0)
        assert all(each.amplitude == 0.0 for each in demand(before, over).impedances.values())
    assert told.count(("phase", hum.name)) == 2


def test_a_hand_that_is_put_elsewhere_has_no_speed():
    scenario = load_scenario("materials")
    demand = ScenarioDemand(scenario)
    state = replace(next(cycles(scenario.rig, 2)).state, pose=Pose(np.array([0.0, 0.0, 1.15])))
    demand(replace(state, time=1.0))
    there = replace(state, time=1.01, pose=Pose(np.array([0.0, 0.0, 1.05])))
    wrench = demand(there).wrench
    assert np.linalg.norm(wrench) < 4.0  # a magnet's pull; its damper would have made 10 N of it
