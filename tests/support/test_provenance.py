import csv
import importlib.metadata
import json
import platform
import re
import subprocess

import numpy as np
import pyarrow.parquet as pq
import pytest

import tensionlab as tl
from tensionlab.support import provenance

ROWS = [
    {"solver": "newton", "policy": "force", "exact": 3, "gap_max": 0.0},
    {"solver": "closed-form", "policy": None, "exact": 2, "gap_max": float("nan")},
]


def test_parquet_keeps_rows_and_manifest(tmp_path):
    path = tmp_path / "rows.parquet"
    manifest = provenance.manifest(["tensionlab", "compare", "my rig.toml"], seed=7)
    provenance.write_parquet(path, ROWS, manifest)
    table = pq.read_table(path)
    assert table.column_names == list(ROWS[0])
    read = table.to_pylist()
    assert read[0] == ROWS[0]
    assert read[1]["policy"] is None
    assert np.isnan(read[1]["gap_max"])
    assert json.loads(pq.read_schema(path).metadata[b"tensionlab"]) == manifest


@pytest.mark.parametrize("table", [ROWS, {name: [row[name] for row in ROWS] for name in ROWS[0]}])
def test_the_suffix_decides_the_format_of_a_table(tmp_path, table):
    provenance.write_table(tmp_path / "rows.csv", table, {})
    with (tmp_path / "rows.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [row["solver"] for row in read] == ["newton", "closed-form"]
    assert [row["policy"] for row in read] == ["force", ""]
    assert [row["gap_max"] for row in read] == ["0.0", ""]
    provenance.write_table(tmp_path / "rows.parquet", table, {"seed": 7})
    assert pq.read_table(tmp_path / "rows.parquet").column_names == list(ROWS[0])


def test_a_manifest_says_how_to_repeat_the_result():
    manifest = provenance.manifest(["tensionlab", "compare", "my rig.toml"], seed=7)
    assert manifest["call"] == "tensionlab compare 'my rig.toml'"
    assert manifest["seed"] == 7
    assert manifest["python"] == platform.python_version()
    assert manifest["versions"]["tensionlab"] == tl.__version__
    assert manifest["versions"]["numpy"] == np.__version__
    assert {"qpsolvers", "clarabel"} <= set(manifest["versions"])
    assert {"cvxpy", "cvxpy-base"} & set(manifest["versions"])
    assert manifest["processor"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", manifest["date"])
    assert provenance.manifest([])["seed"] is None


def test_a_package_that_is_only_on_the_path_says_its_version(monkeypatch):
    def nothing_is_installed(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", nothing_is_installed)
    assert provenance.manifest([])["versions"] == {"tensionlab": tl.__version__}


def test_the_commit_is_that_of_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert provenance.manifest([])["git_commit"] is None

    def git(*words):
        identity = ["-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "core.hooksPath=/dev/null"]
        return subprocess.run(
            ["git", *identity, *words], check=True, capture_output=True, text=True
        ).stdout.strip()

    git("init", "-q")
    (tmp_path / "a").write_text("1")
    git("add", "a")
    git("commit", "-q", "-m", "first")
    git("tag", "v1")
    head = git("rev-parse", "HEAD")
    assert provenance.manifest([])["git_commit"] == head
    (tmp_path / "a").write_text("2")
    assert provenance.manifest([])["git_commit"] == f"{head}-dirty"
