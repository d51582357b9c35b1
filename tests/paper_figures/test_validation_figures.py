import numpy as np
import pandas
import pytest

import tensionlab as tl
from paper_figures.validation_figures import _on_disc, choices_of, grouped, plot_error_sphere, plot_what_if
from tests.helpers.figures import content_of, words_in
from tests.helpers.recorded import QUESTIONS, made_up, made_up_trials


@pytest.fixture(scope="module")
def published():
    return tl.datasets.load("published/bartels2026-validation")


def test_an_error_sphere_says_what_it_shows_and_that_it_is_measured():
    rig = tl.load_rig("bartels2026-validation")
    words = words_in(content_of(plot_error_sphere(made_up(simulated=False), rig)))
    assert "bartels2026-validation, measured: 182 forces of 1.5 N, solver newton" in words
    assert {"angle to the desired force (°)", "size: measured minus desired (N)", "top", "floor-3"} <= set(words)


def test_the_disc_keeps_areas_and_has_each_direction_once_but_on_the_rim():
    vectors = made_up().desired
    up, there = _on_disc(vectors, 1.0)
    down, below = _on_disc(vectors, -1.0)
    assert len(up) + len(down) == 182 + np.count_nonzero(np.abs(vectors[:, 1]) < 1e-9)
    assert np.count_nonzero(there & below) == 20
    # A cap up to the angle a from the pole has the area 2 pi (1 - cos a); on the disc it is pi r².
    cosine = vectors[there, 1] / 1.5
    np.testing.assert_allclose(np.sum(up**2, axis=1), 1 - cosine, atol=1e-12)


def test_every_choice_is_named_and_grouped_by_what_differs(published):
    content = content_of(plot_what_if(made_up_trials(), published))
    words = words_in(content)
    for choices in QUESTIONS.values():
        assert set(choices) <= set(words)
    assert {"the whole rig", "one error alone", "after calibration, held out", "published, one rig"} <= set(words)
    assert "another side of the triangle" not in words
    assert "on a rig without errors" not in words
    assert "median of 20 rigs, 10 to 90 %" in words
    calibrated = made_up_trials().query("choice == 'gain and bias'")["angle"].median()
    assert any(word.startswith("Mean angle error: 0.0° without") for word in words)
    assert any(word.endswith(f"{calibrated:.1f}° after calibration") for word in words)
    assert content_of(plot_what_if(made_up_trials(19), published)) != content


def test_choices_that_come_out_the_same_share_a_line(published):
    trials = made_up_trials()
    rows = trials[trials["question"] == "solver"]
    exact = rows[rows["choice"] == "newton"]
    twins = [exact.assign(choice=f"twin {i}") for i in range(3)]
    ideal = rows[:1].assign(question="solver alone", angle=0.0)
    same = pandas.concat([rows, *twins, ideal])
    names = list(grouped(choices_of(same, "solver")))
    assert names == [("newton", "twin 0", "twin 1", "twin 2"), ("dykstra:10",)]
    apart = pandas.concat([rows, *twins[:2], twins[2].assign(angle=exact["angle"] + 0.02)])
    assert list(grouped(choices_of(apart, "solver"))) == [
        ("newton", "twin 0", "twin 1"),
        ("dykstra:10",),
        ("twin 2",),
    ]
    words = words_in(content_of(plot_what_if(same, published)))
    assert {"newton and 3 others (identical)", "dykstra:10", "on a rig without errors"} <= set(words)


def test_a_value_beyond_the_axis_is_written_as_a_number(published):
    trials = made_up_trials()
    far = trials[trials["choice"] == "gain"].assign(angle=61.23)
    assert "61.2 →" in words_in(content_of(plot_what_if(far, published)))
