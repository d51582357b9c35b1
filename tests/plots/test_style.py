import numpy as np
import pytest
from matplotlib.figure import Figure

import tensionlab as tl
from tensionlab.errors import InputError
from tensionlab.plots import plot_rig
from tensionlab.plots.style import save_figure, two_scales
from tests.helpers.runs import four


@pytest.mark.parametrize(
    ("rig", "suffixes"),
    [
        ("bartels2026-validation", (".png", ".pdf", ".svg")),
        ("kntu-planar", (".svg",)),
        ("body-mounted", (".svg",)),
    ],
)
def test_the_same_figure_makes_the_same_file(tmp_path, rig, suffixes):
    figures = {name: plot_rig(tl.load_rig(rig)) for name in ("one", "two", "other")}
    figures["other"].text(0.5, 0.5, "another")
    for suffix in suffixes:
        for name, figure in figures.items():
            save_figure(figure, tmp_path / f"{name}{suffix}")
        one, two, other = ((tmp_path / f"{name}{suffix}").read_bytes() for name in figures)
        assert one == two, suffix
        assert one != other, suffix
        assert len(one) > 10_000, suffix


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_six_newtons_and_fifty_can_both_be_read(sign):
    axes = Figure().subplots()
    assert not two_scales(axes, np.array([0.0, 5.0, np.nan]), 8.0)
    assert (axes.get_yscale(), axes.get_ylim()[1]) == ("linear", pytest.approx(5.3))
    assert two_scales(axes, sign * np.array([0.0, 6.0, 50.0]), 8.0)
    places = axes.transAxes.inverted().transform(
        axes.transData.transform([(0.0, sign * y) for y in (0, 4, 6, 20, 40)])
    )
    gaps = np.abs(np.diff(places[:, 1]))
    assert gaps.min() > 0.05
    assert gaps[0] == pytest.approx(2 * gaps[1])
    ticks = sign * axes.get_yticks()
    assert {2.0, 6.0, 20.0, 40.0} <= set(ticks)
    assert (ticks >= 0.0).all()


@pytest.mark.parametrize(
    ("ends", "limits", "ticks", "shades"),
    [
        ((0.0, 50.0), (0.0, 57.5), [0, 2, 4, 6, 20, 40], [(8.0, 57.5)]),
        ((-3.0, 50.0), (-3.4, 57.5), [-2, 0, 2, 4, 6, 20, 40], [(8.0, 57.5)]),
        ((-50.0, 7.0), (-57.5, 7.4), [-40, -20, -6, -4, -2, 0, 2, 4, 6], [(-57.5, -8.0)]),
        ((-20.0, 20.0), (-23.0, 23.0), [-20, -6, -4, -2, 0, 2, 4, 6, 20], [(8.0, 23.0), (-23.0, -8.0)]),
    ],
)
def test_what_is_beyond_the_knee_is_shaded_and_has_coarse_ticks(ends, limits, ticks, shades):
    axes = Figure().subplots()
    assert two_scales(axes, np.array(ends), 8.0)
    assert axes.get_ylim() == pytest.approx(limits)
    assert axes.get_yticks().tolist() == ticks
    spans = [sorted((patch.get_y(), patch.get_y() + patch.get_height())) for patch in axes.patches]
    np.testing.assert_allclose(sorted(spans), sorted(map(sorted, shades)))
    assert not two_scales(Figure().subplots(), np.array([0.0, 8.0]), 8.0)
    below = Figure().subplots()
    assert not two_scales(below, np.array([-1.0, 5.0]), 8.0)
    assert below.get_ylim() == pytest.approx((-1.36, 5.36))


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"\.png, \.pdf, \.svg"):
        save_figure(plot_rig(four()), tmp_path / "rig.bmp")
    assert not list(tmp_path.iterdir())
