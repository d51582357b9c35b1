"""Workspaces of the design page: values, shares, and the thread that evaluates the newest."""

import queue
import threading
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.scene import bounds
from tensionlab.viewer.state import begin
from tensionlab.viewer.worker import Latest
from tensionlab.viewer.workspace import COARSE, FINE, Volume, WorkspaceWorker, surface, sweep, usable_metrics
from tensionlab.workspace.metrics import METRICS

HANGS_S = 600.0


def swept(state, count, wanted=lambda: True):
    return sweep(state, bounds(state.rig), count, wanted)


def test_the_values_are_those_of_a_sweep_with_the_platform_turned_as_at_the_hand():
    state = edits.set_fields(metric="tension-factor")(begin(tl.load_rig("ipanema-2")))
    turned = edits.turn_platform(state, tl.workspace.roll_pitch_yaw(0.0, 0.0, 0.3)[0])
    for each in (state, turned):
        volume = swept(each, 4)
        grid = tl.workspace.Grid(*volume.axes, each.rotation[None])
        expected = tl.sweep(each.rig, grid, "tension-factor")["tension-factor"].values.reshape(4, 4, 4)
        assert volume.values == pytest.approx(expected, nan_ok=True)


def test_a_sweep_ends_as_soon_as_it_is_not_wanted():
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


def test_share_and_surface_are_those_above_the_level():
    axis = np.linspace(-1.5, 1.5, 60)
    ball = Volume((axis,) * 3, 1.0 - np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis)), axis=0))
    assert ball.share(0.25) == pytest.approx(4 / 3 * np.pi * 0.75**3 / 27.0, rel=0.01)
    assert np.linalg.norm(surface(ball, 0.25).vertices, axis=1) == pytest.approx(0.75, abs=2e-3)
    assert surface(ball, 2.0) is None


def test_in_the_plane_the_region_is_filled():
    axis = np.linspace(-1.0, 1.0, 21)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    mesh = surface(Volume((axis, axis), 0.5 - np.abs(x) + 0.0 * y), 0.0)
    assert np.abs(mesh.vertices[:, 0]).max() == pytest.approx(0.45)  # 0.4 is the last above, a square has 0.05
    assert not mesh.vertices[:, 2].any()


@pytest.fixture
def found():
    """What a worker shows, one after another: the volume and that of the other rig."""
    return queue.Queue()


@pytest.fixture
def worker(found):
    made = WorkspaceWorker(lambda *volumes: found.put(volumes))
    yield made
    made.close()


def shown(name="kntu-planar", **changes):
    return edits.set_fields(show_workspace=True, **changes)(begin(tl.load_rig(name)))


def count(volumes):
    return len(volumes[0].axes[0])


def test_it_is_coarse_at_first_then_fine_and_another_force_leaves_it_so(worker, found):
    start = shown()
    worker.submit(start, fine=True)
    assert count(found.get(timeout=HANGS_S)) == COARSE
    fine = found.get(timeout=HANGS_S)
    assert count(fine) == FINE
    worker.submit(edits.set_wrench(start, [1.0, 0.0, 0.0]), fine=True)
    assert found.get(timeout=HANGS_S) == fine  # at once


def test_while_something_is_dragged_it_stays_coarse(worker, found):
    state = shown()
    for step in range(5):
        state = edits.move_anchor(state, "cable-1", state.anchors[0] + [0.01 * step, 0.0])
        worker.submit(state, fine=False)
    volume = None
    while volume is None or volume.axes[0][0] != bounds(state.rig)[0][0]:
        volume, _ = found.get(timeout=HANGS_S)
        assert len(volume.axes[0]) == COARSE


def test_the_other_rig_has_its_workspace_in_the_same_box(worker, found):
    worker.submit(shown(metric="body-distance"), fine=False)  # which the rig does not have: nothing is shown
    worker.submit(shown(ghost=tl.load_rig("kntu-planar")), fine=False)
    volume, ghost = found.get(timeout=HANGS_S)
    assert ghost.axes[0].tolist() == volume.axes[0].tolist()


def test_a_worker_drops_an_item_for_a_newer_one_and_survives_errors(caplog):
    begun, done = threading.Event(), queue.Queue()

    def work(item, wanted):
        begun.set()
        while item == "first" and wanted():
            pass
        done.put(item)
        if item == "impossible":
            raise ValueError("shapes differ")

    worker = Latest("example", work)
    worker.put("first")
    assert begun.wait(HANGS_S)
    for item in ("impossible", "possible"):
        worker.put(item)
        while done.get(timeout=HANGS_S) != item:
            pass
    worker.close()
    assert caplog.messages == ["view example: ValueError: shapes differ"]


def test_the_page_offers_the_metrics_that_the_rig_has_the_numbers_for():
    rig = tl.load_rig("kntu-planar")
    stiff = replace(rig, modules=tuple(replace(module, cable_stiffness=1e4) for module in rig.modules))
    further = {"least-stiffness", "stiffness-along", "first-natural-frequency"}
    assert further | {"body-distance"} <= set(METRICS) - set(usable_metrics(rig))
    assert set(usable_metrics(stiff)) - set(usable_metrics(rig)) == further
