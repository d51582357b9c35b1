"""The numbered examples run, say something, and stay short."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("[0-9][0-9]_*.py"))


def test_there_are_twelve_from_one_allocation_to_a_run():
    assert [path.name[:2] for path in EXAMPLES] == [f"{number:02}" for number in range(1, 13)]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_is_short(path, tmp_path, monkeypatch, capfd):
    assert len(path.read_text(encoding="utf-8").splitlines()) < 60
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    said, complained = capfd.readouterr()
    assert said.strip()
    assert complained == ""
    assert not list(tmp_path.iterdir())


def test_an_example_runs_in_a_process_of_its_own(tmp_path):
    kept = os.environ | {"PYTHONWARNINGS": "error"}
    done = subprocess.run(
        [sys.executable, EXAMPLES[-1]], cwd=tmp_path, env=kept, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip()
