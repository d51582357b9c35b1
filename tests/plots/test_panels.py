"""Figures of one panel draw into a panel of another figure, and keep its style; notebooks show them."""

import importlib
from base64 import b64decode

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import tensionlab as tl
from tensionlab import plots
from tensionlab.errors import InputError
from tests.helpers.runs import four

AXIS = np.linspace(-0.4, 0.4, 5)
RIGS = [tl.box_corners((1, 1, 1)), tl.alternate_corners((1, 1, 1))]


@pytest.fixture(scope="module")
def swept():
    return tl.sweep(RIGS, tl.workspace.Grid(AXIS, AXIS, AXIS), "capacity-margin")


@pytest.fixture
def panel():
    """A panel of a figure of pyplot in the style of the user, which no drawing may change."""
    made = []

    def make(projection=None):
        made.append(plt.figure())
        return made[-1].add_subplot(1, 2, 2, projection=projection)

    with mpl.rc_context({"font.size": 20.0, "axes.spines.top": True}):
        before = dict(mpl.rcParams)
        yield make
        assert dict(mpl.rcParams) == before
    for figure in made:
        plt.close(figure)


def test_figures_of_one_panel_draw_into_a_panel_in_the_style_of_tensionlab(bench_results, swept, panel):
    rig = four()
    allocation = tl.allocate(rig.structure_matrix(rig.home), np.zeros(3), rig.limits)
    ax = panel()
    assert plots.plot_pareto(bench_results, ax=ax) is None  # a notebook shows the figure once
    assert ax.get_xscale() == "log"
    assert ax.get_legend().get_texts()[0].get_fontsize() == 8.5
    assert ax.figure.axes == [ax]
    assert not any(label.get_text().startswith("\\$") for label in ax.get_yticklabels())
    ax = panel("3d")
    assert plots.plot_rig(RIGS[0], ax=ax) is None
    assert ax.get_title() == "box-corners"
    ax = panel()
    plots.plot_shares(swept, ax=ax)
    assert len(ax.get_lines()) == 2
    ax = panel()
    assert plots.plot_allocation(allocation, rig, ax=ax) is None
    assert ax.get_xlabel() == "tension (N)"


def test_a_panel_of_another_projection_is_refused(panel):
    with pytest.raises(InputError, match='ax has the projection "rectilinear"; give one with "3d"'):
        plots.plot_rig(RIGS[0], ax=panel())


def test_own_figures_can_have_the_style(panel):
    with plots.styled():
        ax = panel()
    assert not ax.spines["top"].get_visible()
    assert panel().spines["top"].get_visible()


def test_a_notebook_shows_the_file_that_is_saved_at_its_size(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda data, **about: shown.append((data, about)))
    figure = tl.plot(four())
    plots.save_figure(figure, tmp_path / "rig.png")
    figure._ipython_display_()
    ((data, about),) = shown
    assert set(data) == {"text/plain", "image/png"}
    assert b64decode(data["image/png"]) == (tmp_path / "rig.png").read_bytes()
    assert about["metadata"] == {"image/png": {"width": 750}}
    assert not plt.get_fignums()


def test_every_class_that_has_a_figure_is_found_by_its_name_and_others_are_refused():
    for name in plots.PLOTTERS:
        module, _, kind = name.rpartition(".")
        assert isinstance(getattr(importlib.import_module(module), kind), type)
    with pytest.raises(InputError, match=r"no figure of a dict; tl\.plot draws Allocation, "):
        tl.plot({})
