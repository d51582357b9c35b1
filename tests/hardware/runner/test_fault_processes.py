"""What can go wrong in a run that takes real processes: hosts and modules that are killed, or frozen.

Judged by what the modules do, and by their own clocks. `test_faults.py` has what can be shown without processes.
"""

import signal
import subprocess
from pathlib import Path

import pytest

import tensionlab as tl
from benchmarks.processes import command, process, simulated
from tensionlab.hardware.protocol.codes import State
from tests.helpers.serving import ROW_S, TIMEOUT_S, ServedRig

PATH = Path(__file__).parents[3] / "datasets" / "rigs" / "bartels2026-validation.toml"
RIG = tl.load_rig(PATH)
TTL, CYCLE, TAUT = 1.0, 0.02, 0.5


@pytest.fixture
def rig():
    with ServedRig(RIG) as served:
        yield served


def host(links, folder):
    """Run `tensionlab run` on these modules until it is ended."""
    file = folder / "modules.toml"
    file.write_text("[modules]\n" + "".join(f'{name} = "{url}"\n' for name, url in links.items()))
    return process("run", PATH, "--modules", file, "--force", 0, 0, 0.5, "--ttl", TTL)


def wait_for_running(rig):
    """Wait until all modules follow set-points that pull with more than the minimum tension in one of them."""
    rig.wait_for(lambda row: set(row.states) == {State.RUNNING} and max(row.tensions) > TAUT + 0.3)


def assert_released(rig, since):
    """All tensions are at the minimum or off at ttl and a cycle after a time, by the modules' own clocks."""
    due = since + TTL + CYCLE + 0.02 + ROW_S  # the server may be so late with the last set-points, and with a row
    rig.wait_for(lambda row: row.time > due + 0.5)
    assert max(max(row.tensions) for row in rig.rows if row.time >= due) <= TAUT + 1e-3


@pytest.mark.realtime  # a host is killed with -9
def test_a_host_that_is_killed(rig, tmp_path):
    with host(rig.links, tmp_path) as running:
        wait_for_running(rig)
        running.kill()
        running.wait()
        assert_released(rig, rig.now)


@pytest.mark.realtime  # a host is frozen
def test_a_host_that_hangs(rig, tmp_path):
    with host(rig.links, tmp_path) as running:
        wait_for_running(rig)
        running.send_signal(signal.SIGSTOP)
        assert_released(rig, rig.now)
        running.send_signal(signal.SIGCONT)  # when it comes back, it finds out, and ends
        assert running.wait(TIMEOUT_S) == 1
        said = running.stderr.read()  # depending on which it notices first
        assert "has released its cable (TIMEOUT)" in said or "has been silent for" in said


@pytest.mark.realtime  # a process of a module is killed with -9
def test_a_module_whose_process_is_killed(tmp_path):
    with (
        ServedRig(RIG, ("floor-1", "floor-2", "floor-3")) as rig,
        simulated(PATH, "--only", "top") as (one, top),
        host({**rig.links, **one}, tmp_path) as running,
    ):
        wait_for_running(rig)
        top.kill()
        top.wait()
        since = rig.now
        assert running.wait(TIMEOUT_S) == 1
        assert "lost: top" in running.stdout.read()
        assert_released(rig, since)


@pytest.mark.realtime  # the command that stops a host in another process
def test_an_emergency_stop_from_elsewhere(rig, tmp_path):
    with host(rig.links, tmp_path) as running:
        wait_for_running(rig)
        subprocess.run(command("estop", "--modules", tmp_path / "modules.toml"), check=True, timeout=TIMEOUT_S)
        rig.wait_for(lambda row: set(row.states) == {State.ESTOP})
        assert running.wait(TIMEOUT_S) == 1
        assert "finished: emergency stop (from another terminal)" in running.stdout.read()
        end = rig.now
        rig.wait_for(lambda row: row.time > end + 0.1)
        begin = next(row.time for row in rig.rows if set(row.states) == {State.ESTOP})
        late = [row for row in rig.rows if row.time > begin + ROW_S]
        assert {row.states for row in late} == {(State.ESTOP,) * 4}
        assert {row.tensions for row in late} == {(0.0,) * 4}
