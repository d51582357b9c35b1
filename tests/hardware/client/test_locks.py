"""A module belongs to one process at a time, whatever becomes of that process."""

import os
import signal
import threading
from pathlib import Path

import pytest

from tensionlab.errors import LinkError
from tensionlab.hardware.client import locks
from tensionlab.hardware.client.locks import LinkLock, holder, normalised
from tests.helpers.scripts import running

HOLD = """
import sys
from pathlib import Path
from tensionlab.hardware.client import locks
locks.user_folders = lambda: [Path(sys.argv[1])]
lock = locks.LinkLock('COM5')
print(flush=True)
sys.stdin.read()
"""
pytestmark = pytest.mark.usefixtures("locks_folder")


def test_a_module_belongs_to_its_process_even_if_that_hangs_until_it_is_killed(locks_folder):
    with running(HOLD, str(locks_folder), "a word") as process:
        said = rf"com5 is in use by process {process.pid} \(-c .* a word\); end that"
        with pytest.raises(LinkError, match=said):
            LinkLock("com5")
        assert holder("COM5").pid == process.pid
        process.send_signal(signal.SIGSTOP)
        assert holder("COM5").pid == process.pid
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert holder("COM5") is None
        LinkLock("COM5").release()


def test_a_lock_ends_with_its_release_and_no_note_stays(locks_folder):
    first = LinkLock("COM5")
    with pytest.raises(LinkError, match=f"in use by process {os.getpid()} "):
        LinkLock("COM5")
    thread = threading.Thread(target=first.release)  # any thread may
    thread.start()
    thread.join()
    second = LinkLock("COM5")
    first.release()  # takes no note of the next one away
    assert holder("COM5").pid == os.getpid()
    assert list(locks.locked_links()) == ["COM5"]
    second.release()
    assert holder("COM5") is None
    assert locks.locked_links() == {}
    assert [path.suffix for path in locks_folder.iterdir()] == [".lock"]
    assert locks_folder.stat().st_mode & 0o777 == 0o700


def test_names_of_one_module_are_one_lock(tmp_path):
    port = tmp_path / "ttyUSB0"
    port.touch()
    (tmp_path / "by-id").symlink_to(port)
    same = [
        ("socket://localhost:4001", "socket://127.0.0.1:4001"),
        ("socket://[::1]:4001", "socket://127.0.0.1:4001/"),
        ("com12", "COM12"),
        ("bt://aa:bb:cc:dd:ee:0f", "bt://AA:BB:CC:DD:EE:0F/1"),
        (str(tmp_path / "by-id"), str(port)),
        ("/dev/tty.tensionlab-1", "/dev/cu.tensionlab-1"),
    ]
    for one, other in same:
        assert normalised(one) == normalised(other)
    others = ["socket://127.0.0.1:4002", "socket://10.0.0.1:4001", "bt://AA:BB:CC:DD:EE:0F/2", "COM1", "/dev/tty1"]
    assert len({normalised(url) for url in [*others, *(one for one, _ in same)]}) == len(others) + len(same) - 1


def test_a_note_that_somebody_removed_or_damaged_is_no_obstacle(locks_folder, monkeypatch):
    monkeypatch.setattr(locks, "LOCK_TIMEOUT_S", 0.0)
    lock = LinkLock("COM5")
    [note] = locks_folder.glob("*.json")
    note.write_text("{")
    assert holder("COM5") is None
    assert locks.locked_links() == {}
    with pytest.raises(LinkError, match="COM5 is in use by another process; end that first"):
        LinkLock("COM5")
    note.unlink()
    lock.release()
    LinkLock("COM5").release()


def test_what_cannot_be_locked_is_named(locks_folder):
    locks_folder.mkdir(mode=0o700)
    (file := locks_folder / locks._file_name("COM5")).mkdir()
    said = "COM5 cannot be locked: "
    with pytest.raises(LinkError, match=rf"^{said}.*\.lock: .*; see that you may"):
        LinkLock("COM5")
    file.rmdir()
    locks_folder.rmdir()
    locks_folder.write_text("no folder")
    with pytest.raises(LinkError, match=rf"{said}.*locks: File exists; see that"):
        LinkLock("COM5")


@pytest.mark.parametrize("pid_is_reused", [False, True])
def test_a_note_that_a_killed_process_left_is_ignored(locks_folder, pid_is_reused, monkeypatch):
    lock = LinkLock("COM5")
    [note] = locks_folder.glob("*.json")
    content, start = note.read_text(), locks.process_start(os.getpid())
    if pid_is_reused:  # and another process has the lock, but has not written its note yet
        monkeypatch.setattr(locks, "process_start", lambda pid: start + 1)
    else:
        lock.release()
    note.write_text(content)
    assert holder("COM5") is None
    assert locks.locked_links() == {}
    lock.release()


def test_a_folder_of_another_user_or_that_others_can_write_to_is_refused(locks_folder, monkeypatch):
    LinkLock("COM5").release()
    Path(locks_folder).chmod(0o777)
    with pytest.raises(LinkError, match=r"mode 0700"):
        LinkLock("COM5")
    Path(locks_folder).chmod(0o700)
    somebody = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: somebody)
    with pytest.raises(LinkError, match="must be yours"):
        LinkLock("COM5")
    assert holder("COM5") is None
    assert locks.locked_links() == {}


def test_one_folder_that_cannot_be_written_to_hides_no_lock(locks_folder, tmp_path, monkeypatch):
    """A service begins without /run/user/UID, the user logs in, the home fills, the user leaves."""
    home, runtime = tmp_path / "home", tmp_path / "runtime"
    folders = [home]
    monkeypatch.setattr(locks, "user_folders", lambda: folders)
    service = LinkLock("COM5", "left")
    folders[:] = [runtime, home]
    with pytest.raises(LinkError, match=f"COM5 is in use by process {os.getpid()} "):
        LinkLock("COM5")
    assert list(runtime.glob("*.json")) == [], "what it had locked before it found that out, it released"
    (home / locks._file_name("COM6")).mkdir()  # nothing can be made there
    other = LinkLock("COM6")
    assert {url: who.module for url, who in locks.locked_links().items()} == {"COM5": "left", "COM6": ""}
    folders[:] = [home]
    assert holder("COM5").module == "left"
    service.release()
    other.release()
