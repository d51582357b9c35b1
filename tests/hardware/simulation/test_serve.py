"""A served module, without a network: what it does at which time."""

from collections import deque

import pytest

from tensionlab.errors import InputError
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Decoder, Hello, Info, Ping, Pong, read
from tensionlab.hardware.simulation import serve as serving
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


class FakePort:
    """What the client sends is in `coming`, None being its end; what it got is in `got`."""

    url = "fake"

    def __init__(self):
        self.coming, self.got, self.there, self.closed = deque(), [], True, False

    def files(self):
        return []

    def connected(self):
        return self.there

    def receive(self):
        content = self.coming.popleft() if self.coming else b""
        self.there = content is not None
        return content

    def send(self, content):
        self.got += [read(frame) for frame in Decoder().feed(content)]

    def close(self):
        self.closed = True


def test_an_answer_takes_the_latency_both_ways_and_is_for_no_other_client():
    port = FakePort()
    served = serving.ServedModule(SimulatedModule(), port, conditions=Conditions(latency=0.1))
    port.coming.append(Ping(5).frame(1).pack())
    served.serve(1.0)
    served.serve(1.0999)
    served.serve(1.1)
    served.serve(1.1999)
    assert port.got == []
    served.serve(1.2001)
    [pong] = port.got
    assert isinstance(pong, Pong)
    assert pong.time_us == pytest.approx(1.1e6, abs=1e6 * STEP_S)
    port.coming.append(Ping(6).frame(1).pack())
    served.serve(2.0)
    served.serve(2.1)
    port.coming += [None, Ping(7).frame(1).pack()]  # the client has left, and another has come
    for now in (2.11, 2.12, 2.25, 2.4):
        served.serve(now)
    assert [message.echo for message in port.got] == [5, 7]


def test_the_client_s_end_arrives_after_what_it_sent():
    port, module = FakePort(), SimulatedModule()
    served = serving.ServedModule(module, port, conditions=Conditions(latency=0.1))
    port.coming += [ConfigureTelemetry(5).frame(1).pack(), None]
    for now in (0.0, 0.01, 0.105, 0.2, 0.5):
        served.serve(now)
    port.got.clear()
    served.serve(1.0)
    assert port.got == []  # telemetry ends with the connection
    assert module.sample.seconds == pytest.approx(1.0), "no time is lost"


def test_a_planned_fault_comes_at_its_time():
    module, port = SimulatedModule(), FakePort()
    served = serving.ServedModule(module, port, faults=[serving.PlannedFault("supply", 0.5)])
    port.coming.append(ConfigureTelemetry(5).frame(1).pack())
    for tick in range(1000):
        served.serve(1e-3 * tick)
    supplies = {message.time_us: message.supply for message in port.got if hasattr(message, "supply")}
    assert min(supply for time, supply in supplies.items() if time < 0.5e6) > 10.0
    assert max(supply for time, supply in supplies.items() if time > 0.51e6) < 6.0


def test_serving_ends_when_it_is_told_to_and_closes_the_ports():
    port, module = FakePort(), SimulatedModule()
    port.coming.append(Hello().frame(1).pack())
    turns = iter([False] * 5 + [True])
    serving.serve(serving.Server([serving.ServedModule(module, port)]), lambda: next(turns))
    assert port.closed
    assert isinstance(port.got[0], Info)
    assert port.got[0].state is State.IDLE
    assert module.sample.seconds > 2 * serving.TICK_S


def test_a_fault_is_planned_in_words_and_a_plan_that_is_none_is_refused():
    planned = {"encoder@2s": 2.0, "cable@0.5": 0.5, "supply@800ms": 0.8, "brake@0s": 0.0}
    for text, seconds in planned.items():
        assert serving.parse_fault(text) == serving.PlannedFault(text.partition("@")[0], pytest.approx(seconds))
    for text in ("encoder", "encoder@", "encoder@-1s", "encoder@2h", "wheel@2s", "@2s", ""):
        with pytest.raises(InputError, match="write one of encoder, supply, motor, brake, cable and a time"):
            serving.parse_fault(text)


def test_a_delay_adds_to_no_other_unless_it_is_long():
    module, now = SimulatedModule(), [100.0]
    server = serving.Server([serving.ServedModule(module, FakePort())], clock=lambda: now[0])
    for delay in (0.015, 0.001, 0.015, 0.001):  # less than the server may be late
        now[0] += delay
        server.step()
    assert module.seconds == pytest.approx(0.032, abs=2 * STEP_S)
    now[0] += 5.0
    server.step()
    assert module.seconds == pytest.approx(0.032 + serving.MAX_LATE_S, abs=2 * serving.TICK_S)
