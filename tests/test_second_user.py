"""Another user of this machine reads nothing of a run, changes nothing, and stops nothing from working."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tensionlab.haptics.bridge.client import BridgeClient
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.messages import Welcome
from tensionlab.haptics.bridge.server import Bridge
from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.client.locks import LinkLock, holder
from tensionlab.hardware.client.shared_telemetry import Publisher, Watcher
from tests.helpers.runs import four

pytestmark = [
    pytest.mark.realtime,  # processes of another user
    pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can become another user"),
]
NOBODY = 65534
AS_NOBODY = f"""
import encodings.idna, json, os, socket, sys
os.setgroups([]); os.setgid({NOBODY}); os.setuid({NOBODY})
words = json.loads(sys.argv[1])

def tried(act):
    try:
        return repr(act())
    except Exception as error:
        return type(error).__name__

"""


@pytest.fixture
def locks_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Folder of locks in one that others may enter: what keeps them out is its own mode."""
    with TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        made = Path(folder, "locks")
        monkeypatch.setattr("tensionlab.hardware.client.locks.user_folders", lambda: [made])
        yield made


def by_nobody(script: str, **words: object) -> dict[str, str]:
    """Return what a script of another user prints."""
    done = subprocess.run(
        [sys.executable, "-I", "-c", AS_NOBODY + script, json.dumps(words)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, str] = json.loads(done.stdout)
    return answer


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> Publisher:
    monkeypatch.setattr(shared_telemetry, "MIN_PERIOD_S", 0.0)
    return Publisher()


def test_a_lock_is_neither_read_nor_made_nor_taken_away_and_its_process_not_signalled(locks_folder: Path) -> None:
    lock = LinkLock("COM5", "left")
    [note] = locks_folder.glob("*.json")
    found = by_nobody(
        """
print(json.dumps({
    "list": tried(lambda: os.listdir(words["folder"])),
    "read": tried(lambda: open(words["note"]).read()),
    "make": tried(lambda: open(words["folder"] + "/new", "w")),
    "remove": tried(lambda: os.unlink(words["note"])),
    "replace": tried(lambda: os.rename(words["folder"], words["folder"] + "-old")),
    "signal": tried(lambda: os.kill(words["pid"], words["number"])),
}))
""",
        folder=str(locks_folder),
        note=str(note),
        pid=os.getpid(),
        number=signal.SIGUSR1,
    )
    assert set(found.values()) == {"PermissionError"}, found
    who = holder("COM5")
    assert who is not None
    assert (who.pid, who.module) == (os.getpid(), "left")
    lock.release()


def test_a_publisher_answers_nobody_without_its_token_and_its_watcher_all_the_same(published: Publisher) -> None:
    published.topics["run"] = lambda: b"goes on"
    found = by_nobody(
        """
ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(4)]
for end, content in zip(ends, (b"", b"0" * 32, b"0" * 32 + b" run", b"x" * 1000)):
    end.settimeout(0.3)
    for _ in range(20):
        end.sendto(content, ("127.0.0.1", words["port"]))
print(json.dumps({str(number): tried(lambda: end.recv(1 << 16)) for number, end in enumerate(ends)}))
""",
        port=published.port,
    )
    assert set(found.values()) == {"TimeoutError"}, found
    watcher = Watcher(published.port, published.token)
    watcher._socket.settimeout(60.0)
    watcher.ask("run")
    assert next(watcher.answers()) == b"goes on"
    watcher.close()


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    rig = four()
    welcome = Welcome(rig=rig.name, modules=[], upper=[], scenario=None, bodies=[], rate=50.0, timeout=0.25)
    with Bridge(ClientState(rig), welcome, lambda number: number) as served:
        yield served


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells whose a connection is")
def test_a_bridge_without_a_token_refuses_another_user_and_serves_its_own(bridge: Bridge) -> None:
    port = int(bridge.url.rpartition(":")[2])
    found = by_nobody(
        """
def ask(path, close=False):
    with socket.create_connection(("127.0.0.1", words["port"]), 60.0) as end:
        more = "Upgrade: websocket\\r\\nConnection: Upgrade\\r\\nSec-WebSocket-Version: 13\\r\\n"
        more += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\\r\\n"
        end.sendall(f"GET {path} HTTP/1.1\\r\\nHost: 127.0.0.1\\r\\n{more}\\r\\n".encode())
        if not close:
            return end.recv(4096).split(b"\\r\\n")[0].decode()
paths = ("/command", "/events", "/state", "/", "/schema.json")
found = {path: tried(lambda: ask(path)) for path in paths}
ask("/command", close=True)
print(json.dumps(found))
""",
        port=port,
    )
    assert set(found.values()) == {"'HTTP/1.1 403 Forbidden'"}, found
    with BridgeClient(bridge.url) as client:
        assert client.welcome.rig == four().name
    assert bridge._client.count == 0
