from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from paper_figures.scenario_layouts import scripted_moment
from tensionlab.plots.scenario import (
    draw_force,
    draw_tension,
    force_distance,
    moment_of,
    plot_scenario,
)
from tensionlab.plots.scene import view_of
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.fidelity import rendered_force
from tensionlab.scenarios.play import play, simulate_modules
from tests.helpers.figures import content_of, words_in


@pytest.fixture(scope="module")
def bow():
    scenario = load_scenario("bow")
    return play(scenario, simulate_modules(scenario), seconds=3.2)


def test_the_figure_names_what_is_in_it(bow):
    words = words_in(content_of(plot_scenario(bow)))
    for word in (
        *(phase.name for phase in bow.scenario.phases),
        *("Force on the draw hand", "along x", "desired", "rendered (simulated)", "logarithmic scale"),
        *("Tension of bow-hand", "cable, simulated", "motor limits", "time (s)"),
        *("brake commanded", "module-local spring or vibration"),
        *("module on the body", "where brakes hold", "draw hand", "bow-hand"),
        *("Force against distance", "from bow hand to draw hand (m)"),
    ):
        assert word in words, word
    assert "module in the room" not in words
    assert "along y" not in words  # the force there is small against that along x


def test_the_same_play_makes_the_same_figure_also_without_the_person(bow):
    real = replace(bow, person=None)
    content = content_of(plot_scenario(real))
    assert content == content_of(plot_scenario(real))
    words = words_in(content)
    assert "measured by the modules" in words
    for word in ("rendered (simulated)", "cable, simulated"):
        assert word not in words, word


def test_lines_are_the_desired_and_the_rendered_force(bow):
    axes = Figure().subplots()
    draw_force(axes, bow)
    desired, rendered, _ = axes.get_lines()  # and zero
    np.testing.assert_array_equal(desired.get_xydata(), np.column_stack([bow.run.time, bow.run.desired[:, 0]]))
    np.testing.assert_array_equal(
        rendered.get_xydata(), np.column_stack([bow.person.time, bow.person.force[:, 0]])
    )


def test_lines_are_the_commanded_measured_and_simulated_tension(bow):
    axes = Figure().subplots()
    draw_tension(axes, bow, 0)
    lower, upper, commanded, measured, actual = (line.get_ydata() for line in axes.get_lines())
    assert (lower[0], upper[0]) == (0.5, 6.0)
    np.testing.assert_array_equal(commanded, bow.run.commanded[:, 0])
    np.testing.assert_array_equal(measured, bow.run.measured[:, 0])
    np.testing.assert_array_equal(actual, bow.person.tensions[:, 0])
    assert axes.get_ylim()[1] > actual.max()


def test_a_shade_lasts_as_long_as_the_brake_was_commanded(bow):
    axes = Figure().subplots()
    draw_tension(axes, bow, 0)
    begin, end = axes.collections[0].get_paths()[0].get_extents().intervalx
    assert end - begin == pytest.approx(bow.run.commanded_brakes.sum() / bow.run.setup.rate, abs=0.006)  # a cycle
    assert begin == bow.run.time[bow.run.commanded_brakes[:, 0]][0]


def test_where_things_are_is_read_off_the_cables(bow):
    then = moment_of(bow, 2.0)
    script = bow.scenario.person.bodies["bow"]
    np.testing.assert_allclose(then.bodies["bow"], script.position(2.0), atol=0.01)
    np.testing.assert_allclose(then.anchors[0], then.bodies["bow"] + bow.run.rig.anchors[0])


def test_force_against_distance_is_the_pull_of_the_string(bow):
    (draw,) = [each for each in force_distance(bow) if each.title == "draw"]
    string = bow.scenario.phases[0].effects["string"]
    drawn = slice(0, int(np.argmax(draw.desired[0] > 0.7)))
    wanted = string.pull(draw.desired[0][drawn] - string.brace)
    np.testing.assert_allclose(draw.desired[1][drawn], wanted, atol=0.1)
    assert draw.rendered[1].max() == pytest.approx(rendered_force(bow).force[:, 0].max(), rel=1e-3)  # the brake's


def test_what_lies_across_the_view_is_to_scale():
    scenario = load_scenario("recoil")
    view, moment = view_of(scenario.rig), scripted_moment(scenario, 1.0)
    step = np.array([0.3, 0.0, -0.4])
    np.testing.assert_allclose(np.linalg.norm(view(moment.held + step) - view(moment.held)), 0.5)
    assert (view(np.array([0.0, 1.0, 0.0])) > 0.0).all()
