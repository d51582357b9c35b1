"""Groups of modules: connected, prepared, armed, stopped and closed together."""

from operator import methodcaller
from unittest.mock import Mock

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.client import group
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Code, State, Type
from tensionlab.hardware.protocol.messages import Acknowledge, Decoder
from tensionlab.hardware.simulation.links import Conditions, SimulatedLink
from tensionlab.hardware.simulation.world import World
from tests.helpers.breakable import BreakableLink

# Arming, stopping and closing together. The modules are in this process, and so is their time.

RIG = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
NAMES = [module.name for module in RIG.modules]
WANTED = ", but the rig wants 0.5 to 6 N"


class Modules:
    """Modules of the published rig behind faulty links."""

    def __init__(self, conditions=None):
        self.world = World(RIG)
        self.links = {
            name: BreakableLink(SimulatedLink(module), conditions, seed=3)
            for name, module in zip(NAMES, self.world.modules, strict=True)
        }
        self.group = connect(RIG, self.links)

    @property
    def states(self):
        return [module.sample.state for module in self.world.modules]

    def pull(self):
        self.world.advance(10.0)  # links do not count time from the begin of a command
        self.group.arm([1.0] * RIG.m)
        for client in self.group.clients:
            client.set_tension(2.0)
            client.listen(0.02)
        assert self.states == [State.RUNNING] * RIG.m
        return self


@pytest.mark.parametrize(
    ("command", "state"), [(ModuleGroup.stop, State.IDLE), (ModuleGroup.emergency_stop, State.ESTOP)]
)
@pytest.mark.parametrize("conditions", [None, Conditions(latency=0.02, drop=0.002)])
def test_a_stop_reaches_all_modules_over_links_that_lose_much(command, state, conditions):
    modules = Modules(conditions).pull()
    assert command(modules.group) == {}
    assert modules.states == [state] * RIG.m


@pytest.mark.parametrize("trouble", [BreakableLink.cut, BreakableLink.freeze])
def test_those_that_do_not_confirm_a_stop_are_named_and_the_others_stop_first(trouble, monkeypatch):
    monkeypatch.setattr(group, "PATIENT_TIMEOUTS_S", (0.1, 0.1))
    modules = Modules().pull()
    trouble(modules.links[NAMES[1]])
    begin = modules.world.modules[0].seconds
    unconfirmed = modules.group.stop()
    assert {name: type(error) for name, error in unconfirmed.items()} == {
        NAMES[1]: LinkError if trouble is BreakableLink.cut else LinkTimeout
    }
    assert [modules.states[index] for index in (0, 2, 3)] == [State.IDLE] * 3
    passed = modules.world.modules[0].seconds - begin
    assert passed == pytest.approx(0.0 if trouble is BreakableLink.cut else 0.2, abs=0.02), "it is asked twice"


def test_a_module_that_latched_refuses_a_stop_and_that_is_as_good_if_it_answers(monkeypatch):
    modules = Modules().pull()
    modules.group.clients[2].estop()
    assert modules.group.stop() == {}
    assert modules.states == [State.IDLE, State.IDLE, State.ESTOP, State.IDLE]
    monkeypatch.setattr(group, "PATIENT_TIMEOUTS_S", (0.1,))
    modules.links[NAMES[2]].freeze()  # another may have cleared it
    assert {name: type(error) for name, error in modules.group.stop().items()} == {NAMES[2]: LinkTimeout}


def test_one_that_refuses_a_stop_and_has_not_latched_is_named():
    class Stubborn(SimulatedLink):
        def send(self, content):
            for frame in Decoder().feed(content):
                self.said = Acknowledge(frame.type, Code.BAD_STATE, State.RUNNING).frame(frame.sequence).pack()

        def receive(self, timeout):
            said, self.said = self.said, b""
            return said

    stubborn = ModuleGroup([ModuleClient("stubborn", Stubborn(World(RIG).modules[0]))])
    [(name, error)] = stubborn.stop().items()
    assert (name, type(error), error.code) == ("stubborn", ModuleFault, Code.BAD_STATE)


def test_set_points_that_were_refused_before_it_was_armed_are_no_fault_of_a_run():
    modules = Modules()
    for client in modules.group.clients:
        client.set_tension(2.0)
        client.listen(0.02)
    modules.group.arm([1.0] * RIG.m)
    for client in modules.group.clients:
        client.check()


def test_one_that_refuses_to_be_armed_is_told_and_the_others_may_be_armed():
    modules = Modules()
    modules.group.clients[1].estop()
    with pytest.raises(ModuleFault, match=f'"{NAMES[1]}" refused Arm: BAD_STATE') as caught:
        modules.group.arm([1.0] * RIG.m)
    assert caught.value.module == NAMES[1]
    for index in (0, 2, 3):
        modules.group.clients[index].check()
    assert modules.group.stop() == {}


def test_sessions_are_not_those_before():
    modules = Modules().pull()
    assert modules.group.stop() == {}
    chosen = modules.group.clients[::2]
    for client, session in [(client, client.endpoint.session) for client in chosen]:
        client._random = Mock(**{"randrange.side_effect": [session, 4711]})
    modules.group.arm([1.0] * RIG.m)
    assert [client.endpoint.session for client in chosen] == [4711, 4711]
    assert set(modules.states) <= {State.ARMED, State.RUNNING}


def test_modules_whose_links_close_release_and_a_broken_link_keeps_none_from_it():
    modules = Modules().pull()
    modules.links[NAMES[0]].cut()
    modules.group.close()
    assert modules.states == [State.TIMEOUT] * RIG.m


class FastLink(SimulatedLink):
    """Link whose module, and so its clock, is ten times as fast as the others are; it notes what it is sent."""

    def __init__(self, module):
        super().__init__(module)
        self.sent = []

    def send(self, content):
        self.sent.append((Decoder().feed(content)[0].type, self.clock()))
        super().send(content)

    def receive(self, timeout):
        return super().receive(10.0 * timeout)


@pytest.mark.parametrize("fast", [0, 1])
def test_modules_are_kept_alive_and_waited_for_by_the_clock_that_goes_fastest(fast, monkeypatch):
    """Clocks of simulated modules pass as fast as they are computed; each times out by its own."""
    world = World(RIG)
    world.modules[2].advance(100.0)  # only what has passed since a command counts
    fast_link = FastLink(world.modules[fast])
    slow_link = BreakableLink(SimulatedLink(world.modules[2]), Conditions(latency=0.02))
    clients = [ModuleClient("fast", fast_link), ModuleClient("slow", slow_link)]
    pair = ModuleGroup(clients if fast == 0 else clients[::-1])
    pair.arm([1.0, 1.0])
    assert fast_link.clock() > 0.3, "as long as a set-point lives, and more"
    kept_alive = np.diff([time for kind, time in fast_link.sent if kind == Type.SET_TENSION])
    assert (np.abs(kept_alive - group.KEEP_ALIVE_PERIOD_S) < 0.025).all()
    assert {world.modules[index].sample.state for index in (fast, 2)} <= {State.ARMED, State.RUNNING}
    slow_link.freeze()
    monkeypatch.setattr(group, "PATIENT_TIMEOUTS_S", (0.5,))
    began, slow_began = fast_link.clock(), slow_link.clock()
    assert list(pair.stop()) == ["slow"]
    assert fast_link.clock() - began == pytest.approx(0.5, abs=0.05)
    assert slow_link.clock() - slow_began < 0.1


def test_before_a_run_modules_tell_what_they_can_do_and_begin_to_report():
    modules = Modules()
    for client in modules.group.clients:
        client.set_parameter("slew", 30.0)
    modules.pull()
    modules.world.advance(0.3)
    assert modules.states == [State.TIMEOUT] * RIG.m, "and an earlier run may have left them so"
    modules.group.prepare(RIG, 10)
    assert modules.states == [State.IDLE] * RIG.m
    assert modules.group.slews == (30.0,) * RIG.m
    modules.group.require_lengths()
    for client in modules.group.clients:
        client.listen(0.02)
        assert client.telemetry is not None


def test_modules_whose_lengths_are_unknown_are_named():
    modules = Modules()
    modules.world.modules[1].pause(0.02)  # it counted no turns
    modules.world.modules[1].advance(0.01)
    modules.group.prepare(RIG, 10)
    with pytest.raises(HardwareError, match=f"the cable lengths of {NAMES[1]} are not known"):
        modules.group.require_lengths()


@pytest.mark.parametrize(
    ("trouble", "error", "said"),
    [
        (methodcaller("arm"), LinkError, "is ARMED: another program has armed it"),
        (methodcaller("estop"), ModuleFault, "is in ESTOP: find out why"),
        (lambda client: client.link.freeze(), LinkTimeout, "did not answer Hello in 1 tries"),
        (methodcaller("set_parameter", "calibrated", 0.0), HardwareError, "is not calibrated"),
        (methodcaller("set_parameter", "tension_upper", 5.9), HardwareError, f"0.5 to 5.9 N{WANTED}"),
        (methodcaller("set_parameter", "tension_lower", 0.6), HardwareError, f"0.6 to 6 N{WANTED}"),
    ],
)
def test_a_module_not_ready_for_a_run_is_refused_and_the_others_are_left_alone(trouble, error, said, monkeypatch):
    monkeypatch.setattr(group, "PATIENT_TIMEOUTS_S", (0.1,))
    modules = Modules()
    trouble(modules.group.clients[2])
    with pytest.raises(error, match=f'module "{NAMES[2]}" .*{said}'):
        modules.group.prepare(RIG, 10)
    modules.world.advance(0.1)
    assert [modules.links[name].receive(0.0) for name in NAMES[:2]] == [b""] * 2, "they report nothing yet"


def test_each_module_of_a_rig_needs_a_link_and_no_other_has_one():
    links = Modules().links
    with pytest.raises(HardwareError, match='has no module "ceiling"; it has floor-1, floor-2, floor-3, top'):
        connect(RIG, links | {"ceiling": links["top"]})
    del links["top"], links["floor-2"]
    with pytest.raises(HardwareError, match="no link for floor-2, top; give each"):
        connect(RIG, links)


def test_where_one_link_cannot_be_opened_the_others_are_closed_again():
    modules = Modules().pull()
    links = dict(modules.links)
    links["floor-2"] = "socket://127.0.0.1:1"
    with pytest.raises(LinkError, match="cannot be opened"):
        connect(RIG, links)
    assert modules.states == [State.TIMEOUT, State.RUNNING, State.TIMEOUT, State.TIMEOUT]
