import dataclasses
from functools import cache

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh

import tensionlab as tl
from tensionlab.errors import InputError
from tensionlab.plots import plot_shares, plot_slices, plot_volume, workspace
from tensionlab.plots.workspace import Field, read_field, share_above
from tensionlab.support.surfaces import level_surface
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep.plan import vary
from tests.helpers.figures import content_of, words_in


@pytest.fixture(scope="module")
def contents(swept):
    """What each function draws of the sweep, drawn once."""
    return cache(lambda draw: content_of(draw(swept)))


AXIS = np.linspace(-0.45, 0.45, 7)


@pytest.fixture(scope="module")
def swept():
    rigs = [tl.box_corners((1, 1, 1)), tl.alternate_corners((1, 1, 1))]
    return tl.sweep(rigs, Grid(AXIS, AXIS, AXIS), ["capacity-margin", "condition-number"])


def test_one_metric_may_be_drawn_alone(swept):
    words = words_in(content_of(plot_slices(swept, "capacity-margin")))
    assert "capacity margin (N)" in words
    assert "condition number of the structure matrix" not in words


def test_metrics_are_rows_and_rigs_columns(contents):
    words = words_in(contents(plot_slices))
    assert words.count("box-corners") == words.count("alternate-corners") == 2
    assert words.count("capacity margin (N)") == words.count("condition number of the structure matrix") == 1
    assert words.count("z = 0 m") == 1


def test_where_values_are_modules_each_has_its_name_and_colour():
    rig, other = tl.load_rig("seven-modules"), tl.load_rig("cube-8")
    grid = Grid(AXIS, 1.2 + AXIS, 0.0)
    words = words_in(content_of(plot_slices(tl.sweep(rig, grid, "worst-loss"))))
    assert {module.name for module in rig.modules} <= set(words)
    assert "zero or less" not in words
    both = read_field(tl.sweep([rig, other], grid, "worst-loss"))
    assert list(both.modules) == [*"01234567"]  # not all rigs have the same modules


def test_a_slice_shows_the_values_of_its_plane(swept):
    field = read_field(swept)
    assert field.axes.keys() == {"x", "y", "z"}
    assert field.up == "y"
    np.testing.assert_array_equal(field.values[1], swept["capacity-margin"].isel(rig=1).to_numpy())
    assert [len(anchors) for anchors in field.anchors] == [8, 4]


def test_slices_are_where_the_hand_is_and_not_in_the_middle_of_the_box():
    rig = tl.load_rig("bartels2026-validation")
    rig = dataclasses.replace(rig, home=[0.0, 0.3, 0.2])
    found = tl.sweep(rig, Grid(AXIS, 0.5 + AXIS, AXIS), "capacity-margin")
    assert "z = 0.15 m" in words_in(content_of(plot_slices(found)))


def test_where_one_axis_has_one_point_that_is_the_slice():
    found = tl.sweep(tl.box_corners((1, 1, 1)), Grid(AXIS, [0.1], AXIS), "capacity-margin")
    assert "y = 0.1 m" in words_in(content_of(plot_slices(found)))


def test_volumes_say_which_share_of_the_box_they_are(swept, contents):
    words = words_in(contents(plot_volume))
    share = tl.workspace.summary(swept)["above_zero"][0]
    assert f"box-corners: {100 * share:.0f} % of the box" in words
    assert "capacity margin (N) above 0" in words


def test_shares_fall_from_all_that_is_above_zero_to_nothing():
    values = np.array([[[np.nan], [-1.0], [0.0], [1.0], [2.0]]])  # the ends stand for half as much
    field = Field(values, {"x": np.arange(5.0), "y": np.zeros(1)}, ["rig"], [], [], np.zeros(2), "", "y")
    levels = [0.0, 1.0, 1.5, 2.0, 2.5]
    np.testing.assert_allclose(share_above(field, 0, levels), [0.375, 0.375, 0.125, 0.125, 0.0])


def test_curves_are_called_by_what_tells_the_rigs_apart():
    rigs = vary(tl.ring_plus_top, side=1.0, count=[3, 4])
    found = tl.sweep(rigs, Grid(AXIS, AXIS + 0.6, AXIS), "capacity-margin")
    assert {"count 3", "count 4"} <= set(words_in(content_of(plot_shares(found))))


def test_pictures_of_a_planar_rig():
    modules = tuple(tl.Module(f"{x} {y}", np.array([x, y]), 0.5, 6.0) for x in (-1, 1) for y in (-1, 1))
    rig = tl.Rig("square", "planar-point", modules, np.zeros(2))
    found = tl.sweep(rig, Grid(AXIS, AXIS), "capacity-margin")
    content_of(plot_slices(found))
    with pytest.raises(InputError, match="several x, y and z"):
        plot_volume(found)


def test_a_panel_of_nothing_is_grey_beside_one_of_something():
    """Three modules on the floor hold nothing anywhere."""
    grid = tl.workspace.box((-0.4, 0.4), (0.2, 0.6), (0, 0), step=0.2)
    rigs = [tl.load_rig("floor-3"), tl.load_rig("bartels2026-validation")]
    swept = tl.sweep(rigs, grid, "capacity-margin")
    for figure in (plot_slices(swept), plot_slices(swept.isel(rig=[0]))):
        figure.canvas.draw()
        pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]
        column, row = figure.axes[0].transData.transform([-0.3, 0.55]).astype(int)
        assert pixels[len(pixels) - row, column].tolist() == [0xE4] * 3


@pytest.mark.parametrize("value", [-1.0, 0.0, 3.0, np.inf, np.nan])
def test_a_metric_with_one_value_everywhere_is_drawn(swept, value):
    margin = swept["capacity-margin"]
    found = swept.assign({"capacity-margin": (margin.dims, np.full(margin.shape, value), margin.attrs)})
    for draw in (plot_slices, plot_shares, plot_volume):
        words = words_in(content_of(draw(found, "capacity-margin")))
        assert any("capacity margin (N)" in each for each in words)
        assert ("yes" in words) == (value == 0.0 and draw is plot_slices)


def test_what_cannot_be_drawn_is_refused(swept):
    with pytest.raises(InputError, match='no metric "margin"; it has capacity-margin, condition-number'):
        plot_slices(swept, "margin")
    along = tl.sweep(tl.box_corners((1, 1, 1)), np.zeros((3, 3)), "capacity-margin")
    with pytest.raises(InputError, match="grid"):
        plot_shares(along)
    coarse = tl.sweep(tl.box_corners((1, 1, 1)), Grid([0.0], [0.1], [0.2]), "capacity-margin")
    with pytest.raises(InputError, match=r"needs two positions or more along .*; give a smaller step"):
        plot_slices(coarse)


def test_the_same_sweep_makes_the_same_figure(swept, contents):
    for draw in (plot_slices, plot_volume, plot_shares):
        assert content_of(draw(swept)) == contents(draw)


@pytest.fixture(scope="module")
def tilted():
    rig = tl.load_rig("cogiro")
    turns = tl.workspace.cone(np.radians(10.0), np.radians(10.0))
    poses = tl.workspace.box((-6, 6), (-4, 4), (0, 4), step=2.0, rotations=turns)
    return tl.sweep(rig, poses, ["wrench-feasible", "capacity-margin"])


def test_what_is_feasible_or_not_is_drawn_as_yes_and_no(tilted):
    total = tilted.min("orientation", skipna=False, keep_attrs=True)
    figure = plot_slices(total, "wrench-feasible")
    panel, bar = figure.axes
    assert bar.get_ylabel() == "wrench feasibility"
    assert [each.get_text() for each in bar.get_yticklabels()] == ["no", "yes"]
    (cells,) = [each for each in panel.collections if isinstance(each, QuadMesh)]
    np.testing.assert_array_equal(cells.get_array(), total["wrench-feasible"].isel(rig=0, y=2).to_numpy().T)
    margin = plot_slices(total, "capacity-margin").axes[1]
    assert margin.get_ylabel() == "capacity margin (N)"
    assert len(margin.get_yticklabels()) > 2


def test_a_volume_of_yes_and_no_ends_half_way_between_poses(swept, monkeypatch):
    inside = (abs(swept.x) < 0.2) & (abs(swept.y) < 0.2) & (abs(swept.z) < 0.2)  # 3 poses of 7, 0.15 m apart
    truth = (inside * xr.ones_like(swept["capacity-margin"])).assign_attrs(units="1", long_name="truth")
    drawn = []
    monkeypatch.setattr(
        workspace, "level_surface", lambda *words: drawn.append(level_surface(*words)) or drawn[-1]
    )
    plot_volume(swept.assign({"capacity-margin": truth}).isel(rig=[0]))
    assert abs(drawn[0][0]).max() == pytest.approx(0.15 + 0.15 / 2)
