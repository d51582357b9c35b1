"""What differs on Windows, on a machine that pretends to be one; and what the others have instead."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from tensionlab.errors import WriteError
from tensionlab.hardware.client import locks
from tensionlab.hardware.client.locks import LinkLock, holder
from tensionlab.hardware.runner import watchdog
from tensionlab.hardware.runner.watchdog import Hung, Interrupts
from tensionlab.support import operating_system
from tensionlab.support.files import writing
from tests.helpers.simulated_time import SimulatedTime
from tests.helpers.windows import SIGBREAK, as_on_windows

OPEN_ELSEWHERE = PermissionError(errno.EACCES, "The process cannot access the file because it is being used ...")


@pytest.fixture
def windows(monkeypatch):
    """The module as it is on Windows, until `monkeypatch` undoes it; time passes there while somebody sleeps."""
    module = as_on_windows(monkeypatch)
    module.time = SimulatedTime()
    return module


def raising(error):
    """A function that raises an error, or none."""

    def act(*args):
        if error is not None:
            raise error

    return act


# Signals and processes


def test_ctrl_c_and_ctrl_break_end_a_program_on_windows_and_a_closed_terminal_elsewhere(windows):
    assert windows.INTERRUPT_SIGNALS == windows.ENDING_SIGNALS == (signal.SIGINT, signal.SIGTERM, SIGBREAK)
    assert windows.ESTOP_SIGNAL is signal.SIGTERM
    assert windows.OWN_GROUP == {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    assert operating_system.INTERRUPT_SIGNALS == (signal.SIGINT, signal.SIGTERM)
    assert {each.name for each in operating_system.ENDING_SIGNALS} == {"SIGINT", "SIGTERM", "SIGHUP"}


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (None, None),
        (OSError(errno.EINVAL, "The parameter is incorrect"), None),  # no such process
        (PermissionError(errno.EACCES, "Access is denied"), PermissionError),
        (OSError(errno.EIO, "whatever else"), OSError),
    ],
)
def test_an_emergency_stop_kills_a_process_on_windows_unless_it_has_ended(windows, monkeypatch, error, raised):
    killed = []
    monkeypatch.setattr(os, "kill", lambda pid, number: killed.append((pid, number)) or raising(error)())
    if raised is None:
        windows.send_estop(7)
    else:
        with pytest.raises(raised):
            windows.send_estop(7)
    assert killed == [(7, signal.SIGTERM)]


@pytest.mark.parametrize("error", [OSError(errno.EINVAL, "no signal"), PermissionError(errno.EPERM, "not yours")])
def test_elsewhere_it_is_an_error_not_to_reach_one_that_has_not_ended(monkeypatch, error):
    monkeypatch.setattr(os, "kill", raising(ProcessLookupError()))
    operating_system.send_estop(7)
    monkeypatch.setattr(os, "kill", raising(error))
    with pytest.raises(type(error)):
        operating_system.send_estop(7)


def test_a_watchdog_reaches_the_main_thread_on_windows(windows, monkeypatch):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(watchdog, "interrupt_main_thread", windows.interrupt_main_thread)
    interrupts, hung = Interrupts(), Hung("cycle 7")
    stopping = (*windows.ENDING_SIGNALS, windows.ESTOP_SIGNAL)
    assert len(set(stopping)) < len(stopping), "one signal does for both"
    with interrupts.caught(stopping):
        thread = threading.Thread(target=interrupts.throw, args=(hung,))
        with pytest.raises(Hung) as caught:  # noqa: PT012 - it comes from elsewhere
            thread.start()
            thread.join()
    assert caught.value is hung
    assert {number: signal.getsignal(number) for number in before} == before


# Files


def test_ctrl_c_comes_when_an_import_has_ended():
    came = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        with operating_system.holding_interrupts():
            signal.raise_signal(signal.SIGINT)
            assert came == []
        assert came == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, before)


class Busy:
    """Something that another program keeps from being done for so many tries."""

    def __init__(self, tries, act=lambda: "done"):
        self.tries, self.act, self.tried = tries, act, 0

    def method(self):
        """Return it as a method of the class that it is put into."""
        return lambda *args: self(*args)  # noqa: PLW0108

    def __call__(self, *args):
        self.tried += 1
        if self.tried <= self.tries:
            raise OPEN_ELSEWHERE
        return self.act(*args)


def test_a_file_that_another_program_has_open_is_waited_for_on_windows_for_a_while(windows):
    assert windows.retry_while_locked(soon := Busy(5)) == "done"
    assert soon.tried == 6
    began = windows.time.perf_counter()
    with pytest.raises(PermissionError):
        windows.retry_while_locked(never := Busy(float("inf")))
    assert windows.time.perf_counter() - began == pytest.approx(windows.OPEN_ELSEWHERE_S, abs=0.05)
    assert never.tried > 10
    with pytest.raises(FileNotFoundError):
        windows.retry_while_locked(raising(FileNotFoundError()))


def test_a_file_is_replaced_while_somebody_reads_it(windows, monkeypatch, tmp_path):
    monkeypatch.setattr(writing, "retry_while_locked", windows.retry_while_locked)
    (file := tmp_path / "a.txt").write_text("old")
    replace = Busy(3, os.replace)
    monkeypatch.setattr(Path, "replace", replace.method())
    writing.write_text(file, "new")
    assert (file.read_text(), replace.tried) == ("new", 4)
    replace.tries = float("inf")
    with pytest.raises(WriteError, match=r"a\.txt: cannot be written \(The process cannot access"):
        writing.write_text(file, "newer")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_link_is_locked_and_free_again_while_somebody_reads_who_has_it(windows, monkeypatch, tmp_path):
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    for name in ("user_folders", "is_private", "retry_while_locked", "process_start"):
        monkeypatch.setattr(locks, name, getattr(windows, name))
    replace, unlink = Busy(3, os.replace), Busy(3, os.unlink)
    monkeypatch.setattr(Path, "replace", replace.method())
    monkeypatch.setattr(Path, "unlink", lambda self, missing_ok: unlink(self))
    lock = LinkLock("COM5")
    assert holder("com5").pid == os.getpid()
    assert [path.name for path in tmp_path.iterdir()] == ["tensionlab"]
    lock.release()
    assert (replace.tried, unlink.tried) == (4, 4)
    assert holder("COM5") is None
    lock, unlink.tries = LinkLock("COM5"), float("inf")
    lock.release()
    assert holder("COM5") is None, "the note stays, and names nobody"
    LinkLock("COM5").release()


def test_the_folder_of_locks_is_in_one_of_the_user_s_on_windows(windows, tmp_path, monkeypatch):
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert list(windows.user_folders()) == [tmp_path / "tensionlab"]
    monkeypatch.delenv("LOCALAPPDATA")
    [folder] = windows.user_folders()
    assert folder.is_absolute()
    tmp_path.chmod(0o777)
    assert windows.is_private(tmp_path)


def test_elsewhere_it_is_one_that_nobody_else_may_enter(tmp_path):
    for mode, private in ((0o700, True), (0o710, False), (0o702, False)):
        tmp_path.chmod(mode)
        assert operating_system.is_private(tmp_path) is private
    tmp_path.chmod(0o700)
    (tmp_path / "link").symlink_to(tmp_path)
    assert not operating_system.is_private(tmp_path / "link")


def test_elsewhere_no_variable_moves_it(monkeypatch, tmp_path):
    before = list(operating_system.user_folders())
    for name in ("HOME", "TMPDIR", "XDG_RUNTIME_DIR", "XDG_STATE_HOME", "USER"):
        monkeypatch.setenv(name, str(tmp_path))
    assert list(operating_system.user_folders()) == before


@pytest.mark.skipif(sys.platform != "linux", reason="the system says it there only")
def test_a_process_is_known_by_its_number_and_its_start():
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        mine, its = operating_system.process_start(os.getpid()), operating_system.process_start(other.pid)
        assert 0 < mine <= its
        assert operating_system.process_start(other.pid) == its
    assert operating_system.process_start(other.pid) is None


def test_a_pipe_that_nobody_reads(windows, monkeypatch):
    errors = BrokenPipeError(), OSError(errno.EINVAL, "Invalid argument"), OSError(errno.ENOSPC, "No space left")
    assert list(map(windows.reader_has_gone, errors)) == [True, True, False]
    monkeypatch.undo()
    assert list(map(operating_system.reader_has_gone, errors)) == [True, False, False]


# The machine


WHOLE = """
import importlib, sys
from pathlib import Path
import pytest, rich.live
import tensionlab as tl
from tests.helpers.windows import pretend

folder = Path(tl.__file__).parent
files = [path.relative_to(folder.parent).with_suffix("") for path in folder.rglob("*.py")]
names = [".".join(file.parts).removesuffix(".__init__") for file in files if file.name != "__main__"]

def import_all():
    for name in names:
        importlib.import_module(name)

import_all()  # with what others have made, which has to find the system that is there
for name in names:
    del sys.modules[name]
pretend(pytest.MonkeyPatch())
import_all()

import tensionlab as tl
from tensionlab.cli import main
from tests.helpers.serving import ServedRig
assert tl.support.operating_system.ESTOP_SIGNAL.name == "SIGTERM"
rig = tl.datasets.folder() / "rigs" / "bartels2026-validation.toml"
with ServedRig(tl.load_rig(rig)) as served:
    links = ",".join(served.links.values())
    main(["run", str(rig), "--modules", links, "--ttl", "2", "--seconds", "0.3", "--json"])
"""


@pytest.mark.realtime  # modules are served and run over TCP
def test_all_of_the_package_is_imported_on_windows_and_a_run_over_tcp_ends_well(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", WHOLE],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"LOCALAPPDATA": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["ended"] == "duration reached"
    assert [path.name for path in tmp_path.iterdir()] == ["tensionlab"]


def test_processors_on_linux(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 5}, raising=False)
    assert operating_system.processors() == 3
    monkeypatch.setattr(Path, "read_text", lambda self, encoding: "processor\t: 0\nmodel name\t: i7: a fake\n")
    assert operating_system.processor_name() == "i7: a fake"
    monkeypatch.setattr("platform.processor", lambda: "x86_64")
    monkeypatch.setattr(Path, "read_text", lambda self, encoding: "processor\t: 0\n")
    assert operating_system.processor_name() == "x86_64"


def scheduled():
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has it")
def test_real_time_scheduling_lasts_as_long_as_its_context():
    before, last = scheduled(), operating_system.usable_processors()[-1]
    with pytest.raises(RuntimeError), operating_system.real_time(last) as outcome:  # noqa: PT012
        granted = ["refused" not in clause for clause in outcome]
        expected = (os.SCHED_FIFO, operating_system.FIFO_PRIORITY) if granted[1] else before[:2]
        assert scheduled() == (*expected, {last})
        locked = re.search(r"^VmLck:\s*(\d+)", Path("/proc/self/status").read_text(), re.MULTILINE)
        assert (int(locked[1]) > 0) == granted[2]
        raise RuntimeError
    assert granted[0]
    assert scheduled() == before
    assert re.search(r"^VmLck:\s*0 kB", Path("/proc/self/status").read_text(), re.MULTILINE)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has it")
def test_each_part_of_real_time_scheduling_that_is_refused_says_what_to_do(monkeypatch):
    before = scheduled()
    for name, number in (("sched_setaffinity", errno.EINVAL), ("sched_setscheduler", errno.EPERM)):
        monkeypatch.setattr(os, name, raising(OSError(number, os.strerror(number))))
    monkeypatch.setattr("ctypes.CDLL", lambda *_, **__: SimpleNamespace(mlockall=lambda _: -1, munlockall=None))
    monkeypatch.setattr("ctypes.get_errno", lambda: errno.ENOMEM)
    limits = "in /etc/security/limits.conf"
    with operating_system.real_time(1) as outcome:
        assert outcome == [
            "processor 1 was refused (Invalid argument): choose another",
            "SCHED_FIFO with priority 40 was refused (Operation not permitted): run as root, or give the user "
            f"`rtprio 40` {limits}",
            "locked memory was refused (Cannot allocate memory): run as root, or give the user "
            f"`memlock unlimited` {limits}",
        ]
    assert scheduled() == before


def test_real_time_scheduling_elsewhere(windows):
    with windows.real_time(0) as outcome:
        assert outcome == ["real-time scheduling was refused: only Linux has it"]
    assert windows.usable_processors() == list(range(os.cpu_count() or 1))


def test_elsewhere_a_file_that_is_refused_is_refused_at_once():
    calls = []

    def act():
        calls.append(1)
        raise OPEN_ELSEWHERE

    with pytest.raises(PermissionError):
        operating_system.retry_while_locked(act)
    assert len(calls) == 1


def test_the_command_that_kills_a_process(monkeypatch):
    assert operating_system.kill_command(7) == "kill -9 7"
    monkeypatch.setattr(sys, "platform", "win32")
    assert operating_system.kill_command(7) == "taskkill /f /pid 7"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other folders")
def test_folders_of_a_user_are_in_memory_where_there_is_one_and_in_the_home():
    runtime = Path(f"/run/user/{os.getuid()}")
    *first, last = operating_system.user_folders()
    assert first == [runtime / "tensionlab"] * runtime.is_dir()
    assert last.parts[-4:-1] == (".local", "state", "tensionlab")


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone tells")
def test_a_connection_of_this_user_is_told_from_one_that_has_no_owner():
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(server.getsockname()) as client,
    ):
        accepted, peer = server.accept()
        with accepted:
            own = accepted.getsockname()
            assert not operating_system.opened_by_other_user(peer, own)
            assert not operating_system.opened_by_other_user("a pair", "of sockets")
            client.close()
            assert operating_system.opened_by_other_user(peer, own)
