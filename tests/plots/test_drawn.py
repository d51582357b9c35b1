"""What figures draw, in numbers: those of the figures that were looked at.

After an intended change look at the figures, then write their numbers anew: ``python -m tests.plots.test_drawn``.
"""

import functools
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import Collection
from matplotlib.colors import to_rgba
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator

import tensionlab as tl
from tensionlab import plots
from tensionlab.hardware.log.reader import read_run
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tests.helpers import runs
from tests.helpers.recorded import made_up

DRAWN = Path(__file__).parents[1] / "data" / "figures.json"
AXIS = np.linspace(-0.45, 0.45, 5)
SMALL = "bartels2026-validation-0.3m"


@functools.cache
def swept():
    rigs = [tl.box_corners((1, 1, 1)), tl.alternate_corners((1, 1, 1))]
    return tl.sweep(rigs, tl.workspace.Grid(AXIS, AXIS, AXIS + 0.1), ["capacity-margin", "condition-number"])


@functools.cache
def played(name):
    scenario = load_scenario(name)
    return play(scenario, simulate_modules(scenario), seconds=1.2)


def searched(counts):
    hand = tl.workspace.box([-0.2, 0.2], [1.0, 1.4], [-0.2, 0.2], step=0.4)
    space = tl.workspace.Space(tl.workspace.room([3.0, 2.4, 4.0]), counts=counts, up="y")
    found = tl.workspace.search_layout(space, hand, tl.workspace.Objective(), generations=1, starts=1)
    return plots.plot_search(space, hand, found)


def logged(rig, count):
    with tempfile.TemporaryDirectory() as folder:
        runs.logged(Path(folder, "run.mcap"), rig, count, lost=2)
        return plots.plot_run(read_run(Path(folder, "run.mcap")))


def allocated(name, forces):
    rig = tl.load_rig(name)
    found = tl.allocate(rig.structure_matrix(rig.home), forces, rig.limits)
    return plots.plot_allocation(found, rig)


def compared(name, wrenches=None, **more):
    rig = tl.load_rig(name)
    return plots.plot_comparison(tl.compare(rig, wrenches, solvers=["newton", "closed-form"], **more))


def compared_on_path():
    path = tl.load_rig(SMALL).home + np.linspace(0.0, 0.3, 30)[:, None] * [1.0, 0.0, 0.0]
    return compared(SMALL, [0.0, 0.0, 1.0], poses=path)


def certified(region):
    rig = tl.load_rig("bartels2026-validation")
    return plots.plot_certified(tl.workspace.certify(rig, region, ([0.0, 0.0, 0.0], 1.0), 0.1))


FIGURES = {
    **{name: functools.partial(lambda name: plots.plot_rig(tl.load_rig(name)), name)
       for name in ("kntu-planar", "cogiro", "body-mounted", "floor-3")},
    "one allocation": lambda: allocated(SMALL, [0.0, 1.0, 0.0]),
    "allocations": lambda: allocated(SMALL, np.outer(np.linspace(-4.0, 9.0, 60), [0.2, 1.0, 0.0])),
    "slices": lambda: plots.plot_slices(swept()),
    "volume": lambda: plots.plot_volume(swept()),
    "shares": lambda: plots.plot_shares(swept()),
    "certified": lambda: certified([(-0.6, 0.6), (0.0, 1.6), (-0.5, 0.6)]),
    "certified plane": lambda: certified([(-0.6, 0.6), (0.3, 0.3), (-0.5, 0.6)]),
    "search": lambda: searched((4, 5)),
    "run": lambda: logged(runs.seven(), 100),
    "comparison": lambda: compared(SMALL),
    "comparison in the plane": lambda: compared("kntu-planar", magnitude=20.0),
    "comparison on a path": compared_on_path,
    "forces": lambda: plots.plot_forces(made_up()),
    **{name: functools.partial(lambda name: plots.plot_scenario(played(name)), name)
       for name in ("bow", "recoil", "materials")},
    "bow without a person": lambda: plots.plot_scenario(replace(played("bow"), person=None)),
}  # fmt: skip


def points_and_colour(artist):
    """Return the points of an artist in its own coordinates, and its colours."""
    if isinstance(artist, Line2D):
        return artist.get_xydata(), to_rgba(artist.get_color())
    if isinstance(artist, AxesImage):
        values = np.ma.filled(np.ma.asarray(artist.get_array(), dtype=float), 0.0)
        extent = np.reshape(artist.get_extent(), (2, 2)).T
        return np.concatenate([extent, [[values.mean(), values.std()]]]), to_rgba("none")
    if isinstance(artist, Collection):
        paths = [path.vertices for path in artist.get_paths() if len(path.vertices)]
        values = np.zeros(0) if artist.get_array() is None else np.ravel(np.ma.filled(artist.get_array(), 0.0))
        points = [np.zeros((0, 2)), *paths, artist.get_offsets(), np.column_stack([values, values])]
        filled = len(artist.get_facecolor()) > 0
        return np.concatenate(points), artist.get_facecolor() if filled else artist.get_edgecolor()
    if isinstance(artist, Patch):
        return artist.get_patch_transform().transform(artist.get_path().vertices), artist.get_facecolor()
    return np.array([artist.get_position()]), to_rgba(artist.get_color())


def drawn_in(figure):
    """Return what a figure has: its size, and of each panel limits, words, and artists by their kind."""
    panels = []
    for axes in figure.get_axes():
        words = sorted({text.get_text() for text in axes.findobj(Text)} - {""})
        sides = [f"{text.get_text()}: {text.get_ha()} {text.get_va()}" for text in axes.texts]
        fixed = [each.get_majorticklocs() for each in (axes.xaxis, axes.yaxis)
                 if isinstance(each.get_major_locator(), FixedLocator)]  # fmt: skip
        if any("µs" in word for word in words):
            continue  # times differ from computer to computer
        panel = {"limits": [*axes.get_xlim(), *axes.get_ylim()], "words": words, "sides": sides}
        panel["ticks"] = [float(tick) for ticks in fixed for tick in ticks]
        for kind in (Line2D, Collection, Patch, AxesImage, Text):
            artists = [each for each in axes.get_children() if isinstance(each, kind) and each.get_visible()]
            parts = [points_and_colour(each) for each in artists]
            points = np.concatenate([np.zeros((0, 2)), *(each for each, _ in parts)]).astype(float)
            points = np.clip(points[np.isfinite(points).all(axis=1)], -1e6, 1e6)
            if len(points):
                colour = np.concatenate([np.reshape(each, (-1, 4)) for _, each in parts]).mean(axis=0)
                spread = [*points.mean(axis=0), *points.std(axis=0), (points[:, 0] * points[:, 1]).mean()]
                panel[kind.__name__] = [len(artists), len(points), *spread, *colour]
        panels.append(panel)
    return {"size": list(figure.get_size_inches()), "panels": panels}


def rounded(value):
    """Return the same with numbers of five digits, for a small file."""
    if isinstance(value, dict):
        return {key: rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    return value if isinstance(value, str) else float(f"{value:.5g}")


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_draws_what_was_looked_at(name):
    expected = json.loads(DRAWN.read_text(encoding="utf-8"))[name]
    found = drawn_in(FIGURES[name]())
    assert found["size"] == pytest.approx(expected["size"], rel=0.01)
    assert len(found["panels"]) == len(expected["panels"])
    for panel, known in zip(found["panels"], expected["panels"], strict=True):
        assert panel["words"] == known["words"]
        assert panel.keys() == known.keys()
        assert panel["sides"] == known["sides"]
        for kind in panel.keys() - {"words", "sides"}:
            near = 0.05 if kind == "Text" else 0.005  # places of names depend on the font
            np.testing.assert_allclose(panel[kind], known[kind], rtol=near, atol=near, err_msg=kind)


if __name__ == "__main__":
    known = {name: json.dumps(rounded(drawn_in(draw()))) for name, draw in FIGURES.items()}
    lines = ",\n".join(f"{json.dumps(name)}: {content}" for name, content in known.items())
    DRAWN.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
