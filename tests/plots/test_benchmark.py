"""The pictures of a benchmark name what they show, and are the same from the same results."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.benchmark.results import EVIDENCE
from tensionlab.errors import InputError
from tensionlab.plots import plot_accuracy, plot_continuity, plot_profile, plot_summary, plot_worst
from tensionlab.plots.style import _cost, _distance, _places, save_figure
from tests.support.figures import content_of, words_of

DRAW = {
    "profile": plot_profile,
    "accuracy": plot_accuracy,
    "worst": plot_worst,
    "continuity": plot_continuity,
    "summary": plot_summary,
}
each = pytest.mark.parametrize("draw", DRAW.values(), ids=DRAW)


@each
def test_the_same_results_make_the_same_figure(bench_results, draw):
    content = content_of(draw(bench_results))
    assert content == content_of(draw(bench_results))
    assert len(content) > 10_000


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (plot_profile, ["newton", "closed-form", "osqp", "share of problems", "baseline, tight settings"]),
        (plot_accuracy, ["newton", "daqp", "cvxpy", "median time of a call (µs)", "baseline, default settings"]),
        (plot_worst, ["newton", "daqp, tight", "cvxpy, default", "built-in, others"]),
        (plot_continuity, ["newton, force", "newton, direction", "daqp", "path (mm)", "infeasible"]),
        (plot_summary, ["newton", "daqp", "typical time of a call (µs)", "max error of all answers (N)"]),
    ],
    ids=DRAW,
)
def test_what_is_shown_is_named(tmp_path, bench_results, draw, words):
    save_figure(draw(bench_results), tmp_path / "p.svg")
    shown = words_of(tmp_path / "p.svg")
    for word in words:
        assert word in shown, word


@each
def test_who_answered_nothing_is_left_out(tmp_path, bench_results, draw):
    nothing = {"call_s": [], "errors": [], "violations": [], "gaps": [], "path_mm": []}
    nothing |= {"sgm_s": np.nan, "median_s": np.nan}
    absent = [replace(row, solver="absent", **nothing) for row in bench_results.rows if row.label == "newton"]
    save_figure(draw(replace(bench_results, rows=(*bench_results.rows, *absent))), tmp_path / "p.svg")
    assert not any("absent" in word for word in words_of(tmp_path / "p.svg"))


def test_the_summary_needs_no_evidence(tmp_path, bench_results):
    plain = tuple(replace(row, **{name: [] for name in EVIDENCE}) for row in bench_results.rows)
    save_figure(plot_summary(bench_results), tmp_path / "one.svg")
    save_figure(plot_summary(replace(bench_results, rows=plain)), tmp_path / "two.svg")
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_without_a_trajectory_there_is_no_picture_of_one(tmp_path, bench_results):
    rows = tuple(bench_results.of_set("point"))
    with pytest.raises(InputError, match="no trajectory"):
        save_figure(plot_continuity(replace(bench_results, rows=rows)), tmp_path / "p.png")


def test_a_name_avoids_what_is_there_and_stays_inside():
    frame = np.array([[0.0, 0.0], [200.0, 200.0]])
    place = np.array([100.0, 100.0])
    crowd = [np.array([105.0, 60.0, 200.0, 140.0])]  # everything to the right is taken
    nobody = np.zeros((0, 2))
    best = min(_places(place, 30.0, 10.0), key=lambda box: _cost(box, place, nobody, crowd, frame))
    assert best[2] <= 105.0
    corner = np.array([2.0, 2.0])
    best = min(_places(corner, 30.0, 10.0), key=lambda box: _cost(box, corner, nobody, crowd, frame))
    assert best[:2].min() >= 0.0


def test_a_name_is_nearest_to_its_own_point():
    frame, place = np.array([[0.0, 0.0], [200.0, 200.0]]), np.array([100.0, 100.0])
    stranger = np.array([[100.0, 120.0]])
    best = min(_places(place, 30.0, 10.0), key=lambda box: _cost(box, place, stranger, [np.zeros(4)], frame))
    assert _distance(best, place[None])[0] < _distance(best, stranger)[0]
