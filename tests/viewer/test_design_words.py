"""What the panel says of a state."""

import re

import pytest

import tensionlab as tl
from tensionlab.viewer import design_words as words
from tensionlab.viewer import state as edits
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.html import render
from tensionlab.viewer.solver_study import compare
from tensionlab.viewer.state import begin
from tensionlab.viewer.volume import bounds, sweep


@pytest.fixture
def point():
    return begin(tl.load_rig("bartels2026-validation"))


def plain(text):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", text)).strip()


def test_a_feasible_force_is_exact(point):
    state = edits.set_wrench(point, [1.0, 0.5, 1.0])
    said = plain(words.status(state, evaluate(state)))
    assert said.startswith("EXACT the desired force is rendered desired force 1.5 N (1, 0.5, 1)")
    assert "capacity margin 3.68 N at the hand" in said


def test_an_infeasible_force_is_nearest_and_says_by_which_policy(point):
    state = edits.set_fields(policy="direction")(edits.set_wrench(point, [20.0, 0.0, 0.0]))
    said = plain(words.status(state, evaluate(state)))
    assert said.startswith("NEAREST certified infeasible: the longest wrench in the desired direction is rendered")
    assert "24.4 % of it" in said
    assert "error 15.1 N" in said


def test_bars_say_who_is_at_a_limit(point):
    state = edits.set_wrench(point, [1.0, 0.5, 1.0])
    assert "floor-3 0.50 N lower limit" in plain(words.tensions(state, evaluate(state)))


def test_names_of_modules_are_text(point):
    state = edits.rename(point, "top", "<b>top</b>")
    assert "&lt;b&gt;top" in words.tensions(state, evaluate(state))


def test_solvers_are_side_by_side(point):
    state = edits.set_fields(compared=("closed-form", "polygon"))(edits.set_wrench(point, [20.0, 0.0, 0.0]))
    _, answers = compare(state, lambda: True)
    text = plain(render("design.solvers", answers, ("#000000",)))
    assert re.search(r"■ newton NEAREST 15.1 6.00 \S+ .s 0/180", text)
    assert "■ closed-form " in text
    assert plain(render("design.solvers", [], ())) == "Choose solvers to compare with the one of the tab Hand."


def test_the_share_of_the_box_is_said(point):
    state = edits.set_fields(level=1.0)(point)
    volume = sweep(state, bounds(state.rig), 10, lambda: True)
    said = plain(words.share(state, volume))
    assert f"{100 * volume.share(1.0):.1f} % of the box" in said
    assert "evaluated at positions" in said
    assert "capacity margin above 1 N" in plain(words.share(state, volume))
