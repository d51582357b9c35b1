import json

import pyarrow.parquet as pq
import pytest


@pytest.fixture
def run(run):
    """Run `tensionlab problems` in this process: exit status, stdout, stderr."""
    return lambda *words: run("problems", *words)


def test_the_groups_of_a_set_are_shown_with_what_is_in_reach(run):
    _, out, _ = run("show", "published", "--json")
    groups = json.loads(out)["groups"]
    assert [group["feasible"] for group in groups] == [182, 153]
    assert [(group["problems"], group["components"], group["cables"]) for group in groups] == [(182, 3, 4)] * 2
    assert groups[0]["wrench_median"] == pytest.approx(1.5)
    code, out, _ = run("show", "near-singular", "--count", 400, "--seed", 2)
    assert code == 0
    assert "n = 6, m = 8" in out


def test_a_set_is_written_with_as_many_rows_as_asked_for(run, tmp_path):
    file = tmp_path / "point.parquet"
    code, out, _ = run("export", "--set", "point", "--out", file, "--count", 30)
    assert code == 0
    assert "30 problems" in out
    assert pq.read_table(file).num_rows == 30
