"""Links that delay, lose and damage bytes, can be cut and frozen; what then becomes of the modules."""

import random

import pytest

from tensionlab.errors import InputError, LinkError, LinkTimeout
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Hello
from tensionlab.hardware.simulation.links import Channel, Conditions, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule
from tests.helpers.breakable import BreakableLink


def channel(seed=1, **conditions):
    return Channel(Conditions(**conditions), random.Random(seed))


def test_bytes_take_the_latency_and_up_to_the_jitter_and_never_overtake():
    link, delays, arrived = channel(latency=0.03, jitter=0.02), [], []
    for index in range(1000):
        sent = 0.1 * index
        link.put(bytes([index % 256]), sent)
        delays.append(link._waiting[0][0] - sent)
        assert link.take(sent + 0.0299) == []
        arrived += link.take(sent + 0.0501)
    assert b"".join(arrived) == bytes(index % 256 for index in range(1000))
    assert min(delays) < 0.0305
    assert max(delays) > 0.0495
    for index in range(1000):  # all at once: jitter may not change their order
        link.put(bytes([index % 256]), 200.0)
    assert b"".join(link.take(201.0)) == b"".join(arrived)


def test_bytes_are_lost_and_have_one_bit_flipped_by_the_shares_that_were_asked_for():
    link = channel(drop=0.1, corrupt=0.02)
    link.put(bytes(100_000), 0.0)
    [content] = link.take(0.0)
    damaged = [byte for byte in content if byte]
    assert len(content) == pytest.approx(90_000, abs=500)
    assert len(damaged) == pytest.approx(1_800, abs=200)
    assert all(byte.bit_count() == 1 for byte in damaged)
    assert len(set(damaged)) == 8


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"latency": -1e-3}, "latency is from 0 to 60 s; got -0.001"),
        ({"jitter": float("nan")}, "jitter"),
        ({"drop": 1.5}, "drop is from 0 to 1; got 1.5"),
        ({"corrupt": -0.1}, "corrupt"),
    ],
)
def test_conditions_that_cannot_be_are_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        Conditions(**wrong)


def lockstep(conditions=None, seed=0):
    module = SimulatedModule()
    module.advance(STEP_S)
    return BreakableLink(SimulatedLink(module), conditions, seed=seed)


def test_what_is_lost_and_damaged_is_made_good_by_asking_again():
    with ModuleClient("one", lockstep(Conditions(drop=0.005, corrupt=0.005), seed=3)) as client:
        answered = 0
        for _ in range(10):
            try:
                client.hello()
                answered += 1
            except LinkTimeout:
                pass
        assert answered >= 8
        client.command(ConfigureTelemetry(5))
        client.listen(1.0)
        assert client.bad_frames > 3


def test_bytes_take_their_time_both_ways_and_the_same_seed_has_the_same_accidents():
    first, second = (lockstep(Conditions(0.03, 0.01, 0.05, 0.05), seed=3) for _ in range(2))
    heard = [[], []]
    for _ in range(50):
        for link, came in zip((first, second), heard, strict=True):
            began = link.clock()
            link.send(Hello().frame(1).pack())
            content = link.receive(0.1)
            assert not content or 0.06 <= link.clock() - began < 0.08 + 2 * STEP_S
            came.append((content, link.clock()))
    assert heard[0] == heard[1]
    assert len(set(heard[0])) > 10


def test_a_module_whose_link_is_cut_lets_go():
    link = lockstep()
    client = ModuleClient("one", link)
    client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
    client.arm()
    client.set_tension(3.0)
    client.listen(0.1)
    link.cut()
    for use in (lambda: link.send(b"a"), lambda: link.receive(0.1)):
        with pytest.raises(LinkError, match="it was cut"):
            use()
    link.inner.module.advance(0.01)
    assert link.inner.module.sample.state is State.TIMEOUT


def test_a_frozen_link_is_silent():
    with ModuleClient("one", lockstep(Conditions(latency=0.01))) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.command(ConfigureTelemetry(5))
        client.arm()
        client.set_tension(3.0, ttl_ms=100)
        client.link.freeze()
        client.listen()
        before = client.telemetry
        began = client.link.clock()
        assert client.link.receive(0.1) == b""
        assert client.link.clock() - began == pytest.approx(0.1), "time passes for who waits"
        began = client.link.clock()
        with pytest.raises(LinkTimeout, match="did not answer Stop"):
            client.stop()
        assert client.link.clock() - began == pytest.approx(0.95, abs=0.01)
        assert client.telemetry is before
        assert client.link.inner.module.sample.state is State.TIMEOUT, "neither set-point nor STOP came through"
