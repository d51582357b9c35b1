"""The library in C and the headers for C++: installed, found by another project, and equal to Python's answers."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, problem_of, problem_set
from tensionlab.solvers.base import POLICIES
from tests.helpers.shared import make_once

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "cpp"
SUBMISSIONS = ROOT / "benchmarks" / "submissions"
COUNT = 4_900  # problems of a set: 10^5 in all, with three policies
pytestmark = pytest.mark.slow  # it compiles the kernels


def run(*words: object, **options: object) -> str:
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr[-4000:] + done.stdout[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def prefix(tmp_path_factory) -> Path:
    """Where the library is installed, for this processor."""
    for tool in ("cmake", "c++"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")

    def install(folder: Path) -> None:
        options = ("-DTENSIONLAB_BUILDS=native", "-DCMAKE_INSTALL_LIBDIR=lib")
        run("cmake", "-S", ROOT, "-B", folder / "build", f"-DCMAKE_INSTALL_PREFIX={folder / 'prefix'}", *options)
        run("cmake", "--build", folder / "build", "--parallel", os.cpu_count())
        run("cmake", "--install", folder / "build")

    return make_once(tmp_path_factory, "library", install) / "prefix"


@pytest.fixture(scope="module")
def library(prefix) -> Path:
    return next(path for path in (prefix / "lib").glob("libtensionlab.*") if path.suffix in {".so", ".dylib"})


@pytest.fixture(scope="module")
def programs(prefix, tmp_path_factory) -> Path:
    """Where the examples are built, as another project."""

    def build(folder: Path) -> None:
        run("cmake", "-S", EXAMPLES, "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}")
        run("cmake", "--build", folder)

    return make_once(tmp_path_factory, "programs", build)


class Result(ctypes.Structure):
    _fields_ = (
        ("wrench", ctypes.c_double * 6),
        ("separation", ctypes.c_double * 6),
        ("residual", ctypes.c_double),
        ("scale", ctypes.c_double),
        ("iterations", ctypes.c_int),
    )


def test_another_project_finds_it_and_all_languages_agree(programs, library):
    shown = re.compile(r"(exact|nearest).*: tensions ([\d. ]+) N render")
    floats, doubles = run(programs / "allocate"), run(programs / "allocate_c")
    assert run(programs / "allocate_c_static") == doubles
    assert f"tensionlab {tl.__version__}" in doubles
    answers = [" ".join(answer) for answer in shown.findall(doubles)]
    assert [" ".join(answer) for answer in shown.findall(floats)] == answers
    assert run(sys.executable, EXAMPLES / "allocate_ctypes.py", library).splitlines() == [answers[0], answers[2]]


def test_a_submission_in_c_is_on_the_leaderboard(programs, tmp_path):
    for name in ("newton-c", "dykstra"):
        shutil.copytree(SUBMISSIONS / name, tmp_path / "all" / name)
    mine = (tmp_path / "all" / "newton-c").rename(tmp_path / "all" / "mine")
    for file in mine.glob("*.npz"):
        problems, answers = tmp_path / file.stem / "problems", tmp_path / file.stem / "answers"
        shutil.unpack_archive(tl.datasets.folder() / "tracks" / file.name, problems, "zip")
        answers.mkdir()
        run(programs / "submission", problems, answers)
        Path(shutil.make_archive(str(tmp_path / file.stem), "zip", answers)).replace(file)
    page = tmp_path / "leaderboard.md"
    run(sys.executable, "-m", "tensionlab", "bench", "submit", tmp_path / "all", "--out", page)
    assert "| 1 | mine | C | 100 % |" in page.read_text(encoding="utf-8")


def test_a_project_may_have_it_inside(tmp_path):
    if shutil.which("cmake") is None:
        pytest.skip("cmake is not installed")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.18)\nproject(whole LANGUAGES C CXX)\n"
        f"add_subdirectory({ROOT} tensionlab EXCLUDE_FROM_ALL)\nadd_executable(allocate {EXAMPLES}/allocate.cpp)\n"
        "target_link_libraries(allocate PRIVATE tensionlab::tensionlab)\n"
    )
    run("cmake", "-S", tmp_path, "-B", tmp_path / "build", "-DTENSIONLAB_BUILDS=native")
    run("cmake", "--build", tmp_path / "build", "--target", "allocate")
    assert run(tmp_path / "build" / "allocate").startswith("exact")


def test_pkg_config_finds_it(prefix, tmp_path):
    if shutil.which("pkg-config") is None:
        pytest.skip("pkg-config is not installed")
    paths = {**os.environ, "PKG_CONFIG_PATH": str(prefix / "lib" / "pkgconfig")}
    flags = run("pkg-config", "--cflags", "--libs", "tensionlab", env=paths).split()
    run("cc", EXAMPLES / "allocate.c", *flags, f"-Wl,-rpath,{prefix}/lib", "-o", tmp_path / "program")
    assert "exact: tensions" in run(tmp_path / "program")


def test_the_library_asks_for_no_memory_and_throws_nothing(library):
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    wanted = {line.split()[-1].split("@")[0] for line in run("nm", "-D", "-u", library).splitlines()}
    assert not [
        name for name in wanted if re.match(r"malloc|calloc|free|_Zn|_Zd|__cxa_(throw|alloc)|_Unwind", name)
    ]


def test_it_equals_python_bit_for_bit(library):
    solve = ctypes.CDLL(library).tensionlab_allocate
    solve.argtypes = [ctypes.c_int] * 2 + [ctypes.c_void_p] * 6 + [ctypes.c_int] + [ctypes.c_void_p] * 2
    result, count = Result(), 0
    for group in (group for name in PROBLEM_SETS for group in problem_set(name, COUNT, seed=3).groups):
        W, w, lower, upper, *_ = map(np.ascontiguousarray, problem_of(group).arrays)
        size, n, m = W.shape
        for policy, name in enumerate(POLICIES):
            expected = tl.allocate(W, w, (lower, upper), policy=name)
            tensions, rest = np.empty((size, m)), np.empty((size, 2 * n + 4))
            for i in range(size):
                arrays = [array[i].ctypes.data for array in (W, w, lower, upper)]
                status = solve(n, m, *arrays, None, None, policy, tensions[i].ctypes.data, ctypes.byref(result))
                rest[i] = [*result.wrench[:n], *result.separation[:n], result.residual, result.scale,
                           result.iterations, status]  # fmt: skip
            e = expected
            numbers = (e.wrench, e.separation, e.residual, e.scale, e.iterations, e.status)
            assert np.array_equal(tensions, e.tensions)
            assert np.array_equal(rest, np.column_stack(numbers), equal_nan=True)
            count += size
    assert count >= 100_000


@pytest.mark.parametrize("wrong", [
    {"n": 0}, {"n": 7}, {"m": 33}, {"policy": 3}, {"wrench": [np.nan]}, {"structure": [[np.inf]]},
    {"upper": [-1.0]}, {"weights": [0.0]}, {"reference": [1e100]},
])  # fmt: skip
def test_it_refuses_arguments_out_of_range_and_writes_nothing(library, wrong):
    solve = ctypes.CDLL(library).tensionlab_allocate
    given = {"n": 1, "m": 1, "structure": [[1.0]], "wrench": [2.0], "lower": [0.0], "upper": [5.0],
             "reference": [0.0], "weights": [1.0], "policy": 0, **wrong}  # fmt: skip
    tensions = np.full(1, 7.0)
    arrays = [np.array(given[name]) for name in ("structure", "wrench", "lower", "upper", "reference", "weights")]
    words = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
    found = solve(given["n"], given["m"], *words, given["policy"], ctypes.c_void_p(tensions.ctypes.data), None)
    assert (found, tensions[0]) == (-1, 7.0)
