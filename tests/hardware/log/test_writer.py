"""Logs are written by real cycles, in real processes, to real files that real systems refuse."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tensionlab.errors import LogError
from tensionlab.files import writing
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.log.writer import FLUSH_S
from tests.support import runs

pytestmark = pytest.mark.realtime  # processes that are killed while they write

ROOT = Path(__file__).parents[3]
WRITER = """
import sys, time
from tests.support import runs
from tensionlab.errors import LogError
rig = runs.four()
log = runs.new_log(sys.argv[1], rig)
"""


def open_log(path):
    return runs.new_log(path, runs.four())


def script(text, *words):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", WRITER + text, *map(str, words)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_file_with_something_in_it_is_refused(tmp_path):
    file = tmp_path / "run.mcap"
    file.write_text("precious")
    with pytest.raises(LogError, match=r"run\.mcap: there is something already; name a new file"):
        open_log(file)
    assert file.read_text() == "precious"
    with pytest.raises(LogError, match="there is something already"):
        open_log(tmp_path)


def test_an_empty_file_is_taken(tmp_path):
    file = tmp_path / "run.mcap"
    file.touch()
    open_log(file).close()
    assert read_run(file).complete


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(LogError, match=r"none/run\.mcap: no folder .*none; make it first"):
        open_log(tmp_path / "none" / "run.mcap")


@pytest.mark.parametrize("probe", [writing.PROBE_BYTES, 10])  # too much, and what fits where the rest does not
def test_a_full_disk_is_noticed_before_the_run_starts_and_leaves_no_file(tmp_path, probe, monkeypatch):
    monkeypatch.setattr(writing, "PROBE_BYTES", probe)
    resource = pytest.importorskip("resource", reason="limits of a process stand for the disk's")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with pytest.raises(LogError, match=r"run\.mcap: .*cannot be written \(File too large\); free"):
            open_log(tmp_path / "run.mcap")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_a_device_is_refused():
    with pytest.raises(LogError, match="/dev/full: there is something already"):
        open_log("/dev/full")


def test_a_disk_that_fills_up_stops_the_writing_with_its_reason(tmp_path):
    file = tmp_path / "run.mcap"
    process = script(
        """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
try:
    for cycle in runs.cycles(rig, 10_000):
        log.write(cycle)
        time.sleep(0.002)
except LogError as error:
    print(cycle.state.cycle, error)
try:
    log.close()
except LogError as error:
    print("close:", error)
""",
        file,
    )
    said, wrong = process.communicate(timeout=60)
    assert not wrong
    first, second = said.splitlines()
    assert "run.mcap: the log cannot be written (File too large); free the disk or name another" in first
    assert second.startswith("close: ")
    run = read_run(file)
    assert not run.complete
    assert 20 < len(run) <= int(first.split()[0])


def test_what_was_logged_outlives_the_process(tmp_path):
    """Killed at five moments: every cycle that is older than a second is in the file, without a gap."""
    files = [tmp_path / f"{number}.mcap" for number in range(5)]
    processes = [
        script(
            """
for cycle in runs.cycles(rig, 1_000_000):
    log.write(cycle)
    print(cycle.state.cycle, time.monotonic(), flush=True)
    time.sleep(0.005)
""",
            file,
        )
        for file in files
    ]
    for process in processes:
        process.stdout.readline()
    time.sleep(1.2)
    for file, process in zip(files, processes, strict=True):
        time.sleep(0.137)
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        lines = [line.split() for line in process.communicate()[0].splitlines()]
        old = [int(line[0]) for line in lines if len(line) == 2 and float(line[1]) < killed - 1.0]
        run = read_run(file)
        assert not run.complete
        assert list(run.cycle) == list(range(len(run)))
        assert len(old) > 5
        assert len(run) > old[-1]


def test_cycles_are_in_the_file_soon(tmp_path):
    rig, file = runs.four(), tmp_path / "run.mcap"
    log = open_log(file)
    for cycle in runs.cycles(rig, 20):
        log.write(cycle)
    end = time.monotonic() + 10 * FLUSH_S
    while len(read_run(file)) < 20 and time.monotonic() < end:
        time.sleep(0.02)
    assert len(read_run(file)) == 20
    log.close()


def test_a_disk_that_does_not_keep_up_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.hardware.log.writer.MAX_BACKLOG", 50)
    monkeypatch.setattr("tensionlab.hardware.log.mcap_file.McapWriter.message", lambda *_: time.sleep(0.05))
    log = open_log(tmp_path / "run.mcap")

    def hurry():
        for cycle in runs.cycles(runs.four(), 100):
            log.write(cycle)

    with pytest.raises(LogError, match="does not keep up; 50 cycles wait"):
        hurry()
    with pytest.raises(LogError, match="does not keep up"):
        log.close()


def test_a_log_that_is_closed_takes_nothing_more(tmp_path):
    log = open_log(tmp_path / "run.mcap")
    log.close()
    log.close()
    with pytest.raises(LogError, match="is closed"):
        log.note("late", "too late")


def test_events_may_come_from_any_thread(tmp_path):
    log = open_log(tmp_path / "run.mcap")
    threads = [threading.Thread(target=log.note, args=("fault", str(index), "x- y+")) for index in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    log.close()
    events = read_run(tmp_path / "run.mcap").events
    assert sorted(int(event.text) for event in events) == list(range(20))
    assert {event.module for event in events} == {"x- y+"}
