import numpy as np

from paper_figures.scenario_layouts import plot_scenario_layouts, script_path
from tensionlab.plots.scene import origin_of
from tensionlab.scenarios import load_scenario
from tests.helpers.figures import content_of, words_in


def test_all_are_drawn_with_their_modules():
    scenarios = [load_scenario(name) for name in ("materials", "weight", "bow")]
    figure = plot_scenario_layouts(scenarios, "A note.")
    words = words_in(content_of(figure))
    scales = [np.diff(axes.transData.transform([[0.0, 0.0], [1.0, 1.0]]), axis=0) for axes in figure.axes]
    np.testing.assert_allclose(scales, scales[0] * np.ones_like(scales), rtol=1e-3)
    for scenario in scenarios:
        assert any(word.startswith(f"{scenario.title}\n") for word in words) or scenario.title in words
        for module in scenario.rig.modules:
            assert module.name in words, module.name
    for word in ("module in the room", "module on the body", "where brakes hold", "virtual surface", "water"):
        assert word in words, word
    assert any(word.startswith("A note.") for word in words)


def test_the_same_layouts_make_the_same_figure():
    one, two = (plot_scenario_layouts([load_scenario("recoil")], "") for _ in range(2))
    assert content_of(one) == content_of(two)


def test_nobody_is_drawn_beyond_a_brake():
    bow = load_scenario("bow")
    _, moment = script_path(bow)
    reach = np.linalg.norm(moment.held - origin_of(bow, moment))
    np.testing.assert_allclose(reach, bow.phases[1].hold.reach)
    weight = load_scenario("weight")
    path, moment = script_path(weight)
    assert moment.held[2] == weight.phases[1].hold.plane.point[2]
    assert path[:, 2].max() > 1.1  # what is not heavy may be lifted
