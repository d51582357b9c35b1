"""The pictures of a benchmark name what they show, and are the same from the same results."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

import tensionlab as tl
from tensionlab.plots import plot_pareto, plot_profile
from tensionlab.plots.benchmark import EXACT_N, _compared, pareto_front, performance_ratios
from tensionlab.plots.style import free_box
from tests.helpers.figures import content_of, words_in

each = pytest.mark.parametrize("draw", [plot_profile, plot_pareto])


@pytest.fixture(scope="module")
def contents(bench_results):
    """What each function draws, drawn once."""
    return cache(lambda draw: content_of(draw(bench_results)))


@each
def test_the_same_results_make_the_same_figure_and_who_answered_nothing_is_left_out(contents, bench_results, draw):
    nothing = dict.fromkeys(["call_s", "error", "violation", "gap", "sgm_s", "median_s"], np.nan)

    def with_absent(table):
        newton = table[table["label"] == "newton"]
        absent = newton.assign(solver="absent", **{name: nan for name, nan in nothing.items() if name in table})
        return pd.concat([table, absent])

    assert len(contents(draw)) > 10_000
    assert {"newton", "daqp"} <= {word.partition(",")[0] for word in words_in(contents(draw))}
    rows, measurements = with_absent(bench_results.rows), with_absent(bench_results.measurements)
    assert content_of(draw(replace(bench_results, rows=rows, measurements=measurements))) == contents(draw)


def test_the_pareto_plot_needs_no_measurements_of_problems(contents, bench_results):
    assert content_of(plot_pareto(replace(bench_results, measurements=None))) == contents(plot_pareto)


def test_a_performance_profile_by_hand():
    # Problems by row; entries A, B and C. A fails the third, C does not try the first, no entry solves the last.
    seconds = pd.DataFrame([[1.0, 2.0, np.nan], [4.0, 1.0, 2.0], [1.0, 3.0, 6.0], [1.0, 1.0, 1.0]])
    solved = pd.DataFrame([[1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 0, 0]]).astype(bool)
    expected = [[1.0, 2.0, np.nan], [4.0, 1.0, 2.0], [np.inf, 1.0, 2.0]]
    np.testing.assert_array_equal(performance_ratios(seconds, solved), expected)


def test_the_front_has_the_entries_that_no_other_surpasses_and_exact_ones_are_equal():
    points = [(1.0, 1e-2), (2.0, 1e-3), (3.0, 1e-1), (4.0, 1e-9), (5.0, 1e-15)]
    assert pareto_front(points) == [(1.0, 1e-2), (2.0, 1e-3), (4.0, EXACT_N)]


def test_ones_own_solver_is_picked_out(bench_results):
    rows = bench_results.rows
    newton = rows[rows["label"] == "newton"]
    own = newton.assign(solver="mine:Mine", median_s=2 * newton["median_s"])
    words = words_in(content_of(plot_pareto(replace(bench_results, rows=pd.concat([rows, own])))))
    assert "your own" in words
    assert "mine:Mine" in words
    assert "your own" not in words_in(content_of(plot_pareto(bench_results)))


def test_a_comparison_is_drawn_by_the_error_above_the_smallest():
    rig = tl.load_rig("bartels2026-validation-0.3m")
    found = tl.compare(rig, solvers=[tl.solvers.Dykstra(iteration_limit=5), "newton", "spidar"])
    dots = {dot.name: dot for dot in _compared(found)}
    assert dots["dykstra(iteration_limit=5)"].kind == "own"
    assert dots["newton"].error < 1e-12  # no solver renders more of what can be rendered
    rows = {row.solver: row for row in reversed(found.rows)}
    assert dots["spidar"].error > rows["spidar"].residual_mean - rows["newton"].residual_mean > 0
    words = words_in(content_of(plot_pareto(found)))
    assert {"dykstra(iteration_limit=5)", "your own", "max error above the smallest of all (N)"} <= set(words)
    assert "Pareto front" in words


NOTHING = np.zeros((0, 2)), np.zeros((0, 4))
FRAME = np.array([[0.0, 0.0], [200.0, 200.0]])


def test_a_name_avoids_what_is_there_and_stays_inside():
    everything_to_the_right = np.array([[105.0, 60.0, 200.0, 140.0]])
    best = free_box(np.array([100.0, 100.0]), (30.0, 10.0), NOTHING[0], everything_to_the_right, FRAME)
    assert best[2] <= 105.0
    assert free_box(np.array([2.0, 2.0]), (30.0, 10.0), *NOTHING, FRAME)[:2].min() >= 0.0


def test_a_name_is_nearest_to_its_own_point():
    place, stranger = np.array([100.0, 100.0]), np.array([100.0, 120.0])
    best = free_box(place, (30.0, 10.0), stranger[None], NOTHING[1], FRAME)

    def distance(point):
        return np.linalg.norm(np.maximum(np.maximum(best[:2] - point, point - best[2:]), 0.0))

    assert distance(place) < distance(stranger)
