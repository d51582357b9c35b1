"""Links over ports and sockets: bytes come as they arrive, nothing blocks, and a broken link says so."""

from __future__ import annotations

import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from tensionlab.errors import HardwareError, LinkError
from tensionlab.hardware.client import links
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.simulation.serve import ServedModule, Server, serve
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tests.helpers.windows_port import MAX_DWORD, as_on_windows

LONG_S = 60.0  # no test waits for so long, unless something that should come does not


class FarEnd:
    """The far end of a link over TCP."""

    def __init__(self, host: str) -> None:
        self._listener = socket.create_server((host, 0), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
        shown = f"[{host}]" if ":" in host else host
        self.link = links.connect(f"socket://{shown}:{self._listener.getsockname()[1]}")
        self.socket, _ = self._listener.accept()
        self.socket.settimeout(LONG_S)

    def close(self) -> None:
        for each in (self.link, self.socket, self._listener):
            each.close()


@pytest.fixture
def far_end() -> Iterator[FarEnd]:
    end = FarEnd("127.0.0.1")
    yield end
    end.close()


# Sockets


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_bytes_go_both_ways_and_small_ones_at_once(host):
    try:
        end = FarEnd(host)
    except OSError:
        pytest.skip(f"this machine has no {host}")
    end.link.send(b"there")
    assert end.socket.recv(links.READ_BYTES) == b"there"
    sent, came = os.urandom(3 * links.READ_BYTES + 1), []
    end.socket.sendall(sent)
    while sum(map(len, came)) < len(sent):
        came.append(end.link.receive(LONG_S))
    assert b"".join(came) == sent
    assert max(map(len, came)) <= links.READ_BYTES
    began = end.link.clock()
    assert [end.link.receive(0.0), end.link.receive(0.02)] == [b"", b""]
    assert end.link.clock() - began >= 0.02
    assert end.link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    end.close()


def test_a_far_end_that_closes_or_breaks_off_is_told_by_reading_and_by_sending(far_end):
    far_end.socket.sendall(b"bye")
    far_end.socket.close()
    assert far_end.link.receive(LONG_S) == b"bye"
    with pytest.raises(LinkError, match=r"1:\d+ was closed by the module: has it another client, or ended"):
        far_end.link.receive(LONG_S)
    other = FarEnd("127.0.0.1")
    other.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # RST instead of FIN
    other.socket.close()
    with pytest.raises(LinkError, match=r"broke: Connection reset by peer$"):
        other.link.receive(LONG_S)
    with pytest.raises(LinkError, match=r"broke: Broken pipe$"):
        other.link.send(b"a")
    other.close()


def test_sending_never_waits_for_a_far_end_that_does_not_read(far_end):
    def fill() -> None:
        for _ in range(1000):
            far_end.link.send(bytes(1 << 16))

    for _ in range(2):  # where some of it finds room, and where none does
        with pytest.raises(LinkError, match="takes no more bytes; does the module still read"):
            fill()


def test_the_far_end_hears_at_once_of_a_link_that_is_closed_while_a_thread_waits_for_it(far_end):
    waiting, ended = threading.Event(), []

    def read() -> None:
        waiting.set()
        try:
            ended.append(far_end.link.receive(LONG_S))
        except LinkError as error:
            ended.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    waiting.wait(LONG_S)
    held = far_end.link._socket.dup()  # as a thread that waits keeps it
    far_end.link.close()
    assert far_end.socket.recv(links.READ_BYTES) == b""
    thread.join(LONG_S / 2)
    assert len(ended) == 1, "it waits no longer either"
    held.close()
    far_end.link.close()
    for use in (lambda: far_end.link.receive(0.0), lambda: far_end.link.send(b"a")):
        with pytest.raises(LinkError, match="broke"):
            use()


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("socket://127.0.0.1:1", "cannot be opened: Connection refused; is it served there, and in reach"),
        ("socket://127.0.0.1:99999", "give a host and a port from 1 to 65535"),
        ("socket://127.0.0.1:0", "give a host and a port from 1 to 65535"),
        ("socket://[::1:4001", "give a host and a port"),
        ("socket://@:4001", "give a host and a port"),
        (f"socket://{'a' * 64}:4001", "cannot be opened: .*label"),
        ("tcp://there", "is no link to a module"),
        ("bt://nobody/1", "give an address and a channel"),
        ("/dev/no-such-port", "cannot be opened: .*No such file.*; is it there"),
    ],
)
@pytest.mark.usefixtures("locks_folder")
def test_what_cannot_be_opened_says_why_and_is_free_again(url, message):
    for _ in range(2):
        with pytest.raises(LinkError, match=message) as raised:
            links.open_link(url)
        assert url in str(raised.value)[: len(url) + 2]


def test_a_bluetooth_link_is_one_of_these(monkeypatch):
    here, there = socket.socketpair()
    opened = []

    class Rfcomm:
        def __init__(self, *kind: object) -> None:
            opened.append(kind)

        def settimeout(self, seconds: float) -> None:
            assert seconds == links.CONNECT_TIMEOUT_S

        def connect(self, address: tuple[str, int]) -> None:
            opened.append(address)

        def __getattr__(self, name: str) -> object:
            return getattr(here, name)

    monkeypatch.setattr(socket, "AF_BLUETOOTH", 31, raising=False)
    monkeypatch.setattr(socket, "BTPROTO_RFCOMM", 3, raising=False)
    with monkeypatch.context() as patch:
        patch.setattr(socket, "socket", Rfcomm)
        link = links.connect("bt://AA:BB:CC:DD:EE:FF/2")
    assert opened == [(31, socket.SOCK_STREAM, 3), ("AA:BB:CC:DD:EE:FF", 2)]
    assert isinstance(link, links.SocketLink)
    link.send(b"ping")
    assert there.recv(4) == b"ping"
    there.close()
    link.close()


# Ports


@pytest.mark.realtime  # a pseudo-terminal of the system
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_a_module_at_a_serial_port_notices_that_its_client_has_gone():
    from tests.helpers.pseudo_terminal import PseudoTerminalPort

    module, port, ended = SimulatedModule(), PseudoTerminalPort(), threading.Event()
    server = Server([ServedModule(module, port)])
    thread = threading.Thread(target=serve, args=(server, ended.is_set))
    thread.start()
    try:
        with ModuleClient("floor-1", links.SerialLink(port.url)) as client:
            client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
            client.arm()
            client.set_tension(1.0, ttl_ms=2_000)
            assert client.hello().state is State.RUNNING
            closed = module.seconds
        end = time.monotonic() + LONG_S
        while module.sample.state is not State.TIMEOUT and time.monotonic() < end:
            time.sleep(0.01)
        assert module.seconds - closed < 1.5  # not by the time to live
    finally:
        ended.set()
        thread.join()


# Ports on Windows


@pytest.fixture
def port(monkeypatch):
    return as_on_windows(monkeypatch)


@pytest.fixture
def com(port):
    link = links.SerialLink("COM12")
    yield link
    link.close()


def test_bytes_of_a_com_port_come_together_and_reading_does_not_configure_it_anew(port, com):
    assert port.name == r"\\.\COM12"
    assert (port.dcb.BaudRate, port.dcb.fDtrControl, port.dcb.fRtsControl) == (links.BAUD_RATE, 0, 0)
    assert com.receive(0.001) == b""
    before = port.configured
    for count in (1, 2, links.READ_BYTES):
        port.come(sent := os.urandom(count))
        assert com.receive(0.001) == sent
    port.come(bytes(links.READ_BYTES + 5))
    assert [len(com.receive(0.001)) for _ in range(3)] == [links.READ_BYTES, 5, 0]
    assert port.configured == before
    assert com.receive(0.0) == b""
    com.send(b"one")
    com.send(b"two")
    assert port.written == b"onetwo"
    assert port.timeouts.WriteTotalTimeoutConstant == MAX_DWORD, "it is written without waiting"


def test_a_thread_that_waits_at_a_com_port_ends_when_its_device_goes_or_it_is_closed(port, com):
    for end in (port.unplug, com.close):
        port.unplugged = False
        ended = []

        def read(ended=ended) -> None:
            try:
                ended.append(com.receive(LONG_S))
            except LinkError as error:
                ended.append(error)

        thread = threading.Thread(target=read)
        thread.start()
        while port._buffer is None:
            time.sleep(0)
        end()
        thread.join(LONG_S / 2)
        assert len(ended) == 1
        assert not ended[0] or "COM12 broke" in str(ended[0])
        for use in (lambda: com.receive(0.001), lambda: com.send(b"a")):
            with pytest.raises(LinkError, match="COM12 broke"):
                use()


def test_a_com_port_that_another_program_has_says_so(port):
    port.taken = True
    with pytest.raises(LinkError, match=r"COM5 cannot be opened: could not open port 'COM5': .*of Windows"):
        links.SerialLink("COM5")


# Modules files


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[modules", "not valid TOML"),
        ("", r"give one table, \[modules\]"),
        ('modules = "COM5"', "give one table"),
        ('[modules]\na = "COM5"\n[rig]', "give one table"),
        ("[modules]\na = 5", '"a" is 5; give a link as text'),
        ('[modules]\n"a\\nb" = "COM5"', "printable characters"),
        (f'[modules]\n{101 * "a"} = "COM5"', "give 1 to 100"),
        ('[modules]\na = "COM5"\nb = "COM5"', "COM5 is there twice"),
    ],
)
def test_a_modules_file_is_read_as_it_was_written_and_what_is_wrong_in_it_is_named(tmp_path, text, message):
    urls = {"floor-1": "socket://127.0.0.1:40001", "x- y+": "/dev/rfcomm0", "ü": "COM5"}
    file = tmp_path / "modules.toml"
    file.write_text(links.modules_to_toml(urls), encoding="utf-8")
    assert list(links.load_modules(file).items()) == list(urls.items())
    file.write_text(text, encoding="utf-8")
    with pytest.raises(HardwareError, match=rf"modules\.toml: .*{message}"):
        links.load_modules(file)
