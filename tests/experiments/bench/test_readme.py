"""The README's comparison is the one that the committed results make."""

import subprocess
import sys
from pathlib import Path

import pytest

import tensionlab
from tensionlab.errors import ShapeError
from tensionlab.experiments.bench import results
from tensionlab.experiments.bench.readme import COMMITTED, END, START, filled, section

ROOT = Path(__file__).parents[3]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_committed_table_is_up_to_date():
    assert filled(README, results.read(ROOT / COMMITTED)) == README, (
        "run `python -m tensionlab.experiments.bench.readme` and commit README.md"
    )


def test_the_committed_results_are_small_and_whole():
    committed = results.read(ROOT / COMMITTED)
    assert (ROOT / COMMITTED / results.FILE).stat().st_size < 200_000
    assert {"newton", "daqp"} <= {row.solver for row in committed.rows}
    assert committed.batches
    assert committed.calls


def test_other_results_make_another_readme(bench_results):
    text = filled(README, bench_results)
    assert text != README
    assert section(bench_results) in text
    assert text.partition(START)[0] == README.partition(START)[0]
    assert text.partition(END)[2] == README.partition(END)[2]
    assert filled(text, results.read(ROOT / COMMITTED)) == README


def test_a_readme_without_the_section_is_refused(bench_results):
    with pytest.raises(ShapeError, match="no section"):
        filled("# tensionlab\n", bench_results)


def test_one_command_takes_a_run_into_the_repository(tmp_path, bench_folder, bench_results):
    (tmp_path / "README.md").write_text(f"# x\n{START}\nold\n{END}\ny\n", encoding="utf-8")
    package = str(Path(tensionlab.__file__).parents[1])
    command = [sys.executable, "-m", "tensionlab.experiments.bench.readme"]

    def call(*words):
        return subprocess.run([*command, *words], cwd=tmp_path, env={"PYTHONPATH": package, "PATH": ""},
                              capture_output=True, text=True, check=False)  # fmt: skip

    assert call(str(bench_folder)).returncode == 0
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert text == f"# x\n{START}\n\n{section(bench_results)}\n\n{END}\ny\n"
    assert (tmp_path / COMMITTED / "manifest.json").exists()
    assert call().returncode == 0
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == text
    wrong = call("nowhere")
    assert wrong.returncode == 2
    assert "no results of `tensionlab bench`" in wrong.stderr
