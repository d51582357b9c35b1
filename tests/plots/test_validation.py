from tensionlab.plots import plot_forces
from tests.helpers.figures import content_of, words_in
from tests.helpers.recorded import made_up


def test_a_picture_of_forces_says_what_it_shows_and_that_it_is_simulated():
    content = content_of(plot_forces(made_up()))
    words = words_in(content)
    assert "bartels2026-validation, simulated: 182 forces of 1.5 N, solver newton" in words
    assert {"from the front (along −z)", "from above (along −y)", "desired force"} <= set(words)
    assert content_of(plot_forces(made_up())) == content != content_of(plot_forces(made_up(seed=1)))
