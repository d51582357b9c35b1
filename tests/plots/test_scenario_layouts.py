import re

import numpy as np

from tensionlab.plots.scenario_layouts import plot_scenario_layouts, way
from tensionlab.plots.scene import origin_of, scripted, view_of
from tensionlab.scenarios import load_scenario


def test_all_are_drawn_with_their_modules(tmp_path):
    scenarios = [load_scenario(name) for name in ("materials", "weight", "bow")]
    plot_scenario_layouts(scenarios, "A note.", tmp_path / "layouts.svg")
    words = re.findall(r"<!-- (.*?) -->", (tmp_path / "layouts.svg").read_text(encoding="utf-8"))
    for scenario in scenarios:
        assert scenario.title in words
        for module in scenario.rig.modules:
            assert module.name in words, module.name
    for word in ("module in the room", "module on the body", "where brakes hold", "surface to be felt", "water"):
        assert word in words, word
    assert any(word.startswith("A note.") for word in words)


def test_the_same_layouts_make_the_same_file(tmp_path):
    for name in ("one.pdf", "two.pdf"):
        plot_scenario_layouts([load_scenario("recoil")], "", tmp_path / name)
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()


def test_nobody_is_drawn_beyond_a_brake():
    bow = load_scenario("bow")
    _, moment = way(bow)
    reach = np.linalg.norm(moment.held - origin_of(bow, moment))
    np.testing.assert_allclose(reach, bow.phases[1].hold.reach)
    weight = load_scenario("weight")
    path, moment = way(weight)
    assert moment.held[2] == weight.phases[1].hold.plane.point[2]
    assert path[:, 2].max() > 1.1  # what is not heavy may be lifted


def test_what_lies_across_the_view_is_to_scale():
    scenario = load_scenario("recoil")
    view, moment = view_of(scenario.rig), scripted(scenario, 1.0)
    step = np.array([0.3, 0.0, -0.4])
    np.testing.assert_allclose(np.linalg.norm(view(moment.held + step) - view(moment.held)), 0.5)
    assert (view(np.array([0.0, 1.0, 0.0])) > 0.0).all()
