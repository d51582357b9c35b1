from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.plots import plot_error_sphere, plot_forces, plot_what_if
from tensionlab.plots.style import save_figure
from tensionlab.plots.validation import _on_disc, grouped
from tensionlab.validation.data_tables import Trials
from tensionlab.validation.statistics import deviations
from tests.helpers.figures import content_of, words_in, words_of
from tests.helpers.recorded import QUESTIONS, made_up, made_up_trials

RIG = Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml"


@pytest.fixture(scope="module")
def draw():
    rig = tl.load_rig(RIG)
    return {"forces": plot_forces, "sphere": lambda recording: plot_error_sphere(recording, rig)}


@pytest.fixture(scope="module")
def contents(draw):
    """What each function draws of one recording, drawn once."""
    return cache(lambda name: content_of(draw[name](made_up())))


@pytest.mark.parametrize("name", ["forces", "sphere"])
def test_the_same_recording_makes_the_same_figure_and_another_another(draw, contents, name):
    content = contents(name)
    assert content == content_of(draw[name](made_up()))
    assert content != content_of(draw[name](made_up(seed=1)))


def test_pictures_say_what_they_show_and_that_it_is_simulated(tmp_path, draw, contents):
    words = words_in(contents("forces"))
    assert "bartels2026-validation, simulated: 182 forces of 1.5 N, solver newton" in words
    assert {"from the front (along −z)", "from above (along −y)", "desired force"} <= set(words)
    save_figure(draw["sphere"](made_up(simulated=False)), tmp_path / "b.svg")
    words = words_of(tmp_path / "b.svg")
    assert "bartels2026-validation, measured: 182 forces of 1.5 N, solver newton" in words
    assert {"angle to the desired force (°)", "size: measured minus desired (N)", "top", "floor-3"} <= set(words)


def test_angles_and_sizes_are_those_of_the_planted_error():
    recording = made_up(gain=1.2, noise=0.0)
    c, s = np.cos(0.2), np.sin(0.2)
    turned = replace(recording, measured=recording.measured @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    found = deviations(turned.desired, turned.measured)
    np.testing.assert_allclose(found.magnitude - 1.5, 0.2 * 1.5)
    assert found.angle.max() == pytest.approx(np.degrees(0.2))


def test_the_disc_keeps_areas_and_has_each_direction_once_but_on_the_rim():
    vectors = made_up().desired
    up, there = _on_disc(vectors, 1.0)
    down, below = _on_disc(vectors, -1.0)
    assert len(up) + len(down) == 182 + np.count_nonzero(np.abs(vectors[:, 1]) < 1e-9)
    assert np.count_nonzero(there & below) == 20
    # A cap up to the angle a from the pole has the area 2 pi (1 - cos a); on the disc it is pi r².
    cosine = vectors[there, 1] / 1.5
    np.testing.assert_allclose(np.sum(up**2, axis=1), 1 - cosine, atol=1e-12)


@pytest.fixture(scope="module")
def published():
    return tl.datasets.load("published/bartels2026-validation")


@pytest.fixture(scope="module")
def twenty(published):
    """What is drawn of the trials of twenty rigs."""
    return content_of(plot_what_if(Trials(tuple(made_up_trials()), {}), published))


def test_every_choice_is_named_and_grouped_by_what_differs(twenty):
    words = words_in(twenty)
    for choices in QUESTIONS.values():
        assert set(choices) <= set(words)
    assert {"the whole rig", "one error alone", "after calibration, held out", "published, one rig"} <= set(words)
    assert "another side of the triangle" not in words
    assert "on a rig without errors" not in words
    assert "Simulated validations of 20 rigs" in words


def test_choices_that_come_out_the_same_share_a_line(tmp_path, published):
    rows = [row for row in made_up_trials() if row.question == "solver"]
    twins = [replace(row, choice=f"twin {i}") for i in range(3) for row in rows if row.choice == "newton"]
    ideal = [replace(rows[0], question="solver alone", angle=0.0)]
    trials = Trials((*rows, *twins, *ideal), {})
    names = list(grouped(trials.of("solver")))
    assert names == [("newton", "twin 0", "twin 1", "twin 2"), ("dykstra:10",)]
    other = replace(twins[-1], angle=twins[-1].angle + 0.02)
    apart = grouped(Trials((*rows, *twins[:-1], other), {}).of("solver"))
    assert list(apart) == [("newton", "twin 0", "twin 1"), ("dykstra:10",), ("twin 2",)]
    save_figure(plot_what_if(trials, published), tmp_path / "a.svg")
    words = words_of(tmp_path / "a.svg")
    assert {"newton and 3 others (identical)", "dykstra:10", "on a rig without errors"} <= set(words)


def test_what_is_beyond_the_axis_is_told_as_a_number(tmp_path, published):
    rows = [replace(row, angle=61.23) for row in made_up_trials() if row.choice == "gain"]
    save_figure(plot_what_if(Trials(tuple(rows), {}), published), tmp_path / "a.svg")
    assert "61.2 →" in words_of(tmp_path / "a.svg")


def test_the_same_trials_make_the_same_figure_and_others_another(published, twenty):
    def content(count):
        return content_of(plot_what_if(Trials(tuple(made_up_trials(count)), {}), published))

    assert content(20) == twenty
    assert content(19) != twenty
