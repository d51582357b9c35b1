"""The headers for C++: strict compilation, no heap, and what a status promises in float, by exact arithmetic."""

from __future__ import annotations

import functools
import shutil
import subprocess
from fractions import Fraction
from math import isqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import tensionlab as tl
from tensionlab import _native
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, problem_of, problem_set
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE
from tests.helpers.shared import make_once

ROOT = Path(__file__).parents[2]
STRICT = ["-std=c++17", "-O1", "-fno-exceptions", "-fno-rtti", "-Wall", "-Wextra", "-Wconversion",
          "-Wdouble-promotion", "-Werror"]  # fmt: skip
SHAPES = ((3, 4), (3, 8), (6, 8))
TOLERANCE = {"float": 1e-3, "double": 1e-6}
ROUNDING = 1 + 1e-6  # of the tolerance itself in float
EXACT, NEAREST, UNPROVEN = map(int, (tl.Status.EXACT, tl.Status.NEAREST, tl.Status.UNPROVEN))
# Largest share of answers without a proof; the direction policy in float meets edges that it can't tell apart.
MOST_UNPROVEN = {"force": 0.005, "tension": 0.005, "direction": 0.05}


class Answers(NamedTuple):
    tensions: np.ndarray
    wrench: np.ndarray
    separation: np.ndarray
    status: np.ndarray
    iterations: np.ndarray
    scale: np.ndarray


class Problems(NamedTuple):
    """Problems of one shape, whose numbers are all of single precision."""

    structure: np.ndarray
    wrench: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    reference: np.ndarray


@functools.cache
def problems(n: int, m: int, count: int) -> Problems:
    """All groups of this shape of the benchmark's sets, near-singular and infeasible ones among them."""
    groups = [group for name in PROBLEM_SETS for group in problem_set(name, count, seed=5).groups]
    parts = [problem_of(group).arrays[:5] for group in groups if group.structure.shape[1:] == (n, m)]
    return Problems(*(np.concatenate(part).astype(np.float32).astype(float) for part in zip(*parts, strict=True)))


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    compiler = shutil.which("c++")
    assert compiler is not None, "no C++ compiler 'c++' was found; the package itself needs one to build"
    source = ROOT / "tests" / "data" / "allocator.cpp"

    def compile_to(folder: Path) -> None:
        words = [*STRICT, f"-I{tl.get_include()}", str(source), "-o", str(folder / "program")]
        subprocess.run([compiler, *words], check=True)

    return make_once(tmp_path_factory, "allocator", compile_to) / "program"


def solve(program: Path, given: Problems, precision: str, policy: str, limit: int = 0) -> Answers:
    size, n, m = given.structure.shape
    words = [precision, n, m, POLICIES.index(policy), limit]
    kind = np.float32 if precision == "float" else np.float64
    content = np.column_stack([given.structure.reshape(size, -1), *given[1:]]).astype(kind).tobytes()
    done = subprocess.run([str(program), *map(str, words)], input=content, stdout=subprocess.PIPE, check=True)
    table = np.frombuffer(done.stdout, kind).reshape(size, -1).astype(float)
    tensions, wrench, separation, rest = np.split(table, [m, m + n, m + 2 * n], axis=1)
    return Answers(tensions, wrench, separation, rest[:, 0].astype(int), rest[:, 1].astype(int), rest[:, 3])


def as_integers(numbers: np.ndarray) -> np.ndarray:
    """Numbers of single precision times 2^170, exactly."""
    mantissas, exponents = np.frexp(numbers)
    whole = np.ldexp(mantissas, 53).astype(np.int64).astype(object)
    shifts = np.where(mantissas == 0, 0, exponents.astype(int) - 53 + 170)
    assert (shifts >= 0).all()
    return whole << shifts.astype(object)


def check_in_rationals(given: Problems, found: Answers, policy: str) -> None:
    """What EXACT and NEAREST say of the numbers as they are, without any rounding."""
    one, tolerance = 1 << 340, Fraction(TOLERANCE["float"] * ROUNDING)
    W, w, lower, upper = map(as_integers, given[:4])
    t, d = as_integers(found.tensions), as_integers(found.separation)
    assert ((t >= lower) & (t <= upper)).all()
    rendered = (W * t[:, None, :]).sum(axis=2)  # times 2^340, as is what is missing
    missing = ((w << 170) - rendered) ** 2
    pull = (W * d[:, :, None]).sum(axis=1)
    margin = (d * (w << 170)).sum(axis=1) - (pull * np.where(pull > 0, upper, lower)).sum(axis=1)
    for row in np.flatnonzero(found.status == EXACT):
        assert missing[row].sum() <= tolerance**2 * max(one**2, ((w[row] << 170) ** 2).sum())
    for row in np.flatnonzero(found.status == NEAREST):
        assert margin[row] > 0
        if policy == "force":  # no tensions have an error below margin / |d|
            error, length = isqrt(missing[row].sum()) + 1, isqrt((d[row] ** 2).sum()) + 1
            allowed = tolerance * max(one, isqrt((rendered[row] ** 2).sum()))
            assert (error - allowed) * length <= margin[row]


@pytest.mark.slow
@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize(("n", "m"), SHAPES)
def test_in_float_every_status_holds_exactly_and_double_agrees(program, n, m, policy):
    given = problems(n, m, 9_000)
    found, double = (solve(program, given, precision, policy) for precision in ("float", "double"))
    assert len(found.status) > 10_000
    assert np.isin(double.status, (EXACT, NEAREST)).all()
    assert (found.status <= UNPROVEN).all()
    assert np.mean(found.status == UNPROVEN) <= MOST_UNPROVEN[policy]
    check_in_rationals(given, found, policy)
    # The same verdicts by the verifier of the package, in double.
    tensions, separation = found.tensions.copy(), found.separation.copy()
    rule, tolerance = 1 + POLICIES.index(policy), TOLERANCE["float"] * ROUNDING
    verdicts = _native.verify((*given, np.ones(n)), tensions, separation, rule, tolerance, RANK_TOLERANCE)[2]
    proved = found.status < UNPROVEN
    assert np.array_equal(verdicts[proved], found.status[proved])


@pytest.mark.parametrize(("n", "m"), SHAPES)
@pytest.mark.parametrize("policy", POLICIES)
def test_in_double_it_answers_as_the_package_does(program, n, m, policy):
    given = problems(n, m, 120)
    found = solve(program, given, "double", policy)
    expected = tl.allocate(given.structure, given.wrench, given[2:4], policy=policy)
    assert np.array_equal(found.status, expected.status)
    np.testing.assert_allclose(found.wrench, expected.wrench, rtol=1e-6, atol=2e-6)


@pytest.mark.parametrize("precision", ["float", "double"])
@pytest.mark.parametrize("policy", POLICIES)
def test_at_the_iteration_limit_tensions_are_inside_the_limits(program, policy, precision):
    given = problems(6, 8, 60)
    unlimited = solve(program, given, precision, policy)
    for limit in (1, 2, 3, 5, 8, 13, 50):
        found = solve(program, given, precision, policy, limit)
        assert ((found.tensions >= given.lower) & (found.tensions <= given.upper)).all()
        assert found.iterations.max() <= 2 * limit + 4 * 6 + 4
        worse = found.status != unlimited.status
        assert (found.status[worse] == UNPROVEN).all()


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e7])
def test_a_number_out_of_range_fails_at_the_lower_limits(program, wrong):
    given = problems(3, 4, 8)
    structure = given.structure.copy()
    structure[0, 1, 2] = wrong
    found = solve(program, given._replace(structure=structure), "float", "force")
    assert found.status[0] == tl.Status.FAILED
    assert np.array_equal(found.tensions[0], given.lower[0])
    assert (found.status[1:] != tl.Status.FAILED).all()


def test_it_never_asks_for_memory(program):
    symbols = subprocess.run(["nm", "-C", "-u", str(program)], check=True, capture_output=True, text=True).stdout
    assert "fread" in symbols
    for name in ("malloc", "operator new", "free", "__cxa_throw"):
        assert not any(line.split()[-1].startswith(name) for line in symbols.splitlines() if line), name
