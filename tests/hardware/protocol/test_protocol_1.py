"""Modules and hosts of other protocols are recognised, and refused in words."""

import pytest

import tensionlab as tl
from tensionlab.errors import LinkTimeout, ProtocolError
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State, Type
from tensionlab.hardware.protocol.frames import Decoder, Frame
from tensionlab.hardware.protocol.messages import Hello, Info, OtherProtocolError, Protocol1Listener
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule
from tensionlab.hardware.simulation.world import simulated_module
from tests.helpers.modules import Host, host_in
from tests.helpers.protocol_1 import LinkTo1, pack, unpack

# As protocol 1 had it, with the sequence number 0.
HELLO_1 = bytes.fromhex("0201033e2e00")
TO_DO = (
    r'module "old" speaks protocol 1, this tensionlab 3; it is {} now: put the firmware of this tensionlab on the '
    r"module \(firmware/README.md\)"
)


def old(state=State.IDLE):
    return ModuleClient("old", LinkTo1(host_in(state).module))


def test_the_frames_of_protocol_1_are_those_that_it_had():
    assert pack(Frame(Type.HELLO, 0)) == HELLO_1
    assert unpack(HELLO_1[:-1]) == Frame(Type.HELLO, 0)


@pytest.mark.parametrize(
    "command",
    [
        ModuleClient.hello,
        ModuleClient.ping,
        ModuleClient.stop,
        ModuleClient.arm,
        ModuleClient.save,
        lambda client: client.parameter("slew"),
        lambda client: client.telemetry_every(20),
    ],
)
def test_a_module_of_protocol_1_is_refused_in_words_whatever_it_is_asked(command):
    client = old()
    with pytest.raises(ProtocolError, match=TO_DO.format("IDLE")) as raised:
        command(client)
    assert not isinstance(raised.value, LinkTimeout)
    assert len(str(raised.value)) <= 300
    assert client.link.heard == [Type.HELLO], "and nothing else reaches it"


def test_an_emergency_stop_reaches_a_module_of_protocol_1():
    client = old(State.RUNNING)
    with pytest.raises(ProtocolError, match=TO_DO.format("ESTOP")):
        client.estop()
    assert client.link.module.sample.state is State.ESTOP
    assert client.link.heard == [Type.ESTOP, Type.HELLO]


def test_a_rig_with_one_module_of_protocol_1_is_refused_before_any_is_armed():
    rig = tl.load_rig("datasets/rigs/floor-3.toml")
    modules = [simulated_module(each, 1.0, serial_number=1) for each in rig.modules]
    links = [SimulatedLink(module) for module in modules[:-1]] + [LinkTo1(modules[-1])]
    group = ModuleGroup([ModuleClient(each.name, link) for each, link in zip(rig.modules, links, strict=True)])
    with pytest.raises(ProtocolError, match=f'module "{rig.modules[-1].name}" speaks protocol 1'):
        group.prepare(rig, 20)
    assert {module.sample.state for module in modules} == {State.IDLE}


def test_a_module_of_a_later_protocol_is_refused_in_words(monkeypatch):
    client = ModuleClient("new", SimulatedLink(SimulatedModule()))

    def later(content):  # its INFO is another, but for the first byte
        (frame,) = Decoder().feed(content)
        said.append(Frame(Type.INFO, frame.sequence, b"\4" + bytes(40)).pack())

    said: list[bytes] = []
    monkeypatch.setattr(client.link.module, "receive", later)
    monkeypatch.setattr(client.link.module, "transmit", lambda: said.pop() if said else b"")
    with pytest.raises(ProtocolError, match='module "new" speaks protocol 4, this tensionlab 3: install the ten'):
        client.hello()


@pytest.mark.parametrize("before", [b"", b"noise", b"noise\0", b"noise\0\0", b"noise\0\0\0", HELLO_1[:3], HELLO_1])
def test_a_host_of_protocol_1_learns_that_the_module_speaks_another(before):
    host = Host()
    host.module.receive(before + HELLO_1)
    host.module.transmit()
    host.module.receive(HELLO_1)  # as after a time-out: what was joined with noise was lost
    stuffed, *zeros = host.module.transmit().split(b"\0")
    assert zeros == [b""] * 3, "so that the next frame of protocol 2 is not joined with it"
    info = unpack(stuffed)
    assert (info.type, info.sequence, info.payload[0]) == (Type.INFO, 0, 3)
    assert Info.unpack(info.payload).state is State.IDLE


@pytest.mark.parametrize("kind", [each for each in Type if each < 0x80 and each is not Type.HELLO])
def test_a_module_takes_nothing_but_hello_from_a_host_of_protocol_1(kind):
    host = host_in(State.RUNNING)
    host.module.receive(pack(Frame(kind, 3)) * 3 + bytes(3))
    assert host.module.transmit() == b""
    assert host.state is State.RUNNING
    assert host.say(Hello())[0].state is State.RUNNING


def test_questions_in_both_protocols_count_as_no_damage_to_a_module_of_this_one(monkeypatch):
    client = ModuleClient("one", SimulatedLink(SimulatedModule()))
    client.link.module.advance(STEP_S)
    transmit = client.link.module.transmit
    monkeypatch.setattr(client.link.module, "transmit", lambda: b"")
    with pytest.raises(LinkTimeout):
        client.hello()
    monkeypatch.setattr(client.link.module, "transmit", transmit)
    assert client.hello().protocol == 3  # the answers to all before come now
    assert client.bad_frames == 0
    client.telemetry_every(10)
    client.listen(0.05)
    assert client.telemetry.message.bad_frames == 0


def test_the_listener_takes_only_whole_info_of_protocol_1():
    info = Frame(Type.INFO, 5, b"\1" + bytes(29))
    assert list(Protocol1Listener().feed(pack(info))) == [5]
    others = [Frame(Type.INFO, 5, b"\2" + bytes(29)), Frame(Type.INFO, 5, b"\1" + bytes(28)), Frame(Type.PONG, 5)]
    others.append(Frame(Type.INFO, 5, b"\1" + b"\xff" * 29))
    listener = Protocol1Listener()
    for frame in others:
        assert listener.feed(pack(frame)) == {}
    for _ in range(100):
        assert listener.feed(b"x" * 10_000) == {}
    assert len(listener._rest) < 100
    listener.feed(b"\0")
    wire = pack(info)
    assert listener.feed(wire[:9]) == {}
    assert listener.feed(wire[9:]).keys() == {5}


def test_what_is_said_names_both_protocols_and_what_to_do():
    assert str(OtherProtocolError(1)).startswith("speaks protocol 1, this tensionlab 3: put the firmware")
    assert str(OtherProtocolError(7)).startswith("speaks protocol 7, this tensionlab 3: install the tensionlab")


def test_an_emergency_stop_of_many_says_which_speaks_protocol_1(monkeypatch, locks_folder):
    links = {"sim:": LinkTo1(host_in(State.RUNNING).module)}
    monkeypatch.setattr("tensionlab.hardware.client.emergency_stop.open_link", lambda url, locked: links[url])
    outcome = emergency_stop({"old": "sim:"})["old"]
    assert "speaks protocol 1" in outcome.error
    assert "it is ESTOP now" in outcome.error
