"""Checks of modules while they follow set-points."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tensionlab.demand import Demand, Impedance
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.client.module import ModuleClient, Received
from tensionlab.hardware.protocol.codes import Calibration, Code, Fault, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Stop
from tensionlab.hardware.runner.armed_modules import (
    TELEMETRY_UNITS,
    ArmedModules,
    require_following,
    require_plausible,
)
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule
from tensionlab.model.module import TensionLimits
from tests.helpers import wire


class InterruptedLink(SimulatedLink):
    """Link that hands over `first` before anything that the module sends."""

    first = b""

    def receive(self, timeout):
        first, self.first = self.first, b""
        return first or super().receive(timeout)


@pytest.mark.parametrize("seed", [177, 278], ids=["ARM has number 0", "ARM has number 255"])
def test_telemetry_of_before_it_was_armed_is_not_taken_for_a_stop(seed):
    """Whatever numbers the set-points have: an idle module that never followed one reports 0."""
    simulated = SimulatedModule()
    simulated.advance(STEP_S)
    link = InterruptedLink(simulated)
    with ModuleClient("one", link, seed=seed) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.command(ConfigureTelemetry(10))
        client.listen(0.05)
        idle = client.telemetry.message
        client.arm()
        client.set_tension(2.0)
        link.first = replace(idle, time_us=idle.time_us + 10).frame(0).pack()
        client.listen()
        assert client.state is State.IDLE
        require_following(client)
        client.listen(0.05)
        assert client.state is State.RUNNING
        require_following(client)


def telemetry(time_us=0, at=0.0, **changes):
    """What a module that follows set-points reports, and when it came."""
    return Received(wire.telemetry(time_us, **changes), at)


# What can be true


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("field", "unit"), TELEMETRY_UNITS.items())
def test_what_is_not_finite_cannot_be_true(field, unit, value):
    with pytest.raises(ModuleFault, match=rf'module "one" reports a {field} of {value} {unit}') as caught:
        require_plausible("one", None, telemetry(**{field: value}))
    assert (caught.value.module, caught.value.code) == ("one", Code.BAD_VALUE)


def test_a_module_that_pulls_in_spite_of_a_fault_is_refused():
    with pytest.raises(ModuleFault, match=r"reports a fault \(SPEED\) and keeps pulling \(RUNNING\)") as caught:
        require_plausible("one", None, telemetry(faults=Fault.SPEED))
    assert (caught.value.module, caught.value.code) == ("one", Fault.SPEED)


@pytest.mark.parametrize("start", [0, 2**32 - 5000])
@pytest.mark.parametrize(("sign", "word"), [(1.0, "more"), (-1.0, "less")])
def test_a_length_follows_from_the_speeds_but_for_5_cm_and_what_the_hand_may_accelerate(start, sign, word):
    # In 20 ms, from 1 to 2 m/s: 30 mm; and 50 mm + 100 m/s^2 (20 ms)^2 / 4 = 60 mm more or less.
    before, after = telemetry(start, 5.0, speed=1.0), (start + 20_000) % 2**32
    require_plausible("one", before, telemetry(after, 5.02, speed=2.0, length=1.03 + sign * 0.0599))
    with pytest.raises(ModuleFault, match=f"60 mm {word} than its speed explains in 20 ms") as caught:
        require_plausible("one", before, telemetry(after, 5.02, speed=2.0, length=1.03 + sign * 0.0601))
    assert (caught.value.module, caught.value.code) == ("one", Fault.ENCODER)


def test_the_slower_of_the_two_clocks_counts():
    before = telemetry(0, 5.0, speed=1.0)
    require_plausible("one", before, telemetry(20_000, 5.5, speed=1.0, length=1.5))
    require_plausible("one", before, telemetry(500_000, 5.02, speed=1.0, length=1.5))
    before = telemetry(1_000_000, 5.0, speed=1.0)
    with pytest.raises(ModuleFault, match="in 20 ms"):
        require_plausible("one", before, telemetry(1_020_000, 5.02, speed=1.0, length=1.5))


# All of it, with modules that report what the test wants


class Client:
    """Module that is well; what it is sent is noted."""

    def __init__(self, name):
        self.name, self.link = name, SimpleNamespace(url=f"sim:{name}")
        self.state, self.endpoint = State.RUNNING, SimpleNamespace(followed=True, repeated=0)
        self.telemetry, self.sent, self.broken = telemetry(), [], None
        self.checked = None

    def unchecked(self):
        before, self.checked = self.checked, self.telemetry
        return None if before is self.telemetry or self.telemetry is None else (before, self.telemetry)

    def check(self):
        if self.broken is not None:
            raise self.broken

    def send(self, *what):
        self.check()
        self.sent.append(what)
        return len(self.sent)

    def set_tension(self, tension, *, brake, ttl_ms):
        return self.send("tension", tension, brake, ttl_ms)

    def set_impedance(self, message):
        return self.send("impedance", message.stiffness, message.brake, message.ttl_ms)


class Watched:
    """Three armed modules, and their group; in a `cycle` all is well but what the test says.

    The continuous rating of the last one is less than its lower limit.
    """

    slews, continuous, frictions = [60.0] * 3, [3.0, 3.0, 0.3], ()

    def __init__(self, on_loss="continue"):
        self.clients, self.now, self.noted = [Client(name) for name in "abc"], 50.0, []
        self.infos = [SimpleNamespace(tension_lower=0.5)] * 3
        rig = SimpleNamespace(limits=TensionLimits(np.full(3, 0.5), np.full(3, 6.0)), m=3, bodies=())
        clock = SimpleNamespace(now=lambda: self.now)
        self.statistics = Statistics()
        settings = RunSettings(on_loss=on_loss)
        self.modules = ArmedModules(
            rig, self, settings, clock, self.statistics, lambda *note: self.noted.append(note)
        )

    @property
    def lost(self):
        """Names of lost modules."""
        assert [note[2] for note in self.noted] == list(self.statistics.lost)
        return "".join(self.statistics.lost)

    def clear_checked(self):
        pass

    def suspects(self, active, delays, ttl):
        return np.flatnonzero(active).tolist()

    def send_tensions(self, tensions, chosen, brakes, ttl_ms):
        return np.full(3, -1), np.flatnonzero(chosen).tolist(), []

    def cycle(self, seconds=0.02, ages=(0.01,) * 3, delays=(0.03,) * 3, bearable=(6.0,) * 3):
        self.now += seconds
        seen = SimpleNamespace(ages=np.array(ages), bearable=np.array(bearable))
        self.modules.check(seen, np.array(delays), self.now)
        return self.lost


def silent(seconds):
    return {"ages": (seconds, 0.01, 0.01)}


@pytest.mark.parametrize(
    ("cycles", "lost", "said"),
    [
        ([silent(0.25)], "", ""),
        ([silent(0.26)], "a", 'module "a" at sim:a has been silent for 0.26 s; has it power'),
        ([{}, {"seconds": 0.187}, silent(0.26)], "a", "silent"),  # three quarters of a time to live are no stall
        ([{}, {"seconds": 0.188}, silent(0.26)], "", ""),
        ([{}, {"seconds": 1.0, "delays": (2.0,) * 3, **silent(1.2)}], "", ""),
        ([{}, {"seconds": 1.0, "delays": (2.0,) * 3, **silent(1.2)}, silent(1.27)], "a", "silent for 1.27 s"),
        # The stall is over.
        ([{}, {"seconds": 0.188}, {"seconds": 0.13}, {"seconds": 0.13}, silent(0.26)], "a", "silent"),
        ([{"delays": (0.3, 0.03, 0.03)}] * 10 + [{"seconds": 0.5, "delays": (0.3, 0.03, 0.03)}], "", ""),
        ([{"delays": (0.03, 0.26, 0.25)}] * 13, "", ""),
        ([{"delays": (0.03, 0.26, 0.25)}] * 14, "b", 'module "b" is late: it follows a set-point sent'),
        ([{"delays": (0.03, 0.26 if cycle % 12 else 0.1, 0.03)} for cycle in range(50)], "", ""),
        ([{"bearable": (np.nan, 0.5, 0.5)}], "", ""),
        ([{"bearable": (np.nan, 0.5, 0.49)}], "c", 'module "c" is too hot'),
    ],
)
def test_a_module_is_lost_once_it_is_silent_late_or_too_hot_beyond_what_a_stall_explains(cycles, lost, said):
    watched = Watched()
    for cycle in cycles:
        watched.cycle(**cycle)
    assert watched.lost == lost
    if lost:
        assert said in watched.statistics.lost[lost]
        np.testing.assert_array_equal(watched.modules.active, [name != lost for name in "abc"])
        (client,) = (client for client in watched.clients if client.name == lost)
        assert client.sent == [(Stop(),)], "it is commanded to stop"
        assert watched.cycle(**silent(9.0 if lost == "a" else 0.01)) == lost, "and lost only once"


def test_a_module_that_repeats_its_telemetry_is_told_from_a_silent_one():
    watched = Watched("stop")
    watched.clients[0].endpoint.repeated, watched.clients[0].telemetry = 3, telemetry(1234)
    with pytest.raises(LinkTimeout, match=r"repeats its report of 0\.26 s ago \(3 times time_us 1234\)"):
        watched.cycle(**silent(0.26))


def test_what_cannot_be_true_is_found_once_for_each_telemetry():
    watched = Watched()
    watched.cycle()
    watched.clients[1].telemetry = telemetry(20_000, 0.02, length=1.5)
    assert watched.cycle() == "b"
    for step in (1, 2):  # each by the one before, and not by the first
        watched.clients[0].telemetry = telemetry(20_000 * step, 0.02 * step, length=1.0 + 0.04 * step)
        assert watched.cycle() == "b"


def test_a_run_that_is_to_stop_raises_what_is_wrong_with_the_first_module():
    watched = Watched("stop")
    watched.clients[1].state = State.IDLE
    with pytest.raises(ModuleFault, match='"b" is IDLE: it was stopped from outside, or restarted') as caught:
        watched.cycle()
    assert caught.value.code is State.IDLE
    assert watched.lost == "b"
    assert watched.clients[1].sent == [], "the run stops all modules"


def test_with_the_last_module_the_run_ends():
    watched = Watched()
    for client in watched.clients[:2]:
        client.broken = LinkError(f"{client.name} is cut")
    assert watched.cycle() == "ab"
    watched.clients[2].broken = LinkError("c is cut")
    with pytest.raises(HardwareError, match="no module is left; the last one: c is cut"):
        watched.cycle()


@pytest.mark.parametrize("stalled", [True, False])
@pytest.mark.parametrize("code", [State.TIMEOUT, Fault.SPEED])
def test_a_timeout_by_a_stall_of_this_computer_says_so(stalled, code):
    watched = Watched("stop")
    watched.cycle()
    watched.clients[0].broken = fault = ModuleFault('module "a" has released its cable', "a", code)
    with pytest.raises(ModuleFault) as caught:
        watched.cycle(0.5 if stalled else 0.02)
    blamed = "a cycle came after 0.50 s" in str(caught.value)
    assert blamed == (stalled and code is State.TIMEOUT)
    assert str(caught.value).startswith(str(fault))
    assert (caught.value.module, caught.value.code) == ("a", code)


@pytest.mark.parametrize(
    ("state", "followed", "lost"),
    [
        (State.IDLE, False, ""),  # what it was before it was armed
        (State.IDLE, True, "b"),
        (None, False, "b"),  # it has said nothing at all
        (State.TIMEOUT, False, "b"),  # it released since its client was checked
        (State.ARMED, True, ""),
    ],
)
def test_a_module_that_has_not_followed_since_it_was_armed_may_say_what_it_was_before(state, followed, lost):
    watched = Watched()
    watched.clients[1].state, watched.clients[1].endpoint.followed = state, followed
    assert watched.cycle() == lost
    assert all(f'"b" is {(state or State.IDLE).name}' in why for why in watched.statistics.lost.values())


def test_those_that_take_part_are_sent_set_points_and_a_broken_link_loses_its_module():
    watched = Watched()
    demand = Demand(np.zeros(3), brakes=frozenset("c"), impedances={"b": Impedance(1.0, 30.0)})
    watched.cycle()
    watched.modules.tensions = np.array([1.0, np.nan, 3.0])
    np.testing.assert_array_equal(watched.modules.send(demand), [1, 1, 1])
    assert [client.sent for client in watched.clients] == [
        [("tension", 1.0, False, 250)],
        [("impedance", 30.0, False, 250)],
        [("tension", 3.0, True, 250)],
    ]
    watched.clients[0].broken = LinkError("a is cut")
    np.testing.assert_array_equal(watched.modules.send(demand), [-1, 2, 2])
    assert watched.lost == "a"
    watched.clients[0].broken = None
    np.testing.assert_array_equal(watched.modules.send(demand), [-1, 3, 3])
    assert len(watched.clients[0].sent) == 1, "it does not come back"


TENSIONS = arrays(np.float64, 3, elements=st.floats(0.5, 6.0))


def on_their_way(before, max_change):
    modules = Watched().modules
    modules.tensions, modules._max_change = np.array(before), max_change
    return modules


@given(TENSIONS, TENSIONS, st.floats(0.01, 3.0), arrays(np.bool_, 3))
def test_free_tensions_go_the_same_share_of_their_way_none_by_more_than_it_may(before, chosen, most, free):
    modules = on_their_way(before, most)
    commanded, slew_limited = modules.go_to(np.where(free, chosen, np.nan), free)
    np.testing.assert_array_equal(modules.tensions[~free], before[~free], "those that are not free stay")
    np.testing.assert_array_equal(commanded, np.where(free, modules.tensions, np.nan))
    way, gone = (chosen - before)[free], (modules.tensions - before)[free]
    longest = np.abs(way).max(initial=0.0)
    assert slew_limited == (longest > most)
    np.testing.assert_allclose(gone, way * min(1.0, most / max(longest, 1e-12)), atol=1e-12)
    if longest <= most:
        np.testing.assert_array_equal(modules.tensions[free], chosen[free])


@pytest.mark.parametrize("value", [0.49, 6.01, np.nan, np.inf, -np.inf])
def test_tensions_outside_the_limits_are_refused(value):
    tensions = np.array([0.5, value, 6.0])  # those on the limits are within them
    modules = on_their_way(np.ones(3), 9.0)
    with pytest.raises(HardwareError) as caught:
        modules.go_to(tensions, np.ones(3, dtype=bool))
    np.testing.assert_array_equal(modules.tensions, np.ones(3), "they stay as they were")
    assert str(caught.value) == f'module "b" would be sent {value:g} N; its limits are 0.5 to 6 N'
    modules.go_to(tensions, np.array([True, False, True]))
