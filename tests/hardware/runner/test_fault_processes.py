"""What can go wrong in a run that takes real processes: hosts and modules that are killed, hung, or two at once.

What the cables really pull with comes from the recording of the simulated modules.
"""

import csv
import signal
import subprocess
import time

import pytest

from benchmarks.processes import command, process, simulated

pytestmark = pytest.mark.realtime  # hosts that are killed

RIG = "datasets/rigs/bartels2026-validation.toml"
TTL, CYCLE = 0.25, 0.02
TAUT = 0.5
SLACK = 0.03
"""Time from one row of the recording to the next, in s, at most."""


def host(modules_file, *words):
    """Run `tensionlab run` on these modules until somebody ends it."""
    return process("run", RIG, "--modules", modules_file, "--force", 0, 0, 0.5, *words)


def rows(recording):
    with recording.open(encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    return [row for row in found if None not in row.values()]  # the last one may be half written


def wait_for_running(recording, modules=4, within=20.0):
    """Wait until all modules follow set-points that pull with more than the taut minimum in one of them."""
    end = time.time() + within
    while time.time() < end:
        latest = {row["module"]: row for row in rows(recording)[-3 * modules :]}
        running = [row for row in latest.values() if row["state"] == "RUNNING"]
        if len(running) == modules and max(float(row["commanded"]) for row in running) > TAUT + 0.3:
            return
        time.sleep(0.05)
    raise AssertionError("no run within the time")


def assert_let_go(recording, since, names=("floor-1", "floor-2", "floor-3")):
    """All tensions are at the taut minimum or off at ttl and a cycle after a time, by the modules' own clocks."""
    time.sleep(max(since + TTL + CYCLE + 5 * SLACK - time.time(), 0.0))
    for name in names:
        own = [row for row in rows(recording) if row["module"] == name]
        begin = next(float(row["own_time"]) for row in own if float(row["time"]) >= since)
        while float(own[-1]["own_time"]) < begin + TTL + CYCLE + 2 * SLACK:  # a busy machine: its time is slow
            time.sleep(0.05)
            own = [row for row in rows(recording) if row["module"] == name]
        late = [row for row in own if float(row["own_time"]) >= begin + TTL + CYCLE + SLACK]
        assert max(float(row["commanded"]) for row in late) <= TAUT + 1e-3


@pytest.fixture
def rig(tmp_path):
    """Yield a rig of simulated modules in a process of their own: modules file, recording."""
    words = (RIG, "--modules", tmp_path / "modules.toml", "--record", tmp_path / "record.csv")
    with simulated(*words):
        yield tmp_path / "modules.toml", tmp_path / "record.csv"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_host_that_is_killed_or_hangs(rig, number):
    modules, recording = rig
    with host(modules) as running:
        wait_for_running(recording)
        running.send_signal(number)
        assert_let_go(recording, time.time())
        if number == signal.SIGSTOP:  # when it comes back, it finds out, and ends
            running.send_signal(signal.SIGCONT)
            assert running.wait(15.0) == 1
            said = running.stderr.read()  # by what it hears first: that they let go, or nothing for too long
            assert "has released its cable (TIMEOUT)" in said or "has been silent for" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_host_that_is_told_to_end(rig, number):
    modules, recording = rig
    with host(modules) as running:
        wait_for_running(recording)
        running.send_signal(number)
        since = time.time()
        assert running.wait(10.0) == 0
        assert f"finished: signal {signal.Signals(number).name}" in running.stdout.read()
        assert_let_go(recording, since)
    assert {row["state"] for row in rows(recording)[-4:]} == {"IDLE"}


def test_an_emergency_stop_from_elsewhere(rig):
    modules, recording = rig
    with host(modules) as running:
        wait_for_running(recording)
        since = time.time()
        subprocess.run(command("estop", "--modules", modules), check=True, timeout=20.0)
        assert running.wait(10.0) == 1
        assert "finished: emergency stop" in running.stdout.read()
        assert {row["state"] for row in rows(recording)[-4:]} == {"ESTOP"}
        off = [row for row in rows(recording) if row["state"] == "ESTOP"]
        assert float(off[0]["time"]) > since
        # The first row of each may be from between the command and the firmware's next step.
        assert max(float(row["commanded"]) for row in off[2 * 4 :]) == 0.0


def test_a_second_host_is_refused_and_the_first_goes_on(rig):
    modules, recording = rig
    with host(modules) as first:
        wait_for_running(recording)
        with host(modules) as second:
            assert second.wait(15.0) == 2
            assert f"is in use by process {first.pid}" in second.stderr.read()
        assert first.poll() is None
        wait_for_running(recording)


def test_a_module_whose_process_is_killed(tmp_path):
    others = (RIG, "--only", "floor-1", "--only", "floor-2", "--only", "floor-3")
    with (
        simulated(*others, "--record", tmp_path / "record.csv") as (three, _),
        simulated(RIG, "--only", "top") as (one, top),
    ):
        modules = tmp_path / "modules.toml"
        links = "\n".join(f'{name} = "{url}"' for name, url in {**three, **one}.items())
        modules.write_text(f"[modules]\n{links}\n")
        with host(modules) as running:
            wait_for_running(tmp_path / "record.csv", 3)
            top.kill()
            top.wait()
            since = time.time()
            assert running.wait(10.0) == 1
            assert "lost: top" in running.stdout.read()
            assert_let_go(tmp_path / "record.csv", since)
