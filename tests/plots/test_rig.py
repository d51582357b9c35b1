import dataclasses

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.plots import plot_allocation, plot_rig
from tensionlab.plots.rig import body_outlines
from tests.helpers.figures import content_of, words_in
from tests.helpers.runs import four, seven


@pytest.mark.parametrize("name", tl.datasets.names("rigs"))
def test_every_rig_is_drawn_with_the_names_of_its_modules(name):
    rig = tl.load_rig(name.removeprefix("rigs/"))
    drawn = words_in(content_of(plot_rig(rig)))
    assert "x (m)" in drawn
    assert ("z (m)" in drawn) == (rig.dimension == 3)
    names = {name for words in drawn for name in words.split(", ")}
    # Two hyphens would end the comment in which matplotlib keeps the word.
    assert all(module.name.replace("--", "- -") in names for module in rig.modules)


def test_a_flat_rig_has_a_flat_picture_with_all_of_it():
    flat, high = (plot_rig(tl.load_rig(name)) for name in ("floor-3", "body-mounted"))
    assert flat.get_figheight() < 0.7 * high.get_figheight()
    flat.canvas.draw()
    pixels = np.asarray(flat.canvas.buffer_rgba())[..., :3].min(axis=-1)
    rows = np.flatnonzero((pixels < 250).any(axis=1))
    assert np.diff(rows).max() < 0.6 * flat.dpi, "no white band"
    names = [text.get_text() for text in flat.axes[0].texts]
    assert names == ["floor-1", "floor-2", "floor-3"]


def test_bodies_are_drawn_where_they_are_at_rest():
    """The hull of the points drawn reaches as far as the person does: 1.75 m up from the floor."""
    bodies, rest = tl.person("seated", up="y", at=[0.0, 0.2, -1.0])
    rig = dataclasses.replace(four(), bodies=bodies, rest=(rest,))
    outlines = np.concatenate(body_outlines(rig))
    assert outlines[:, 1].max() == pytest.approx(0.2 + 0.755 * 1.75, abs=0.01)
    assert np.ptp(outlines[:, 0]) == pytest.approx(2 * 0.284, abs=0.01)
    assert "body" in words_in(content_of(plot_rig(rig)))
    flat = tl.load_rig("kntu-planar")
    disc = tl.Body("disc", [0.3, 0.3], radius=0.2)
    (patch,) = plot_rig(dataclasses.replace(flat, bodies=(disc,))).axes[0].patches
    np.testing.assert_allclose(np.linalg.norm(patch.get_xy() - [0.3, 0.3], axis=1), 0.2)


def test_tensions_are_drawn_between_their_limits_by_status():
    rig = four()
    forces = np.array([[0.0, 1.0, 0.0], [0.0, 90.0, 0.0]])
    found = tl.allocate(rig.structure_matrix(rig.home), forces, rig.limits)
    figure = tl.plot(found, rig)
    (axes,) = figure.axes
    drawn = [line.get_xdata() for line in axes.get_lines()]
    assert [list(each) for each in drawn[:4]] == [[0.5, 6.0]] * 4
    assert sorted(float(each[0]) for each in drawn[4:]) == sorted(found.tensions.ravel())
    content = content_of(figure)
    assert {"floor-1", "tension (N)", "exact", "certified infeasible", "limits"} <= set(words_in(content))
    assert content == content_of(plot_allocation(found, rig))


def test_a_rig_with_other_cables_is_refused():
    rig = four()
    with pytest.raises(tl.errors.ShapeError, match="4 cables, and seven-modules has 7"):
        tl.plot(tl.allocate(rig.structure_matrix(rig.home), np.zeros(3), rig.limits), seven())
