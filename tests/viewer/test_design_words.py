"""What the panel says of a state."""

import re

import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_panel import share_html, status_html, tensions_html
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.scene import bounds
from tensionlab.viewer.solver_comparison import compare, solver_table
from tensionlab.viewer.state import begin
from tensionlab.viewer.workspace import sweep


@pytest.fixture
def point():
    return begin(tl.load_rig("bartels2026-validation"))


def plain(text):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", text)).strip()


def test_a_feasible_force_is_exact(point):
    state = edits.set_wrench(point, [1.0, 0.5, 1.0])
    said = plain(status_html(state, evaluate(state)))
    assert said.startswith("EXACT the desired force is rendered desired force 1.5 N (1, 0.5, 1)")
    assert "capacity margin 3.68 N at the hand" in said


def test_an_infeasible_force_is_nearest_and_says_by_which_policy(point):
    state = edits.set_fields(policy="direction")(edits.set_wrench(point, [20.0, 0.0, 0.0]))
    said = plain(status_html(state, evaluate(state)))
    assert said.startswith("NEAREST certified infeasible: the longest wrench in the desired direction is rendered")
    assert "24.4 % of it" in said
    assert "error 15.1 N" in said


def test_bars_say_who_is_at_a_limit(point):
    state = edits.set_wrench(point, [1.0, 0.5, 1.0])
    assert "floor-3 0.50 N lower limit" in plain(tensions_html(state, evaluate(state)))


def test_names_of_modules_are_text(point):
    state = edits.rename(point, "top", "<b>top</b>")
    assert "&lt;b&gt;top" in tensions_html(state, evaluate(state))


def test_solvers_are_side_by_side(point):
    state = edits.set_fields(compared=("closed-form", "polygon"))(edits.set_wrench(point, [20.0, 0.0, 0.0]))
    _, answers = compare(state, lambda: True)
    text = plain(solver_table(answers)._repr_html_())
    assert re.search(r"■ newton NEAREST 15.1 6.00 \S+ .s 0/180", text)
    assert "■ closed-form " in text


def test_the_share_of_the_box_is_said(point):
    state = edits.set_fields(level=1.0)(point)
    volume = sweep(state, bounds(state.rig), 10, lambda: True)
    said = plain(share_html(state, volume))
    assert f"{100 * volume.share(1.0):.1f} % of the box" in said
    assert "evaluated at positions" in said
    assert "capacity margin above 1 N" in plain(share_html(state, volume))
