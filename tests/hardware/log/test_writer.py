"""Logs are written by real cycles, to real files that real systems refuse."""

import itertools
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from tensionlab.errors import LogError
from tensionlab.hardware.log import writer
from tensionlab.hardware.log.mcap_file import McapWriter
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.runner.records import RunEvent
from tensionlab.support.files import writing
from tests.helpers import runs
from tests.helpers.scripts import running

TIMEOUT_S = 60.0
WRITES = """
import sys, time
from tensionlab.hardware.log import writer
from tests.helpers import runs

class Counting(writer.McapWriter):
    cycles = 0

    def message(self, topic, *words):
        super().message(topic, *words)
        self.cycles += topic == "cycle"

    def flush(self):
        super().flush()
        print(self.cycles, flush=True)

writer.McapWriter = Counting
print(flush=True)
log = runs.new_log(sys.argv[1], runs.four())
for cycle in runs.cycles(runs.four(), 20_000):
    log.write(cycle)
    time.sleep(2e-3)
"""


def open_log(path):
    return runs.new_log(path, runs.four())


def write_all(log, count):
    for cycle in runs.cycles(runs.four(), count):
        log.write(cycle)


def test_only_a_new_or_an_empty_file_is_taken(tmp_path):
    file = tmp_path / "run.mcap"
    file.write_text("precious")
    for path, said in (
        (file, r"run\.mcap: there is something already; name a new file"),
        (tmp_path, "there is something already"),
        ("/dev/full", "/dev/full: there is something already"),
        (tmp_path / "none" / "run.mcap", r"none/run\.mcap: no folder .*none; make it first"),
    ):
        with pytest.raises(LogError, match=said):
            open_log(path)
    assert file.read_text() == "precious"
    file.write_text("")
    open_log(file).close()
    assert read_run(file).complete


@pytest.fixture
def limit_file_size():
    """Return a function that sets the largest size of a file of this process, which acts as a full disk."""
    resource = pytest.importorskip("resource", reason="limits of a process act as a full disk")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("probe", [writing.PROBE_BYTES, 10])  # too much, and what fits where the rest does not
def test_a_full_disk_is_noticed_before_the_run_starts_and_leaves_no_file(
    tmp_path, probe, monkeypatch, limit_file_size
):
    monkeypatch.setattr(writing, "PROBE_BYTES", probe)
    limit_file_size(100)
    with pytest.raises(LogError, match=r"run\.mcap: .*cannot be written \(File too large\); free"):
        open_log(tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


def test_a_disk_that_fills_up_stops_the_writing_with_its_reason(tmp_path, monkeypatch, limit_file_size):
    monkeypatch.setattr(writer, "MAX_BACKLOG", 1_000_000)
    log = open_log(tmp_path / "run.mcap")
    limit_file_size(200_000)
    with pytest.raises(LogError, match=r"run\.mcap: .*cannot be written \(File too large\); free the disk or"):
        write_all(log, 1_000_000)
    with pytest.raises(LogError, match="File too large"):
        log.close()
    run = read_run(tmp_path / "run.mcap")
    assert not run.complete
    assert len(run) > 20


def test_what_was_logged_outlives_the_process(tmp_path):
    """Killed while it writes: every cycle that was handed over is in the file, without a gap."""
    with running(WRITES, str(tmp_path / "run.mcap")) as process:
        kept = [int(process.stdout.readline()) for _ in range(4)]
        process.kill()
        process.wait()
    run = read_run(tmp_path / "run.mcap")
    assert not run.complete
    assert list(run.cycle) == list(range(len(run)))
    assert 0 == kept[0] < kept[1] < kept[-1] <= len(run)


def test_a_cycle_waits_no_longer_because_more_follow(tmp_path, monkeypatch):
    """By a clock that passes by 10 ms each time it is read, while all cycles wait already."""
    clock, queued, written, flushed = itertools.count(0.0, 0.01), threading.Event(), [], []
    message, flush = McapWriter.message, McapWriter.flush
    simulated = SimpleNamespace(perf_counter=lambda: next(clock), sleep=lambda seconds: None, time_ns=time.time_ns)
    monkeypatch.setattr(writer, "time", simulated)
    monkeypatch.setattr(
        McapWriter, "message", lambda *words: (queued.wait(TIMEOUT_S), message(*words), written.append(words[1]))
    )
    log = open_log(tmp_path / "run.mcap")
    monkeypatch.setattr(McapWriter, "flush", lambda file: (flush(file), flushed.append(written.count("cycle"))))
    write_all(log, 200)
    queued.set()
    log.close()
    assert max(np.diff([0, *flushed, 200])) <= writer.FLUSH_S / 0.02


def test_a_disk_that_does_not_keep_up_is_an_error(tmp_path, monkeypatch):
    disk = threading.Event()
    monkeypatch.setattr(writer, "MAX_BACKLOG", 50)
    monkeypatch.setattr(McapWriter, "message", lambda *_: disk.wait(TIMEOUT_S))
    log = open_log(tmp_path / "run.mcap")
    with pytest.raises(LogError, match="does not keep up; 50 cycles wait"):
        write_all(log, 100)
    disk.set()
    with pytest.raises(LogError, match="does not keep up"):
        log.close()


def test_events_come_from_any_thread_until_the_log_is_closed(tmp_path):
    log = open_log(tmp_path / "run.mcap")
    threads = [
        threading.Thread(target=log.note, args=(RunEvent(-1, 0.0, "fault", str(i), "x- y+"),)) for i in range(20)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    log.close()
    log.close()
    with pytest.raises(LogError, match="is closed"):
        log.note(RunEvent(-1, 0.0, "late", "too late"))
    events = read_run(tmp_path / "run.mcap").events
    assert sorted(int(event.text) for event in events) == list(range(20))
    assert {event.module for event in events} == {"x- y+"}
