"""`tensionlab module calibrate`, on simulated modules of this process, and on files."""

import importlib
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensionlab.errors import CalibrationError
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.model.files import load_rig
from tensionlab.support.files.tables import read_table, table_text
from tests.helpers.reachable import ReachableRig

RIG = Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml"


@pytest.fixture
def run(run):
    """Run `tensionlab module calibrate` in this process: exit status, stdout, stderr."""
    return lambda *words: run("module", "calibrate", *words)


@pytest.fixture
def measured(tmp_path):
    """Lengths of a rig that was built with some centimetres of error, at known places."""
    rng = np.random.default_rng(1)
    nominal = load_rig(RIG)
    moved = nominal.anchors + rng.normal(0.0, 0.02, nominal.anchors.shape)
    true = replace(
        nominal, modules=tuple(replace(m, anchor=a) for m, a in zip(nominal.modules, moved, strict=True))
    )
    places = nominal.home + rng.uniform([-0.3, 0.0, -0.3], [0.3, 1.2, 0.3], (25, 3))
    lengths = true.lengths(places) + rng.normal(0.0, 1e-3, (25, 4))
    table = {m.name: lengths[:, j] for j, m in enumerate(nominal.modules)}
    (tmp_path / "lengths.csv").write_text(table_text(table))
    (tmp_path / "known.csv").write_text(table_text({**dict(zip("xyz", places.T, strict=True)), **table}))
    return tmp_path, true


def test_masses_on_a_simulated_module_tell_its_gain(run):
    code, out, err = run("gain", "sim:", "--mass", 0.1, "--mass", 0.2, "--repeat", 3, "--json")
    assert code == 0
    assert "a module with 3.3 N/A and a mass on its cable" in err
    found = json.loads(out)
    assert found["newton_per_ampere"]["value"] == pytest.approx(3.3, rel=0.02)
    assert found["newton_per_ampere_before"] == 3.0
    assert found["error_after"] < 0.02 < found["error_before"]
    assert len(found["balances"]) == 12
    assert found["written"] is False


def test_what_is_sure_is_written_and_what_is_vague_is_not(run, monkeypatch):
    code, out, _ = run("gain", "sim:", "--mass", 0.1, "--mass", 0.2, "--repeat", 3, "--write")
    assert code == 0
    assert "Written and saved" in out
    assert "tension for each ampere" in out
    monkeypatch.setattr(importlib.import_module("tensionlab.cli.module_calibrate"), "LARGEST_UNCERTAINTY", 1e-6)
    code, out, err = run("gain", "sim:", "--mass", 0.1, "--repeat", 2, "--write")
    assert code == 1
    assert "not written: N/A is only certain to" in err
    assert "Written" not in out


@pytest.mark.parametrize("known", [True, False])
def test_anchors_are_found_and_written(run, measured, known):
    folder, true = measured
    words = [RIG, folder / "known.csv", "--known"] if known else [RIG, folder / "lengths.csv"]
    code, out, _ = run("anchors", *words, "--out", folder / "new.toml")
    assert code == 0
    assert f"25 {'known' if known else 'unknown'} poses" in out
    new = load_rig(folder / "new.toml")
    old = load_rig(RIG)
    assert new.source.startswith(old.source)
    assert "anchors calibrated from 25" in new.source
    assert (new.name, new.description, new.home.tolist()) == (old.name, old.description, old.home.tolist())
    places = old.home + np.random.default_rng(9).uniform([-0.3, 0.0, -0.3], [0.3, 1.2, 0.3], (20, 3))
    # The truth's own place in the room is not seen at unknown poses: compare what is, how far places are apart.
    apart = [
        np.linalg.norm(np.diff(rig.forward_kinematics(true.lengths(places), places).position, axis=0), axis=1)
        for rig in (new, old, true)
    ]
    assert np.abs(apart[0] - apart[2]).max() < 0.006
    assert np.abs(apart[1] - apart[2]).max() > 0.01
    found = json.loads(run("anchors", *words, "--json")[1])
    assert found["misfit"]["before"] > 4 * found["misfit"]["held_out"] > found["misfit"]["after"]
    assert found["length_deviation"] == pytest.approx(1e-3, rel=0.3)


def test_constant_errors_of_lengths_are_found_if_asked(run, measured):
    folder, true = measured
    lines = (folder / "known.csv").read_text().splitlines()
    shifted = [[*map(float, line.split(","))] for line in lines[1:]]
    columns = np.array(shifted).T
    columns[3] += 0.05  # of the first module
    table = dict(zip(lines[0].split(","), columns, strict=True))
    (folder / "shifted.csv").write_text(table_text(table))
    words = [RIG, folder / "shifted.csv", "--known", "--json"]
    plain, found = (json.loads(run("anchors", *words, *more)[1]) for more in ([], ["--offsets"]))
    assert [each["length_offset"] for each in plain["modules"]] == [0.0] * 4
    offsets = [each["length_offset"] for each in found["modules"]]
    assert offsets == pytest.approx([0.05, 0.0, 0.0, 0.0], abs=0.015)
    off = [np.abs([each["anchor"] for each in one["modules"]] - true.anchors).max() for one in (plain, found)]
    assert off[1] < 0.3 * off[0]


# Behind links of their own, the cables' far ends stand still: only `sim:` hangs a mass on one.


@pytest.fixture
def urls(monkeypatch):
    """Links to the modules of the rig."""
    return ReachableRig(monkeypatch, load_rig(RIG)).urls


def test_lengths_are_told_and_recorded(run, tmp_path, urls, simulated_time):
    (tmp_path / "modules.toml").write_text(modules_to_toml(urls))
    code, out, err = run("lengths", RIG, "--modules", tmp_path / "modules.toml")
    assert code == 0, err
    assert "floor-2" in out
    assert "Hold the platform at (0, 0.3, 0) m" in err
    where = tmp_path / "lengths.csv"
    code, out, err = run("record", RIG, "--modules", tmp_path / "modules.toml", "--out", where, "--poses", 1)
    assert code == 0, err
    assert "1 poses" in out
    rig = load_rig(RIG)
    table = read_table(where, [module.name for module in rig.modules], error=CalibrationError)
    np.testing.assert_allclose([table[m.name][0] for m in rig.modules], rig.lengths(rig.home), atol=2e-3)


def test_a_mass_is_hung_on_by_a_person_and_refused_if_it_does_not_move(run, monkeypatch, urls):
    url = urls["top"]
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert "stdin ended before Enter was pressed; run this in a terminal" in run("gain", url, "--mass", 0.1)[2]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    monkeypatch.setattr("tensionlab.hardware.calibration.gain.SEARCH_N_S", 3.0)
    code, _, err = run("gain", url, "--mass", 0.1)
    assert code == 2
    assert "its cable does not reel in; is the mass heavier, or not free" in err
