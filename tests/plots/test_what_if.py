import re

import pytest
from recorded import QUESTIONS, made_up_trials

import tensionlab as tl
from tensionlab.experiments.trials import Trials
from tensionlab.plots import plot_what_if


@pytest.fixture(scope="module")
def published():
    return tl.datasets.load("published/bartels2026-validation")


def test_every_choice_is_named_and_grouped_by_what_differs(tmp_path, published):
    plot_what_if(Trials(tuple(made_up_trials()), {}), published, tmp_path / "a.svg")
    words = re.findall(r"<!-- (.*?) -->", (tmp_path / "a.svg").read_text(encoding="utf-8"))
    for choices in QUESTIONS.values():
        assert set(choices) <= set(words)
    assert {"the whole rig", "one error alone", "after calibration, held out", "published, one rig"} <= set(words)
    assert "another side of the triangle" not in words
    assert "Simulated validations of up to 20 rigs" in words


@pytest.mark.parametrize("suffix", [".pdf", ".png"])
def test_the_same_trials_make_the_same_file_and_others_another(tmp_path, published, suffix):
    paths = [tmp_path / f"{number}{suffix}" for number in range(3)]
    for path, count in zip(paths, (20, 20, 19), strict=True):
        plot_what_if(Trials(tuple(made_up_trials(count)), {}), published, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].read_bytes() != paths[2].read_bytes()
