import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.comparison import compare
from tensionlab.plots import plot_comparison
from tests.helpers.figures import content_of, words_in


@pytest.fixture(scope="module")
def comparison():
    rig = tl.load_rig("bartels2026-validation-0.3m")
    return compare(rig, solvers=["newton", "closed-form"])


def test_the_same_comparison_makes_the_same_figure_which_names_what_it_shows(comparison):
    content = content_of(plot_comparison(comparison))
    assert content == content_of(plot_comparison(comparison))
    assert len(content) > 10_000
    words = words_in(content)
    for word in ("newton", "closed-form", "floor-1", "top", "exact", "x (N)", "y (N)", "z (N)",
                 "max error (N)", "time of a call (µs)", "nearest in tension", "error of newton, nearest in force",
                 "bartels2026-validation-0.3m, 182 forces of 1.5 N: 153 exact, 29 proved impossible"):  # fmt: skip
        assert word in words, word


def test_a_comparison_of_a_planar_rig_has_one_view():
    result = compare(tl.load_rig("kntu-planar"), magnitude=20.0, solvers=["dykstra"])
    words = words_in(content_of(plot_comparison(result)))
    assert "y (N)" in words
    assert "z (N)" not in words


def test_along_a_trajectory_there_are_tensions_errors_and_steps():
    rig = tl.load_rig("bartels2026-validation-0.3m")
    path = rig.home + np.linspace(0.0, 0.3, 30)[:, None] * [1.0, 0.0, 0.0]
    found = compare(rig, [0.0, 0.0, 1.0], poses=path, solvers=["newton", "closed-form"])
    words = words_in(content_of(tl.plot(found)))
    for word in ("newton, nearest in force", "closed-form", "tension (N)", "error (N)", "step of a tension (N)",
                 "length of the path (m)", "top", "limits", "infeasible"):  # fmt: skip
        assert word in words, word
    assert any("of which newton renders" in word for word in words)
