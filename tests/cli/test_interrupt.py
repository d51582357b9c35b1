"""Ctrl-C, wherever it comes: exit status 130, and one line that says what is kept and how to go on."""

import importlib
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from tensionlab import __main__ as program
from tensionlab.cli.common import output
from tensionlab.hardware.client.links import OPENERS
from tensionlab.workspace.sweep.store import ZarrStore
from tests.helpers import runs

CUBE = "datasets/rigs/cube-8.toml"
SWEEP = f"workspace {CUBE} --box -0.4 0.4 -0.4 0.4 -0.4 0.4 --step 0.008 --metric capacity-margin"


def press(*_):
    """Press Ctrl-C."""
    raise KeyboardInterrupt


@pytest.fixture
def ctrl_c_at_once(monkeypatch):
    """Press Ctrl-C as soon as a verb says how far it is."""

    @contextmanager
    def progress(what):
        yield press

    monkeypatch.setattr(output, "progress", progress)


@pytest.mark.usefixtures("ctrl_c_at_once")
@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (f"compare {CUBE} --solvers newton --out rows.csv --plot rows.png", output.NOTHING_KEPT),
        ("layout search four-in-a-room --out rig.toml", output.NOTHING_KEPT),
        ("module calibrate gain sim: --mass 0.1", output.NOTHING_KEPT),
        (
            "validate --out measured --preset ideal",
            "measured forces are kept in the folder, and the same command continues with them",
        ),
    ],
)
def test_it_is_one_line_that_says_what_is_kept(run, tmp_path, monkeypatch, words, kept):
    words = words.replace(CUBE, str(Path(CUBE).absolute()))
    monkeypatch.chdir(tmp_path)
    runs.logged(tmp_path / "run.mcap", runs.four(), 4)
    code, out, err = run(*words.split())
    assert (code, out) == (130, "")
    assert err.splitlines()[-1] == f"tensionlab: interrupted: {kept}"
    assert {path.name for path in tmp_path.iterdir()} <= {"run.mcap", "measured"}


def test_a_sweep_is_resumed(run, tmp_path, monkeypatch):
    store, write, chunks = tmp_path / "a.zarr", ZarrStore.write, []

    def third(self, task, values):
        chunks.append(task)
        if len(chunks) == 3:
            press()
        write(self, task, values)

    monkeypatch.setattr(ZarrStore, "write", third)
    code, out, err = run(*SWEEP.split(), "--out", store)
    assert (code, out) == (130, "")
    resumes = f"tensionlab: interrupted: the same command resumes the sweep in {store}\n"
    assert err == resumes
    code, _, _ = run(*SWEEP.split(), "--out", store)
    assert (code, len(chunks)) == (0, 3 + 15)
    monkeypatch.setattr("tensionlab.cli.workspace.summary", press)
    assert run(*SWEEP.split(), "--out", store)[2] == resumes
    assert "with --out DIR.zarr, the same command resumes" in run(*SWEEP.split())[2]


def test_files_that_were_written_by_then_are_named(run, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.support.provenance.write_table", press)
    plot = tmp_path / "c.svg"
    words = ["compare", CUBE, "--solvers", "newton", "--directions", "fibonacci:2"]
    code, _, err = run(*words, "--plot", plot, "--out", tmp_path / "c.csv")
    said = f"tensionlab: interrupted: written: plot: {plot}; the same command writes the rest\n"
    assert (code, err) == (130, said)
    assert plot.exists()


def test_results_of_a_benchmark_outlive_its_report(run, bench_folder, monkeypatch):
    bench = importlib.import_module("tensionlab.cli.bench")
    monkeypatch.setattr(bench.experiment, "measure", lambda *_: None)
    monkeypatch.setattr(bench, "_write", press)
    code, _, err = run("bench", "--out", bench_folder)
    assert code == 130
    assert f"{bench_folder} has the results, but not all figures and the report" in err


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        ("module stop sim:", "which modules did it is not known; `tensionlab module info` shows how they are"),
        ("estop sim:", "NOT CONFIRMED that all have stopped; the same command again, or cut the motors' supply"),
    ],
)
def test_what_modules_did_is_not_claimed(run, monkeypatch, words, kept):
    monkeypatch.setitem(OPENERS, "sim:", press)
    assert run(*words.split()) == (130, "", f"tensionlab: interrupted: {kept}\n")


def test_while_the_program_is_imported_it_is_one_line(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "tensionlab.cli")

    class Pressing:
        find_spec = staticmethod(lambda name, *_: press() if name == "tensionlab.cli" else None)

    monkeypatch.setattr(sys, "meta_path", [Pressing, *sys.meta_path])
    with pytest.raises(SystemExit) as left:
        program.main()
    assert left.value.code == 130
    assert capsys.readouterr() == ("", "tensionlab: interrupted: nothing was begun\n")


def test_a_bridge_that_is_interrupted_before_its_run_says_so(run, monkeypatch):
    monkeypatch.setattr("tensionlab.cli.serve.reach_modules", press)
    status, _, err = run("serve", "bartels2026-validation", "--port", 0)
    assert (status, err) == (130, "tensionlab: interrupted: before the run began; no module pulls\n")
