"""`tensionlab scenario`, as somebody would use it who has just found it."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from tensionlab.hardware.log.reader import read_run
from tensionlab.scenarios import SCENARIOS
from tensionlab.scenarios.scenario import FOLDER


def test_list_shows_all(run):
    status, out, _err = run("scenario", "list")
    assert status == 0
    rows = out.splitlines()[4:]
    assert [line.split()[0] for line in rows if not line.startswith(" ")] == list(SCENARIOS)
    assert "proposals" in out
    assert [each["name"] for each in json.loads(run("scenario", "list", "--json")[1])] == list(SCENARIOS)


def test_the_bow_ends_with_a_picture_and_a_verdict(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run("scenario", "bow", "--log", "bow.mcap")
    assert status == 0, err
    assert "work of the draw" in out
    assert "Picture: scenario-bow.png" in out
    assert (tmp_path / "scenario-bow.png").read_bytes().startswith(b"\x89PNG")
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


def test_a_part_is_played_but_not_checked(run, tmp_path):
    picture = tmp_path / "part.svg"
    status, out, _err = run("scenario", "recoil", "--seconds", "0.6", "--plot", str(picture), "--json")
    assert status == 0
    told = json.loads(out)
    assert told["checks"] == []
    assert told["run"]["cycles"] == 120
    assert told["directions"]["unexplained"] == 0
    assert picture.read_text().startswith("<?xml")


def test_it_says_no_where_it_feels_otherwise(run, tmp_path, monkeypatch):
    """A single shot where tensions change slowly: its kick is too weak."""
    monkeypatch.setattr("tensionlab.plots.plot_scenario", lambda played, rows: Figure())
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
    assert "not met" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["bw"], "no scenario is called 'bw'; did you mean 'bow'? there are materials"),
        (["nothing.toml"], "no such file"),
        (["bow", "--seconds", "0"], "give a finite number above 0; got 0"),
        (["bow", "--seconds", "6"], "at most 5"),
        (["bow", "--solver", "nobody"], "nobody"),
        (["bow", "--solver", "closed-form"], "closed-form"),
        (["bow", "--plot", "bow.txt"], "bow.txt: unsupported format"),
        (["bow", "--osc", "9000"], "--osc is for real modules"),
        (["bow", "--modules", "socket://127.0.0.1:1"], "have a tracker send /body/hand, /body/bow"),
    ],
)
def test_bad_input_is_refused_before_anything_moves(run, words, said):
    status, _out, err = run("scenario", *words)
    assert status == 2
    assert said in " ".join(err.split())
