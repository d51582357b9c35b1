"""What holds for every compiled solver: threads, instruction sets, fixed cables, hyper-parameters."""

import os
import subprocess
import sys

import numpy as np
import pytest

from tensionlab import Allocation, Status, allocate, solvers
from tensionlab.errors import UnknownSolver
from tests.helpers.problems import random_cases

NAMES = ("newton", "dykstra", "pseudoinverse:middle", "closed-form", "puncture", "polygon", "least-sum", "minimax",
         "safe", "analytic-centre", "slack", "slack:3", "spidar")  # fmt: skip
RUNS = [(name, policy) for name in NAMES for policy in solvers.make(name).policies or (None,)]
SCRIPT = """
import sys, numpy as np, tensionlab as tl
from tensionlab import _native
data = np.load(sys.argv[1])
print(_native.INSTRUCTION_SET)
for word in sys.argv[3:]:
    name, _, policy = word.partition("/")
    found = tl.allocate(data["W"], data["w"], (data["a"], data["b"]), name, policy=policy or None)
    np.save(f"{sys.argv[2]}/{name.replace(':', '-')}-{policy}.npy", found.tensions)
"""


@pytest.mark.parametrize(("name", "policy"), RUNS)
def test_the_share_of_lanes_and_threads_does_not_change_an_answer(name, policy, monkeypatch):
    batch = random_cases(1, 3, 5, 4_000)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "1")
    one = allocate(batch.structure, batch.wrench, batch.limits, name, policy=policy).tensions
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    three = allocate(batch.structure, batch.wrench, batch.limits, name, policy=policy).tensions
    limits = (batch.lower[::-1], batch.upper[::-1])
    backwards = allocate(batch.structure[::-1], batch.wrench[::-1], limits, name, policy=policy).tensions
    np.testing.assert_array_equal(one, three)
    np.testing.assert_array_equal(one, backwards[::-1])


def test_every_instruction_set_gives_the_same_answers(tmp_path):
    batch = random_cases(2, 6, 8, 1000)
    np.savez(tmp_path / "problems.npz", W=batch.structure, w=batch.wrench, a=batch.lower, b=batch.upper)
    words = [f"{name}/{policy or ''}" for name, policy in RUNS]
    answers = {}
    for wish in ("baseline", "avx2", "avx512"):
        script = [sys.executable, "-c", SCRIPT, tmp_path / "problems.npz", tmp_path, *words]
        environment = {**os.environ, "TENSIONLAB_ISA": wish}
        taken = subprocess.run(script, env=environment, capture_output=True, text=True, check=True).stdout.strip()
        answers[taken] = {path.stem: np.load(path) for path in tmp_path.glob("*.npy")}
    assert len(answers["baseline"]) == len(RUNS)
    for answer in answers.values():
        for name, found in answer.items():
            # Where a search ends depends on the rounding of its last step.
            accuracy = {"analytic-centre-": 1e-6, "newton-direction": 1e-8}.get(name, 1e-9)
            np.testing.assert_allclose(found, answers["baseline"][name], rtol=0, atol=accuracy, err_msg=name)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "pseudoinverse:middle"])
def test_a_cable_with_equal_limits_pulls_what_it_must_and_the_others_do_not_mind(name):
    batch, rng = random_cases(3, 3, 4, 200), np.random.default_rng(3)
    alone = allocate(batch.structure, batch.wrench, batch.limits, name)
    column = rng.normal(size=(200, 3))
    structure = np.insert(batch.structure, 1, column, axis=2)
    limits = tuple(np.insert(each, 1, 1.5, axis=1) for each in batch.limits)
    found = allocate(structure, batch.wrench + 1.5 * column, limits, name)
    exact = (alone.status == Status.EXACT) | (name == "spidar")
    assert exact.sum() > 40
    np.testing.assert_allclose(found.tensions[exact], np.insert(alone.tensions, 1, 1.5, axis=1)[exact], atol=1e-6)
    fixed = allocate([[1.0, 1.0]], [9.0], ([2.0, 3.0], [2.0, 3.0]), name)
    np.testing.assert_array_equal(fixed.tensions, [2.0, 3.0])


@pytest.mark.parametrize(
    ("solver", "settings"),
    [
        ("Dykstra", {"tolerance": -1.0}),
        ("Dykstra", {"tolerance": float("nan")}),
        ("Dykstra", {"iteration_limit": 0}),
        ("SlackNorm", {"p": 1.5}),
        *(("SlackNorm", {name: 0.0}) for name in ("c1", "c2", "kappa", "epsilon", "gamma")),
        ("SlackNorm", {"kappa": float("nan")}),
        *(("Spidar", {name: 0.0}) for name in ("mu", "force", "torque")),
        *(("OptimallySafe", {"alpha": alpha}) for alpha in (-1.0, float("nan"), float("inf"))),
        ("Pseudoinverse", {"start": "lower"}),
        ("Polygon", {"goal": "3-norm"}),
        ("QuadraticProgram", {"backend": "cplex"}),
        ("ConvexProgram", {"backend": "MOSEK"}),
    ],
)
def test_hyper_parameters_that_mean_nothing_are_refused_by_name(solver, settings):
    with pytest.raises(
        (ValueError, UnknownSolver), match=str(*settings.values()) if "backend" in settings else str(*settings)
    ):
        getattr(solvers, solver)(**settings)


@pytest.mark.parametrize(
    ("name", "solver"),
    [
        ("slack:3", solvers.SlackNorm(p=3.0)),
        ("spidar:0.01", solvers.Spidar(mu=0.01)),
        ("safe:2", solvers.OptimallySafe(alpha=2.0)),
        ("polygon:1-norm", solvers.Polygon("1-norm")),
        ("qp:osqp", solvers.QuadraticProgram(backend="osqp")),
    ],
)
def test_a_word_after_a_colon_is_the_first_hyper_parameter(name, solver):
    assert solvers.make(name) == solver


def test_a_plain_problem_needs_no_preparation_and_every_other_one_does():
    structure, wrench, limits = np.array([[1.0, -1.0]]), [3.0], (1, 6.0)
    plain = solvers.Newton().unprepared(Allocation)
    for given in ((wrench, limits), (np.array(wrench), ([1, 1], [6.0, np.float64(6.0)]))):
        assert plain(structure, *given, None, None).tensions.tolist() == [4.0, 1.0]
    assert plain(structure, wrench, limits, "middle", "direction").tensions.tolist() == [5.0, 2.0]
    for other in (
        (structure[None], wrench, limits, None, None),
        (structure, (3.0,), limits, None, None),
        (structure, [3.0, 3.0], limits, None, None),
        (structure, [None], limits, None, None),
        (structure, [10**400], limits, None, None),
        (structure, [np.nan], limits, None, None),
        (structure, wrench, (1.0, True), None, None),
        (structure, wrench, (6.0, 1.0), None, None),
        (structure, wrench, limits, 0.0, None),
        (structure, wrench, limits, None, "forse"),
        (structure, wrench, limits, None, ["force"]),
    ):
        assert plain(*other) is None
    polygon = solvers.Polygon().unprepared(Allocation)
    assert polygon(np.ones((1, 3)), wrench, limits, None, None) is not None
    assert polygon(np.ones((1, 9)), wrench, limits, None, None) is None
