"""`tensionlab scenario`, as somebody would use it who has just found it."""

import importlib
import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import tensionlab as tl
from tensionlab.hardware.log.reader import read_run
from tensionlab.scenarios import SCENARIOS
from tensionlab.scenarios.scenario import FOLDER


def test_list_shows_all(run):
    status, out, _err = run("scenario", "list")
    assert status == 0
    firsts = [line.split(" ")[0] for line in out.splitlines()]
    assert [word for word in firsts if word in SCENARIOS] == list(SCENARIOS)
    assert "proposals" in out
    assert [each["name"] for each in json.loads(run("scenario", "list", "--json")[1])] == list(SCENARIOS)


def test_the_bow_ends_with_a_verdict(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run("scenario", "bow", "--log", "bow.mcap")
    assert status == 0, err
    assert "Fidelity: rendered / desired" in out
    assert [file.name for file in tmp_path.iterdir()] == ["bow.mcap"], "nobody asked for another file"
    log = read_run("bow.mcap")
    assert len(log) == 1000
    assert log.complete
    assert {event.text for event in log.events if event.kind == "phase"} == {"draw", "full draw"}
    assert any(event.text == "locked: bow-hand" for event in log.events if event.kind == "brake")
    # All of the wrench that is asked for is the effects'; what modules render by themselves is in it.
    come = (log.time > 0.3) & (log.time < 1.5)  # forces come in at the start
    assert np.isfinite(log.impedances[come, 0, 0]).all()
    draw = np.maximum(log.lengths[come, 0] - 0.2, 0.0)
    assert np.linalg.norm(log.desired[come], axis=1) == pytest.approx(np.minimum(1.0 + 8.3 * draw, 6.0), abs=0.1)
    assert np.abs(log.solver_wrench[come]).max() < 0.1


def test_on_another_rig_what_it_needs_is_told_first(run, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.plots.plot_scenario", lambda played: Figure())
    words = ("--seconds", "0.3", "--plot", tmp_path / "it.png")
    status, out, err = run("scenario", "materials", "--rig", "seven-modules", *words)
    assert status == 0, err
    lines = out.splitlines()
    assert lines[0] == 'turned to have y up, as rig "seven-modules" has'
    assert lines[1] == 'Can seven-modules play "materials"?'
    needs = lines[: lines.index("")]
    assert [line.split()[1:3] for line in needs if line.startswith(("✓", "✗"))] == [
        ["yes", name] for name in ("reach", "magnetic", "textured", "shaped", "vibrating", "water")
    ]
    told = json.loads(run("scenario", "materials", "--rig", "seven-modules", *words, "--json")[1])
    assert told["rig"] == "seven-modules"
    assert "turned" in told["placement"]
    assert told["needs"][0]["name"] == "reach"


def test_it_is_played_where_the_hand_is(run):
    words = ("scenario", "materials", "--rig", "tetra-4", "--seconds", "0.2", "--facing", "1", "0", "0")
    status, out, err = run(*words, "--at", "0", "0", "0.2")
    assert status == 0, err
    assert out.startswith("placed at (0, 0, 0.2) m, facing (1, 0, 0), at 70 % of its size\n")
    status, out, err = run(*words, "--at", "0,0,0.3")
    assert (status, out) == (2, "")
    assert "start elsewhere (the rig's home is (0, 0, 0) m)" in err
    status, _, err = run(*words[:-3], "1", "0")
    assert status == 2
    assert 'at and facing have 3 components on rig "tetra-4"' in err


def test_a_rig_that_can_do_nothing_of_it_does_not_play(run, tmp_path):
    far = tl.load_rig("seven-modules")
    far = replace(
        far, home=far.home + 20.0, modules=tuple(replace(m, anchor=m.anchor + 20.0) for m in far.modules)
    )
    tl.save_rig(far, tmp_path / "far.toml")
    log = tmp_path / "it.mcap"
    status, out, err = run("scenario", "recoil", "--rig", tmp_path / "far.toml", "--log", log)
    assert status == 1
    assert 'rig "seven-modules" can do nothing of scenario "recoil"; give another --rig or --at' in err
    assert "the cables hold the hand 0 % of the time" in " ".join(out.split())
    assert not log.exists()


def test_what_was_not_rendered_as_desired_is_told(run, monkeypatch):
    play = importlib.import_module("tensionlab.scenarios.play").play

    def late(*words):
        played = play(*words)
        played.statistics.missed = 5
        return played

    monkeypatch.setattr(importlib.import_module("tensionlab.cli.scenario"), "play", late)
    status, out, err = run("scenario", "bow", "--seconds", 0.2)
    assert status == 0, err
    assert " NEAREST; NEAREST: what is desired is infeasible, and the nearest to it is rendered." in out
    assert "5 of 45 deadlines missed: forces came late" in out


def test_it_says_no_where_it_feels_otherwise(run, tmp_path, monkeypatch):
    """A single shot where tensions change slowly: its kick is too weak."""
    monkeypatch.setattr("tensionlab.plots.plot_scenario", lambda played: Figure())
    other = {"[1.0, 1.8, 2.6, 2.8, 4.2]": "[1.0]", "slew = 300.0": "slew = 10.0"}
    other |= {"seconds = 5.0": "seconds = 1.6", "end = 5.0": "end = 1.6"}
    for name in ("recoil.toml", "recoil.rig.toml"):
        text = (FOLDER / name).read_text()
        for old, new in other.items():
            assert old in text or "rig" in name
            text = text.replace(old, new)
        (tmp_path / name).write_text(text)
    words = [str(tmp_path / "recoil.toml"), "--plot", str(tmp_path / "recoil.png")]
    status, out, _err = run("scenario", *words)
    assert status == 1
    assert "✗" in out[out.index("Fidelity") :]
