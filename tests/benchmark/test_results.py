import numpy as np
import pytest

from tensionlab.benchmark.entries import entries
from tensionlab.benchmark.results import QUANTITIES, empty_evidence, solved, summarise


def test_a_problem_is_timed_by_the_best_of_its_repeats():
    evidence = empty_evidence(np.ones(3), repeats=2)
    evidence.tried[:2] = True
    evidence.calls[0] = [[4e-6, 3e-6, 2e-6, 1e-6], [2e-6, 1e-6, 5e-7, 4e-7]]
    evidence.calls[1] = [[1e-6, 5e-7, 3e-7, 2e-7], [9e-6, 8e-6, 7e-6, 6e-6]]
    row = summarise("a", entries("all", ["daqp"])[0], evidence)
    np.testing.assert_array_equal(row.call_s, [2e-6, 1e-6, np.nan])
    assert (row.median_s, row.worst_s, row.jitter_s) == (1e-6, 2e-6, 9e-6)
    assert 4e-7 < row.prebuilt_s < 1.1e-6 < row.sgm_s  # 1 and 0.5 µs, and 2 and 1 µs
    # The parts are those of the same call.
    assert (row.build_s, row.setup_s, row.solve_s) == (5e-7, 3e-7, 2e-7)


def test_what_is_not_tried_is_not_in_the_shares():
    evidence = empty_evidence(np.ones(4), repeats=1)
    evidence.tried[:3] = True
    evidence.error[:3], evidence.violation[:3] = [0.0, 1e-4, np.nan], 0.0
    row = summarise("a", entries("all", ["newton"])[0], evidence)
    assert (row.problems, row.tried, row.failed) == (4, 3, 1)
    assert (row.solved_1e3, row.solved_1e6) == (pytest.approx(2 / 3), pytest.approx(1 / 3))


def test_solved_means_the_wrench_and_the_limits():
    errors, outside = np.array([1e-7, 1e-7, 1e-5, 1e-5, np.nan]), np.array([0.0, 1e-5, 0.0, 0.0, 0.0])
    scale = np.array([1.0, 1.0, 1.0, 100.0, 1.0])
    np.testing.assert_array_equal(solved(errors, outside, scale, 1e-6), [True, False, False, True, False])


def test_the_long_table_has_a_row_for_each_problem_and_quantity_of_an_entry(bench_results):
    table = bench_results.problems()
    keys = ["problem_set", "solver", "setting", "policy", "problem", "quantity"]
    assert list(table) == [*keys, "value"]
    assert not table.duplicated(keys).any()
    assert set(table["quantity"]) == set(QUANTITIES)
    table["policy"] = table["policy"].fillna("")
    errors = table[table["quantity"] == "error"].groupby(keys[:4])["value"].max()
    for row in bench_results.rows:
        error = errors[row.problem_set, row.solver, row.setting, row.policy or ""]
        np.testing.assert_equal(float(error), row.error_max)
