import re
from dataclasses import replace

import pytest

import tensionlab as tl
from tensionlab.plots import plot_what_if
from tensionlab.plots.what_if import together
from tensionlab.validation.trials import Trials
from tests.support.recorded import QUESTIONS, made_up_trials


def words_of(path):
    return re.findall(r"<!-- (.*?) -->", path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def published():
    return tl.datasets.load("published/bartels2026-validation")


def test_every_choice_is_named_and_grouped_by_what_differs(tmp_path, published):
    plot_what_if(Trials(tuple(made_up_trials()), {}), published, tmp_path / "a.svg")
    words = words_of(tmp_path / "a.svg")
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
    names = list(together(trials.of("solver")))
    assert names == [("newton", "twin 0", "twin 1", "twin 2"), ("dykstra:10",)]
    other = replace(twins[-1], angle=twins[-1].angle + 0.02)
    apart = together(Trials((*rows, *twins[:-1], other), {}).of("solver"))
    assert list(apart) == [("newton", "twin 0", "twin 1"), ("dykstra:10",), ("twin 2",)]
    plot_what_if(trials, published, tmp_path / "a.svg")
    words = words_of(tmp_path / "a.svg")
    assert {"newton, 3 more the same", "dykstra:10", "on a rig without errors"} <= set(words)


def test_what_is_beyond_the_axis_is_told_as_a_number(tmp_path, published):
    rows = [replace(row, angle=61.23) for row in made_up_trials() if row.choice == "gain"]
    plot_what_if(Trials(tuple(rows), {}), published, tmp_path / "a.svg")
    assert "61.2 →" in words_of(tmp_path / "a.svg")


@pytest.mark.parametrize("suffix", [".pdf", ".png"])
def test_the_same_trials_make_the_same_file_and_others_another(tmp_path, published, suffix):
    paths = [tmp_path / f"{number}{suffix}" for number in range(3)]
    for path, count in zip(paths, (20, 20, 19), strict=True):
        plot_what_if(Trials(tuple(made_up_trials(count)), {}), published, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].read_bytes() != paths[2].read_bytes()
