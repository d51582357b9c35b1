"""A share of `make hostile`, in this process: whatever is said, the next cycle is within limits."""

import os
import time

import numpy as np
import pytest

from tensionlab.errors import HardwareError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.messages import Refused, Welcome
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.server import Bridge, CommandConnection
from tensionlab.haptics.bridge.source import BridgedDemand, FreeEffects
from tensionlab.scenarios import ScenarioDemand, load_scenario
from tests.helpers.runs import cycles, four
from tests.stress.hostile_messages import datagrams, draw, texts

COUNT = int(os.environ.get("TENSIONLAB_HOSTILE", "150"))


def require_possible(demand, rig):
    """Refuse a demand that a module or the runner would not take."""
    if demand.wrench is not None:
        assert np.isfinite(demand.wrench).all()
        assert np.linalg.norm(demand.wrench) <= 2.0 * rig.limits.upper.sum() + 1e-9
    for spring in demand.impedances.values():
        assert 0.0 <= spring.rest <= 5.0
        assert 0.0 <= spring.stiffness <= 500.0
        assert 0.0 <= spring.damping <= 10.0
        assert 0.0 <= spring.feed_forward <= rig.limits.upper.min()
        assert 0.0 <= spring.amplitude <= rig.limits.upper.min()
        assert 0.0 <= spring.frequency <= 500.0


def bridge_of(rig, box, port=0):
    welcome = Welcome(rig=rig.name, modules=[], upper=[], scenario=None, bodies=[], rate=50.0, timeout=0.25)
    return Bridge(box, welcome, lambda number: number, port=port)


def test_a_bridge_listens_and_no_other_can_listen_there():
    rig = four()
    with bridge_of(rig, ClientState(rig)) as first:
        port = int(first.url.rpartition(":")[2])
        with pytest.raises(HardwareError, match=f"{port}: Address already in use"):
            bridge_of(rig, ClientState(rig), port).__enter__()


@pytest.mark.parametrize("name", ["rig", "materials"])
def test_whatever_is_said_is_answered_and_the_loop_goes_on_within_limits(name):
    scenario = None if name == "rig" else load_scenario(name)
    rig = four() if scenario is None else scenario.rig
    box, answers = ClientState(rig), []
    bridge = bridge_of(rig, box)
    inner = FreeEffects(box) if scenario is None else ScenarioDemand(scenario, repeat=True)
    demand = BridgedDemand(box, inner)
    box.dismiss = lambda reason: pytest.fail(f"an effect failed: {reason}")
    states = [cycle.state for cycle in cycles(rig, 2 * COUNT)]
    names, home = ["hand", *rig.frames], rig.home.tolist()

    def cycle(number):
        require_possible(demand(states[number]), rig)

    connected = CommandConnection(None, box.command.take("JSON", time.perf_counter(), pytest.fail))
    for number, text in enumerate(draw(texts(rig.dimension, names, home), COUNT, 1)):
        answers.append(bridge._answer(text, connected))
        cycle(number)
    box.command.leave(connected.commander)
    refused = [answer for answer in answers if isinstance(answer, Refused)]
    assert all(0 < len(answer.reason) <= 300 for answer in refused)
    assert len(answers) // 10 < len(refused) < len(answers) * 19 // 20
    said = []
    door = OscServer(box, "127.0.0.1", 0, said.append)
    before = box.count
    for number, data in enumerate(draw(datagrams(rig.dimension, names, home), COUNT, 2)):
        door._take(data, "127.0.0.1", time.perf_counter())
        cycle(COUNT + number)
    door._socket.close()
    assert box.count > before
    assert said
    assert not box.stop_requested
