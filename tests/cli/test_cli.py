import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import typer

import tensionlab as tl
from tensionlab import _native
from tensionlab.cli import VERBS, app, join_numbers
from tensionlab.cli.common import output
from tensionlab.solvers import registry

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
PUBLISHED = str(RIGS / "bartels2026-validation.toml")
NARROW = str(RIGS / "bartels2026-validation-0.3m.toml")
CUBE = str(RIGS / "cube-8.toml")
KEYS = """
solver policy exact nearest_count unproven failed residual_mean residual_max angle_mean_deg
angle_max_deg tension_sq_mean tension_max jump jump_beyond step_max
iterations_max gap_max call_median_s call_p99_s batch_s
"""


def program(*words):
    return subprocess.run(
        [sys.executable, "-m", "tensionlab", *words], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize("name", VERBS)
def test_help_says_of_each_verb_what_the_verb_says_of_itself(name):
    said = typer.main.get_command(app).get_command(None, name).help.partition("\n")[0]
    assert said.startswith(VERBS[name][1])


def test_help_lists_the_verbs_without_the_slow_libraries():
    done = program("--help")
    assert done.returncode == 0
    assert all(verb in done.stdout for verb in ("compare", "allocate", "rig", "solvers"))
    slow = ["matplotlib", "pyarrow", "cvxpy", "rich.table"]
    script = f"import sys, tensionlab.cli; print([name for name in {slow} if name in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"


def test_the_widest_table_fits_120_columns_of_a_pipe(run):
    code, out, _ = run(
        "compare", RIGS / "ipanema-1.toml", "--solvers", "newton,pseudoinverse:reference", "--magnitude", "400"
    )
    assert code == 0
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 120


def test_compare_writes_json_a_picture_and_a_table_with_its_manifest(run, tmp_path):
    plot, out_file = tmp_path / "c.png", tmp_path / "c.parquet"
    code, out, err = run(
        "compare", NARROW, "--solvers", "newton,closed-form", "--plot", plot, "--out", out_file, "--json"
    )  # fmt: skip
    assert (code, err) == (0, "")
    report = json.loads(out)
    assert report["rig"] == "bartels2026-validation-0.3m"
    assert [list(row) for row in report["rows"]] == [KEYS.split()] * 4
    first = report["rows"][0]
    assert [first[key] for key in KEYS.split()[:4]] == ["newton", "force", 153, 29]
    assert report["rows"][3]["policy"] is None
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert output.plain(pq.read_table(out_file).to_pylist()) == report["rows"]
    manifest = json.loads(pq.read_schema(out_file).metadata[b"tensionlab"])
    assert manifest == report["manifest"]
    assert manifest["versions"]["tensionlab"] == tl.__version__


def test_solvers_named_in_several_options_all_count_and_one_without_the_policy_is_left_out(run):
    words = ["compare", CUBE, "--solvers", "newton", "--solvers", "dykstra,spidar", "--policy", "force", "--json"]
    code, out, _ = run(*words)
    report = json.loads(out)
    assert (code, [row["solver"] for row in report["rows"]]) == (0, ["newton"])
    assert report["left_out"].keys() == {"dykstra", "spidar"}
    assert "it supports 'tension'" in report["left_out"]["dykstra"]


def test_what_does_not_serve_the_rig_is_left_out_with_a_reason_and_refused_by_name(run, monkeypatch):
    monkeypatch.setattr(
        registry, "every_solver", lambda: {"newton": True, "polygon:1-norm": True, "qp:osqp": False}
    )
    reason = "8 cables for 3 wrench components have redundancy 5, and a polygon has 2 dimensions"
    code, out, _ = run("compare", CUBE)
    assert code == 0
    assert f"left out: polygon:1-norm, {reason}" in out
    assert "left out: qp:osqp, not installed" in out
    code, out, _ = run("compare", CUBE, "--json")
    assert json.loads(out)["left_out"] == {"polygon:1-norm": reason, "qp:osqp": "not installed"}
    for words in (["compare", CUBE, "--solvers"], ["allocate", CUBE, "--wrench", "0 1 0", "--solver"]):
        code, _, err = run(*words, "polygon")
        assert code == 2
        assert "redundancy 5" in err


def test_allocate_renders_what_it_says(run):
    code, out, _ = run(
        "allocate", PUBLISHED, "--at", "0.05", "0.3", "-0.1", "--wrench", "0", "-0.5", "-1.5", "--json"
    )
    report = json.loads(out)
    rig = tl.load_rig(PUBLISHED)
    structure = rig.structure_matrix([0.05, 0.3, -0.1])
    assert code == 0
    assert report["status"] == "EXACT"
    assert report["modules"] == ["floor-1", "floor-2", "floor-3", "top"]
    np.testing.assert_allclose(structure @ report["tensions"], [0.0, -0.5, -1.5], atol=1e-9)
    assert report["tensions"] == list(tl.allocate(structure, [0.0, -0.5, -1.5], rig.limits).tensions)


def test_allocate_turns_the_platform(run):
    """The weight's torque turns with the centre of mass."""
    words = ("allocate", "cogiro", "--wrench", "0 0 0 0 0 0", "--rotation", "0 0 0.3")
    code, out, _ = run(*words, "--json")
    report, rig = json.loads(out), tl.load_rig("cogiro")
    turn = np.array(report["rotation"])
    np.testing.assert_allclose(turn[0, :2], [np.cos(0.3), -np.sin(0.3)])
    np.testing.assert_allclose(report["wrench_desired"], -rig.gravity(turn))
    rendered = rig.structure_matrix(rig.home, turn) @ report["tensions"]
    np.testing.assert_allclose(rendered, report["wrench_desired"], atol=1e-6)
    assert code == 0
    assert "cogiro at (0, 0, 2) m, turned by (0, 0, 0.3) rad" in run(*words)[1]
    assert "--rotation has 1 component; cogiro needs 3: rx (rad)" in run(*words[:-1], "1")[2]
    assert "cube-8 is a point rig and cannot turn" in run("allocate", CUBE, "--wrench", "0 0 1", *words[-2:])[2]


def test_allocate_exits_with_1_where_the_wrench_is_not_rendered(run):
    for policy, words in (("force", "nearest in force"), ("direction", "90.47 % of it")):
        code, out, err = run("allocate", NARROW, "--wrench", "-1.5", "0", "0", "--policy", policy)
        assert (code, err) == (1, "")
        assert all(word in out for word in (words, "certified infeasible", "at its lower limit"))
    code, out, _ = run("allocate", NARROW, "--wrench", "-1.5", "0", "0", "--policy", "direction", "--json")
    report = json.loads(out)
    assert code == 1
    assert report["status"] == "NEAREST"
    assert 0 < report["scale"] < 1
    np.testing.assert_allclose(report["wrench_rendered"], report["scale"] * np.array([-1.5, 0, 0]), atol=1e-6)


@pytest.mark.parametrize(
    ("words", "joined"),
    [
        ("--at 0 -0.1 0.3 rig.toml", "--at 0,-0.1,0.3 rig.toml"),
        ("--at -.5,1e-3 -2 --json", "--at -.5,1e-3,-2 --json"),
        ("--at=-1 -2 --wrench -1 0", "--at=-1,-2 --wrench -1,0"),
        ("--wrench one 0 0 --at 0", "--wrench one,0,0 --at 0"),
        ("--at 0 zero 0 rig.toml", "--at 0,zero,0 rig.toml"),
        ("--magnitude 2 3", "--magnitude 2 3"),
        ("--wrench", "--wrench"),
        ("--at 1 2 3d.toml", "--at 1,2 3d.toml"),
    ],
)
def test_numbers_after_an_option_become_one_word(words, joined):
    assert join_numbers(words.split()) == joined.split()


def test_version(run):
    version, kernels = run("--version")[1].splitlines()
    assert version == f"tensionlab {tl.__version__}"
    assert _native.COMPILER in kernels
    assert kernels.endswith(f"uses {_native.INSTRUCTION_SET}")
