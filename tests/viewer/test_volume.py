"""Workspaces of the design page: values, surfaces, shares, and an end when nobody wants them."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.scene import bounds
from tensionlab.viewer.state import begin
from tensionlab.viewer.workspace import Volume, surface, sweep


def swept(state, count, wanted):
    return sweep(state, bounds(state.rig), count, wanted)


def test_the_values_are_those_of_a_sweep():
    state = edits.set_fields(metric="tension-factor")(begin(tl.load_rig("bartels2026-validation")))
    volume = swept(state, 6, lambda: True)
    grid = tl.workspace.Grid(*volume.axes)
    expected = tl.sweep(state.rig, grid, "tension-factor")["tension-factor"].values[0]
    assert volume.values == pytest.approx(expected, nan_ok=True)


def test_a_platform_is_turned_as_at_the_hand():
    state = begin(tl.load_rig("ipanema-2"))
    turned = edits.turn_platform(state, tl.workspace.roll_pitch_yaw(0.0, 0.0, 0.3)[0])
    assert not np.allclose(swept(state, 5, lambda: True).values, swept(turned, 5, lambda: True).values)


def test_a_sweep_ends_as_soon_as_nobody_wants_it():
    asked = []
    assert swept(begin(tl.load_rig("seven-modules")), 60, lambda: asked.append(1)) is None
    assert len(asked) == 1


@pytest.mark.parametrize("name", tl.datasets.names("rigs"))
def test_the_box_has_room_around_every_rig(name):
    rig = tl.load_rig(name.removeprefix("rigs/"))
    low, high = bounds(rig)
    assert (low <= rig.home).all()
    assert (rig.home <= high).all()
    assert (high - low).min() >= 0.5 * (high - low).max() - 1e-9


def ball(count):
    """The distance from the surface of the unit ball, in a cube of 3 m."""
    axis = np.linspace(-1.5, 1.5, count)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    return Volume((axis, axis, axis), 1.0 - np.sqrt(x**2 + y**2 + z**2))


def test_the_share_is_that_of_the_box():
    assert ball(60).share(0.25) == pytest.approx(4 / 3 * np.pi * 0.75**3 / 27.0, rel=0.01)


def test_in_the_plane_the_region_is_filled():
    axis = np.linspace(-1.0, 1.0, 21)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    mesh = surface(Volume((axis, axis), 0.5 - np.abs(x) + 0.0 * y), 0.0)
    assert np.abs(mesh.vertices[:, 0]).max() == pytest.approx(0.45)  # 0.4 is the last above, a square has 0.05
    assert mesh.vertices[:, 2].tolist() == [0.0] * len(mesh.vertices)
