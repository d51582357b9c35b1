"""How what a client sends becomes a demand."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tensionlab.demand import Demand, Pose
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.events import RunEvents
from tensionlab.haptics.bridge.messages import Frame
from tensionlab.haptics.bridge.source import BridgedDemand, FreeEffects
from tensionlab.haptics.effects import Vibration, Viscous
from tensionlab.haptics.effects.effect import Rendered
from tensionlab.haptics.rendering.assignment import EffectFailed
from tensionlab.haptics.rendering.renderer import Renderer
from tensionlab.hardware.protocol.codes import Limit
from tensionlab.scenarios import ScenarioDemand, load_scenario
from tests.helpers.runs import cycles, four

RIG = four()


@dataclass
class Clock:
    """Simulated clock: it stands until a test moves it."""

    now: float = 100.0

    def __call__(self):
        return self.now


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
    box = ClientState(RIG, Clock())
    inner = Shares(RIG)
    demand = BridgedDemand(box, inner)
    states = [cycle.state for cycle in cycles(RIG, 40)]
    demand(states[0])
    assert inner.found == [0.0]
    box.put(frame(), box.clock())
    for state in states[1:10]:
        demand(state)
    assert (np.diff(inner.found) >= 0.0).all()
    assert inner.found[4] == pytest.approx(0.55, abs=0.05)  # 80 of 150 ms, smoothly
    assert inner.found[-1] == 1.0
    box.clock.now += 0.26
    demand(states[10])
    assert inner.found[-1] == 0.0
    assert not demand(states[11]).stop
    box.stop_requested = True
    assert demand(states[12]).stop


def test_the_hand_is_where_the_client_says_or_else_the_cables():
    box = ClientState(RIG, Clock())
    free = FreeEffects(box)
    spring = {"spring": {"kind": "spring", "centre": [0.0, 0.41, 0.0], "stiffness": 3.0}}
    state = replace(next(cycles(RIG, 2)).state, pose=Pose(np.array([0.0, 0.36, 0.0])))
    box.put(Frame.model_validate({"time": 0.0, "effects": spring}), box.clock())
    assert free(state, box.effects, 1.0).impedances["top"].rest == pytest.approx(state.lengths[3] - 0.05, abs=1e-3)
    box.put(frame(spring), box.clock())
    assert free(state, box.effects, 1.0).impedances["top"].rest == pytest.approx(state.lengths[3] - 0.10, abs=1e-3)


def test_a_clients_effects_take_the_place_of_the_scenarios_when_it_is_their_time():
    scenario = load_scenario("materials")
    events = []
    demand = ScenarioDemand(scenario, lambda *event: events.append(event), repeat=True)
    state = next(cycles(scenario.rig, 2)).state
    over = {"hum": Vibration(amplitude=0.1), "mine": Viscous(1.0)}
    hum = next(phase for phase in scenario.phases if "hum" in phase.effects)
    modules = {module.name: module for module in scenario.rig.modules}
    for begin in (0.0, 3 * scenario.seconds):
        then = replace(state, time=begin + 0.5 * (hum.begin + hum.end))
        for effects, desired in (({}, hum.effects["hum"]), (over, over["hum"])):
            for name, found in demand(then, effects).impedances.items():
                most = 60.0 / (2.0 * np.pi * found.frequency)  # at the slew-rate limit of the modules
                expected = min(desired.amplitude / modules[name].gain_at(found.frequency), most)
                assert found.amplitude == pytest.approx(expected, rel=0.2)
        assert not demand(then, over, 0.0).impedances
        # In another phase there is none of it, but what is no scenario's own is rendered.
        before = replace(state, time=begin + 1.0)
        assert all(each.amplitude == 0.0 for each in demand(before, over).impedances.values())
    assert events.count(("phase", hum.name)) == 2


def test_a_hand_that_is_put_elsewhere_has_no_speed():
    scenario = load_scenario("materials")
    demand = ScenarioDemand(scenario)
    state = replace(next(cycles(scenario.rig, 2)).state, pose=Pose(np.array([0.0, 0.0, 1.15])))
    demand(replace(state, time=1.0))
    there = replace(state, time=1.01, pose=Pose(np.array([0.0, 0.0, 1.05])))
    wrench = demand(there).wrench
    assert np.linalg.norm(wrench) < 4.0  # a magnet's pull; its damper would have made 10 N of it


@dataclass(frozen=True)
class Faulty:
    """An effect that pulls up with 2 N for 20 cycles; then it is at fault, in one way or another."""

    then: object
    count: list

    def render(self, motion, memory=None):
        self.count.append(1)
        if len(self.count) > 20:
            if isinstance(self.then, Exception):
                raise self.then
            return Rendered(np.array(self.then))
        return Rendered(np.array([0.0, 2.0, 0.0]))


@pytest.mark.parametrize(
    ("then", "why"),
    [
        (ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero"),
        ([0.0, np.nan, 0.0], "its force is not finite"),
        ([0.0, 1.0], "ValueError"),
        ([0.0, 1e300, 0.0], None),
    ],
)
def test_a_clients_effect_that_fails_is_removed_its_force_fades_and_the_client_is_dismissed(then, why, caplog):
    box, reasons, events = ClientState(RIG, Clock()), [], []
    client = box.command.take("client", box.clock(), reasons.append)
    news = RunEvents(RIG, {int(each): each.name for each in Limit}, {}, lambda: 0)
    news.send = events.append
    demand = BridgedDemand(box, FreeEffects(box), news)
    forces = []
    for cycle in cycles(RIG, 40):
        if not client.dismissed:
            box.put(frame(), box.clock(), client)
            box._effects = {"bad": Faulty(then, demand.__dict__.setdefault("count", []))}
        wrench = demand(replace(cycle.state, lengths=RIG.lengths(RIG.home))).wrench
        forces.append(0.0 if wrench is None else wrench[1])
    assert forces[19] == pytest.approx(2.0)
    assert np.abs(np.diff(forces)).max() <= 200.0 / 50 + 1e-9, "as fast as the slew, and no faster"
    if why is None:
        assert max(forces) <= 2.0 * RIG.limits.upper.sum() + 1e-9, (
            "no more than twice what all cables together pull"
        )
        return
    assert forces[-1] == 0.0
    assert not box.effects
    assert client.dismissed.startswith("the effects are removed: effect 'bad' failed: ")
    assert why in client.dismissed
    assert reasons == [client.dismissed]
    assert "removed" in [event.kind for event in events]
    assert ("Error" in why) == bool(caplog.records), "the traceback of what is not by its parameters"


def test_a_scenarios_own_effect_that_fails_ends_the_run_in_words():
    scenario = load_scenario("materials")
    phase = replace(scenario.phases[0], effects={"bad": Faulty(RuntimeError("no way"), [1] * 99)})
    box = ClientState(scenario.rig, Clock())
    client = box.command.take("client", box.clock(), print)
    demand = BridgedDemand(box, ScenarioDemand(replace(scenario, phases=(phase,))))
    box.put(Frame.model_validate({"time": 0.0, "effects": {"mine": {"kind": "viscous"}}}), box.clock(), client)
    with pytest.raises(EffectFailed, match="effect 'bad' failed: RuntimeError: no way"):
        demand(next(cycles(scenario.rig, 2)).state)
    assert not client.dismissed


def test_far_from_a_wall_no_module_is_commanded_what_it_would_refuse():
    box = ClientState(RIG, Clock())
    free = FreeEffects(box)
    floor = {"kind": "wall", "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}}
    state = next(cycles(RIG, 2)).state
    for height in (0.1, 2.0, 90.0):
        there = {"hand": {"position": [0.0, height, 0.0]}}
        box.put(Frame.model_validate({"time": 0.0, "bodies": there, "effects": {"a": floor}}), box.clock())
        springs = free(state, box.effects, 1.0).impedances
        assert ("top" in springs) == (height == 0.1)
        assert all(spring.rest <= 5.0 and spring.feed_forward <= 6.0 for spring in springs.values())
