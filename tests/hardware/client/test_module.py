from contextlib import suppress

import pytest

from tensionlab.errors import LinkTimeout, ModuleFault, ProtocolError
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Code, Fault, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Stop
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S


def test_a_module_says_what_it_is_and_pulls_what_it_is_told(client):
    assert client.hello().calibrated
    client.command(ConfigureTelemetry(10))
    client.arm()
    sequence = client.set_tension(3.0)
    client.listen(0.1)
    client.check()
    assert client.telemetry.message.sequence == sequence
    assert client.telemetry.message.tension == 3.0
    assert client.link.module.sample.tension == pytest.approx(3.0, abs=0.1)
    client.stop()
    assert client.state is State.IDLE


def test_silence_makes_it_let_go_and_the_next_check_says_so(client):
    client.command(ConfigureTelemetry(10))
    client.arm()
    client.set_tension(2.0, ttl_ms=100)
    client.listen(0.3)
    with pytest.raises(ModuleFault, match=r"has released its cable \(TIMEOUT\)") as caught:
        client.check()
    assert caught.value.module == "one"
    assert caught.value.code is State.TIMEOUT


def test_a_session_is_not_the_one_before(client):
    for _ in range(2):  # with a seed the second host draws what the first one has drawn
        with ModuleClient("one", SimulatedLink(client.link.module), seed=5) as host:
            host.arm()
            host.set_tension(2.0)
            host.listen(0.02)
            host.check()
            host.stop()


def test_a_module_that_was_stopped_before_arm_was_repeated_stays_stopped(client):
    class LosesAnAnswer(SimulatedLink):
        """A link that loses the answer to ARM, while another host stops the module."""

        lost = False

        def receive(self, timeout):
            content = super().receive(timeout)
            if content and not self.lost and self.module.sample.state is State.ARMED:
                self.lost = True
                self.module.receive(Stop().frame(9).pack())
                self.module.transmit()
                return b""
            return content

    with ModuleClient("one", LosesAnAnswer(client.link.module)) as host:
        with pytest.raises(ModuleFault, match="refused Arm: STOPPED"):
            host.arm()
        assert host.state is State.IDLE


def test_what_a_module_refuses_is_an_error_with_its_code(client):
    client.set_parameter("slew", 50.0)
    assert client.parameter("slew") == 50.0
    with pytest.raises(ProtocolError, match="no parameter 'speed'; they have tension_lower"):
        client.parameter("speed")
    with pytest.raises(ProtocolError, match="slew is from"):
        client.set_parameter("slew", 1e6)
    client.arm()
    with pytest.raises(ModuleFault, match="refused SetParameter: BAD_STATE") as caught:
        client.set_parameter("slew", 50.0)
    assert caught.value.code is Code.BAD_STATE
    client.set_tension(50.0)
    client.listen(0.01)
    with pytest.raises(ModuleFault, match="refused a set-point: BAD_VALUE"):
        client.check()


def test_a_fault_is_named_until_the_module_is_cleared(client):
    client.arm()
    client.link.module.damage("encoder")
    client.listen(0.1)
    client.hello()
    with pytest.raises(ModuleFault, match=r"released its cable \(FAULT: ENCODER\)") as caught:
        client.check()
    assert caught.value.code is Fault.ENCODER
    client.link.module.damage("encoder", broken=False)
    client.listen(0.1)
    client.clear()
    client.check()
    assert client.endpoint.faults == 0


@pytest.mark.parametrize(("seconds", "slept"), [(0.05, [0.05]), (0.002, [0.002]), (0.0005, [])])
def test_waiting_sleeps_only_where_the_link_lets_no_time_pass(client, monkeypatch, seconds, slept):
    sleeps, before = [], client.link.clock()
    monkeypatch.setattr("tensionlab.hardware.client.module.time.sleep", sleeps.append)
    client.wait(seconds)
    assert client.link.clock() - before == pytest.approx(seconds, abs=STEP_S)
    assert not sleeps
    client.listen = lambda seconds: None  # as over a link that a thread reads
    client.wait(seconds)
    assert sleeps == pytest.approx(slept)


def test_leaving_by_an_error_stops_the_module_first(client):
    for error, state in ((KeyboardInterrupt, State.IDLE), (None, State.ARMED)):
        with suppress(KeyboardInterrupt), ModuleClient("one", SimulatedLink(client.link.module)) as host:
            host.arm()
            host.close = lambda: None  # a link that closes lets time pass
            if error is not None:
                raise error
        assert client.link.module.sample.state is state


def test_sessions_repeat_with_the_same_seed_alone(client):
    def session(seed):
        host = ModuleClient("one", SimulatedLink(client.link.module), seed)
        return host.new_session(host.hello()).session

    assert session(5) == session(5)
    assert len({session(None) for _ in range(9)}) > 1


def test_a_module_that_does_not_answer_is_named(client, monkeypatch):
    monkeypatch.setattr(client.link.module, "receive", lambda content: None)
    before = client.link.clock()
    with pytest.raises(LinkTimeout, match='module "one" at sim: did not answer Stop in 3 tries'):
        client.stop()
    assert client.link.clock() - before == pytest.approx(0.95, abs=0.01)
    monkeypatch.undo()
