import json
import re
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tensionlab.benchmark import experiment


@pytest.fixture
def bench(run, monkeypatch):
    """Run `tensionlab bench` in this process, briefly: exit status, stdout, stderr."""
    make = experiment.plan
    monkeypatch.setattr(experiment, "plan", lambda *words: replace(make(*words), seconds=0.01))
    return lambda *words: run("bench", *words)


def test_it_writes_table_report_figures_and_manifest(bench, tmp_path):
    out = tmp_path / "made" / "here"
    code, said, err = bench("--set", "point,trajectory", "--solvers", "newton", "--solvers", "daqp", "--count", 4,
                          "--seed", 4, "--quick", "--out", out)  # fmt: skip
    assert (code, err) == (0, "")
    names = ("pareto", "profile")
    assert {path.name for path in out.iterdir()} == {
        "results.parquet", "measurements.parquet", "report.md", "manifest.json", "figures",
    }  # fmt: skip
    assert sorted(path.name for path in (out / "figures").iterdir()) == sorted(
        f"{name}.{suffix}" for name in names for suffix in ("png", "pdf")
    )
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "## trajectory" in report
    assert "Seed 4" in report
    linked = re.findall(r"!\[.*?\]\((.*?)\)", report)
    assert len(linked) == 2
    assert all((out / name).is_file() for name in linked)
    lines = [line.split()[0] for line in said.splitlines() if line.startswith(("newton", "daqp"))]
    assert sorted(lines) == ["daqp,", "daqp,", "newton"]
    assert str(out / "report.md") in said


def test_an_entry_that_breaks_leaves_the_names_of_the_others(bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Breaks:
    objective = "none"
    policies = ()

    def solve(self, problem):
        raise ValueError("of a reason that takes " + "very " * 20 + "long to tell")
"""
    (tmp_path / "fable_breaks.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    code, said, _ = bench("--set", "edge", "--solvers", "fable_breaks:Breaks,newton", "--count", 6, "--quick")
    assert code == 0
    lines = said.splitlines()
    assert max(map(len, lines[:8])) <= 120
    assert any(line.startswith("newton ") and "100 %" in line for line in lines)
    assert any(line.startswith("fable_breaks:Breaks: ") and "of a reason" in line for line in lines)


def test_json_is_for_programs(bench):
    code, said, _ = bench("--set", "edge", "--solvers", "newton,closed-form", "--count", 6, "--quick", "--json")
    assert code == 0
    found = json.loads(said)
    solved = {entry["label"]: entry["solved_1e6"] for entry in found["entries"]}  # the fastest first
    assert set(solved) == {"newton", "closed-form"}
    assert solved["newton"] == 1.0
    assert found["sets"]["edge"]["reachable"] == "all"


def test_a_set_is_written_with_as_many_rows_as_asked_for(run, tmp_path):
    file = tmp_path / "point.parquet"
    code, out, _ = run("problems", "point", "--out", file, "--count", 30)
    assert code == 0
    assert "30 problems" in out
    assert pq.read_table(file).num_rows == 30


def test_submissions_are_ranked_in_a_table_markdown_and_json(run, tmp_path):
    submissions = Path(__file__).parents[2] / "benchmarks" / "submissions"
    code, out, _ = run("bench", "submit", submissions / "newton-c", "--out", tmp_path / "new.md")
    assert code == 0
    assert "1 newton-c   C" in out
    assert "| 1 | newton-c | C |" in (tmp_path / "new.md").read_text(encoding="utf-8")
    code, out, _ = run("bench", "submit", submissions / "newton-c", "--json")
    first = json.loads(out)["scores"][0]
    assert (first["track"], first["optimal_1e9"], first["jump"]) == ("edge-1", 1.0, None)
    code, _, err = run("bench", "submit", tmp_path)
    assert (code, err.count("\n")) == (2, 1)
    assert "no submission.toml in it" in err


def test_an_option_of_the_benchmark_that_is_there_twice_is_refused(run):
    code, _, err = run("bench", "--seed", 1, "--seed", 2)
    assert (code, err) == (2, "tensionlab: --seed: it is there twice; give it once\n")
