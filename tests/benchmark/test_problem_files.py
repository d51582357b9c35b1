"""Problems from files: what is read means the same, and what is no problem of tension allocation is left out."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import qpsolvers

import tensionlab as tl
from tensionlab.benchmark.problem_files import find_problem_set, qp_rows, read_problem_set
from tensionlab.benchmark.problem_sets import problem_set
from tensionlab.errors import DataError, InputError
from tensionlab.support import provenance

EYE = np.eye(3)
GOOD = {"P": np.diag([1.0, 4.0, 9.0]), "q": np.array([1.0, -2.0, 3.0]), "A": np.array([[1.0, -1.0, 2.0]]),
        "b": np.array([0.5]), "lb": -np.ones(3), "ub": 2.0 * np.ones(3)}  # fmt: skip


def save(folder, name="good", **changed):
    """Save a program as qpsolvers does, None and all."""
    arrays = GOOD | changed
    program = qpsolvers.Problem(**{key: arrays.get(key) for key in ("P", "q", "G", "h", "A", "b", "lb", "ub")})
    program.save(str(folder / f"{name}.npz"))
    return program


@pytest.mark.parametrize("name", ["edge", "trajectory", "unreachable", "published"])
def test_what_is_exported_is_read_as_it_was(tmp_path, name):
    original = problem_set(name, 12)
    provenance.write_parquet(tmp_path / "set.parquet", qp_rows(original), {})
    again = read_problem_set(tmp_path / "set.parquet")
    assert again.reachable == original.reachable
    assert [group.label for group in again.groups] == [group.label for group in original.groups]
    for one, other in zip(again.groups, original.groups, strict=True):
        np.testing.assert_array_equal(one.structure, other.structure)
        np.testing.assert_array_equal(one.wrench, other.wrench)
        np.testing.assert_array_equal(one.lower, np.broadcast_to(other.lower, one.lower.shape))
        np.testing.assert_array_equal(one.upper, np.broadcast_to(other.upper, one.upper.shape))


def test_any_positive_diagonal_and_any_linear_term_are_the_same_problem_in_other_coordinates(tmp_path):
    program = save(tmp_path)
    (group,) = read_problem_set(tmp_path).groups
    tensions = (
        tl.allocate(group.structure, group.wrench, (group.lower, group.upper)).raise_for_status().tensions[0]
    )
    solution = (tensions - GOOD["q"] / np.sqrt(np.diag(GOOD["P"]))) / np.sqrt(np.diag(GOOD["P"]))
    np.testing.assert_allclose(solution, qpsolvers.solve_problem(program, "quadprog").x, atol=1e-9)


def test_the_folder_of_a_repository_has_its_programs_in_data(tmp_path):
    (tmp_path / "data").mkdir()
    save(tmp_path / "data", "one")
    save(tmp_path / "data", "two", b=np.array([1e3]))
    found = find_problem_set(str(tmp_path), 100)
    assert found.name == str(tmp_path)
    assert [(group.label, len(group.wrench)) for group in found.groups] == [("n = 1, m = 3", 2)]
    assert found.reachable == "mixed"


def test_what_is_no_problem_of_tension_allocation_is_left_out_and_counted(tmp_path):
    save(tmp_path)
    reasons = {
        "P not diagonal": {"P": EYE + 0.1},
        "P not positive": {"P": np.diag([1.0, 0.0, 1.0])},
        "inequalities": {"G": EYE, "h": np.ones(3)},
        "an unbounded variable": {"ub": np.array([1.0, np.inf, 1.0])},
        "no equations": {"A": None, "b": None},
        "too many variables or equations": {"A": np.ones((7, 3)), "b": np.ones(7)},
    }
    for number, changed in enumerate(reasons.values()):
        save(tmp_path, f"bad{number}", **changed)
    save(tmp_path, "no bounds", lb=None, ub=None)
    found = read_problem_set(tmp_path)
    assert found.title.startswith("1 of 8 quadratic programs; left out: 2 with an unbounded variable, ")
    for reason in reasons:
        assert f"with {reason}" in found.title
    (tmp_path / "good.npz").unlink()
    with pytest.raises(DataError, match=r"none of its 7 programs is a problem of .*: 2 with an unbounded"):
        read_problem_set(tmp_path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"ub": np.ones(2)}, "row 1: ub has 2 entries; with 3 in lb and 1 in b it must have 3"),
        ({"lb": 3.0 * np.ones(3)}, "lb nowhere above ub"),
        ({"A": np.array([1.0, np.nan, 1.0])}, "must be finite"),
        ({"A": np.array(["one", "two", "three"])}, "row 1: A is no list of numbers"),
    ],
)
def test_a_damaged_program_is_refused_by_its_row(tmp_path, changed, message):
    row = {key: np.ravel(values).tolist() for key, values in (GOOD | changed).items()}
    pq.write_table(pa.Table.from_pylist([row]), tmp_path / "one.parquet")
    with pytest.raises(DataError, match=message):
        read_problem_set(tmp_path / "one.parquet")


def test_nothing_to_read_is_refused(tmp_path):
    with pytest.raises(DataError, match="no programs; give quadratic programs: a Parquet file, or a folder"):
        read_problem_set(tmp_path)
    np.savez(tmp_path / "one.npz", b=np.ones(1))
    with pytest.raises(DataError, match=r"one\.npz: one program; give the folder that it is in"):
        read_problem_set(tmp_path / "one.npz")
    with pytest.raises(InputError, match=r"no problem set is called 'edgy'; choose one of .*, or give quadratic"):
        find_problem_set("edgy", 1)


def test_the_count_is_an_even_selection(tmp_path):
    provenance.write_parquet(tmp_path / "edge.parquet", qp_rows(problem_set("edge", 60)), {})
    groups = read_problem_set(tmp_path / "edge.parquet", 12).groups
    assert [len(group.wrench) for group in groups] == [2] * 6
