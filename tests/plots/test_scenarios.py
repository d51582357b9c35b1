import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from tensionlab.errors import ShapeError
from tensionlab.plots.force_distance import against
from tensionlab.plots.scenarios import draw_force, draw_tension, moment_of, plot_scenario
from tensionlab.plots.timeline import draw_ribbons, pawls, ribbons
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.expected_values import Check, rendered_force
from tensionlab.scenarios.play import play, simulate_modules

ROWS = (
    Check("a thing that is right", "N", 1.0, 2.0, 1.5),
    Check("a thing that is not", "J", 1.0, 2.0, float("nan")),
)


def words_of(path):
    return re.findall(r"<!-- (.*?) -->", path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def bow():
    scenario = load_scenario("bow")
    return play(scenario, simulate_modules(scenario), seconds=3.6)


def test_a_picture_names_what_is_in_it(tmp_path, bow):
    plot_scenario(bow, ROWS, tmp_path / "bow.svg")
    words = words_of(tmp_path / "bow.svg")
    for word in (
        *(phase.name for phase in bow.scenario.phases),
        *("Force on the draw hand", "along x", "intended", "really felt", "smaller scale"),
        *("Tension of bow-hand", "cable, really", "limits of the motor", "time (s)"),
        *("bow-hand, brake", "brake asked for", "its pawl holds the cable", "bow-hand, by itself"),
        *("module on the body", "where brakes hold", "draw hand", "bow-hand"),
        *("Force against distance", "from bow hand to draw hand (m)"),
        *(
            "a thing that is right",
            "a thing that is not",
            "1 of 2 not as expected",
            "\N{CHECK MARK}",
            "\N{BALLOT X}",
        ),
    ):
        assert word in words, word
    assert "module in the room" not in words
    assert "along y" not in words  # the force there is nothing beside that along x


def test_without_rows_and_without_who_felt_it(tmp_path, bow):
    real = replace(bow, person=None)
    plot_scenario(real, (), tmp_path / "bow.svg")
    words = words_of(tmp_path / "bow.svg")
    assert "told by the modules" in words
    for word in ("really felt", "cable, really", "its pawl holds the cable", "What it was to feel like"):
        assert word not in words, word
    assert not pawls(real).any()


def test_lines_are_what_was_meant_and_felt(bow):
    axes = Figure().subplots()
    draw_force(axes, bow)
    meant, felt, _ = axes.get_lines()  # and zero
    np.testing.assert_array_equal(meant.get_xydata(), np.column_stack([bow.run.time, bow.run.desired[:, 0]]))
    np.testing.assert_array_equal(felt.get_xydata(), np.column_stack([bow.person.time, bow.person.force[:, 0]]))


def test_lines_are_what_the_module_was_told_says_and_pulls(bow):
    axes = Figure().subplots()
    draw_tension(axes, bow, 0)
    lower, upper, sent, told, really = (line.get_ydata() for line in axes.get_lines())
    assert (lower[0], upper[0]) == (0.5, 6.0)
    np.testing.assert_array_equal(sent, bow.run.commanded[:, 0])
    np.testing.assert_array_equal(told, bow.run.measured[:, 0])
    np.testing.assert_array_equal(really, bow.person.tensions[:, 0])
    assert axes.get_ylim()[1] > really.max()


def test_a_ribbon_lasts_as_long_as_the_brake_was_asked_for(bow):
    axes = Figure().subplots()
    draw_ribbons(axes, bow, ribbons(bow))
    (asked, *_) = [each for each in axes.collections if len(each.get_paths()) == 1]
    begin, end = asked.get_paths()[0].get_extents().intervalx
    assert end - begin == pytest.approx(bow.run.commanded_brakes.sum() / bow.run.setup.rate)
    assert begin == bow.run.time[bow.run.commanded_brakes[:, 0]][0]


def test_a_pawl_is_in_where_the_cable_pulls_harder_than_the_motor_could(bow):
    carried = pawls(bow)
    assert not carried[bow.run.time < bow.run.time[bow.run.commanded_brakes[:, 0]][0]].any()
    really = np.interp(bow.run.time, bow.person.time, bow.person.tensions[:, 0])
    assert carried[really > 8.0].all()
    assert not carried[really < bow.run.measured[:, 0] + 0.5].any()
    assert (really > 8.0).sum() > 50
    assert [each.kind for each in ribbons(bow)["bow-hand, brake"]] == ["brake", "pawl"]


def test_where_things_are_is_read_off_the_cables(bow):
    then = moment_of(bow, 2.0)
    script = bow.scenario.person.bodies["bow"]
    np.testing.assert_allclose(then.bodies["bow"], script.position(2.0), atol=0.01)
    np.testing.assert_allclose(then.anchors[0], then.bodies["bow"] + bow.run.rig.anchors[0])


def test_force_against_distance_is_the_pull_of_the_string(bow):
    (draw,) = [each for each in against(bow) if each.title == "draw"]
    string = bow.scenario.phases[0].effects["string"]
    drawn = slice(0, int(np.argmax(draw.meant.distance > 0.7)))
    wanted = string.pull(draw.meant.distance[drawn] - string.brace)
    np.testing.assert_allclose(draw.meant.force[drawn], wanted, atol=0.1)
    assert draw.felt.force.max() == pytest.approx(rendered_force(bow).force[:, 0].max(), rel=1e-3)  # the brake's


def test_a_suffix_without_a_format_is_refused(tmp_path, bow):
    with pytest.raises(ShapeError, match="pictures end in"):
        plot_scenario(bow, ROWS, tmp_path / "bow.jpeg")


def test_the_same_play_makes_the_same_file(tmp_path, bow):
    for name in ("one.png", "two.png"):
        plot_scenario(bow, ROWS, tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
