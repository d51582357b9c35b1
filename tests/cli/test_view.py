"""`tensionlab view` and `--view`, without a browser; `tests/viewer` has what they show."""

import signal
import threading
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import tensionlab as tl
from tensionlab.cli.view import _watcher
from tensionlab.errors import HardwareError
from tensionlab.viewer import live

RIG = "bartels2026-validation"


def test_of_several_runs_one_is_named_by_its_rig(run, monkeypatch):
    closed = []

    class Watched:
        def __init__(self, name):
            self.info = SimpleNamespace(rig=tl.load_rig(name), program="python my_run.py")

        def close(self):
            closed.append(self.info.rig.name)

    monkeypatch.setattr("tensionlab.cli.view.find_runs", lambda: [Watched("floor-3"), Watched(RIG)])
    status, _, err = run("view", "--live")
    assert status == 2
    said = "2 runs are in progress; name the rig of one of them (floor-3: python my_run.py; "
    assert said in " ".join(err.split())
    assert closed == ["floor-3", RIG]
    assert _watcher(RIG)[1] == RIG
    assert closed[2:] == ["floor-3"]


def test_a_run_whose_rig_only_its_program_knows_is_found_by_that_name(run, monkeypatch):
    rig = replace(tl.load_rig(RIG), name="mine")
    watched = Mock(info=SimpleNamespace(rig=rig, program="python my_run.py"))
    monkeypatch.setattr("tensionlab.cli.view.find_runs", lambda: [watched])
    assert _watcher("mine") == (watched, "mine")
    said = " ".join(run("view", "--live", RIG)[2].split())
    assert f'none of your processes has a run in progress of "{RIG}"; there are runs of mine' in said
    assert "nowhere.toml" in run("view", "--live", "nowhere.toml")[2]


def test_ctrl_c_ends_the_design_page_also_where_the_system_hands_it_to_another_thread(run, monkeypatch):
    """The main thread is not woken then, and has to look for itself."""

    def open_page(*words, **options):
        threading.Timer(0.2, lambda: signal.pthread_kill(threading.get_ident(), signal.SIGINT)).start()

    monkeypatch.setattr("tensionlab.cli.view.open_page", open_page)
    status, _, err = run("view", RIG)
    assert status == 130
    assert "the same command shows the file's rig again" in err


@pytest.mark.parametrize(
    "words",
    [("run", RIG, "--seconds", "1"), ("scenario", "recoil"), ("serve", RIG, "--port", "0", "--seconds", "1")],
)
def test_a_page_that_cannot_be_opened_is_said_before_anything_pulls(words, run, monkeypatch):
    def fail():
        raise HardwareError("the view cannot be opened: it is raining")

    monkeypatch.setattr(live, "open_page", fail)
    for reach in ("run.reach_modules", "serve.reach_modules", "scenario.simulate_modules"):
        monkeypatch.setattr(f"tensionlab.cli.{reach}", lambda *words, **options: pytest.fail("it was reached"))
    status, _, err = run(*words, "--view")
    assert status == 2
    assert "the view cannot be opened: it is raining" in err


@pytest.mark.parametrize(
    ("script", "reason"),
    [('echo \'{"error": "no viser"}\'', "no viser"), ("exit 3", "its process has ended at once")],
)
def test_a_page_whose_process_fails_is_an_error_with_its_reason(script, reason, monkeypatch, tmp_path):
    program = tmp_path / "python"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o700)
    monkeypatch.setattr(live.sys, "executable", str(program))
    with pytest.raises(HardwareError, match=f"the view cannot be opened: {reason}"):
        live.open_page()
    live._started.pop().wait()
