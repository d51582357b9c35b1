"""Workspaces of the design page: values, shares, and the thread that evaluates the newest."""

import threading

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.scene import bounds
from tensionlab.viewer.state import begin
from tensionlab.viewer.workspace import COARSE, FINE, Latest, Volume, WorkspaceWorker, surface, sweep

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


class Found:
    """What a worker found, to be waited for."""

    def __init__(self):
        self.seen, self._more = [], threading.Condition()

    def __call__(self, volume, ghost):
        with self._more:
            self.seen.append((volume, ghost))
            self._more.notify_all()

    @property
    def counts(self):
        return [len(volume.axes[0]) for volume, _ in self.seen]

    def until(self, met):
        with self._more:
            assert self._more.wait_for(lambda: met(self), HANGS_S)


def shown(name="bartels2026-validation", **changes):
    return edits.set_fields(show_workspace=True, **changes)(begin(tl.load_rig(name)))


@pytest.fixture
def found():
    return Found()


@pytest.fixture
def worker(found):
    made = WorkspaceWorker(found)
    yield made
    made.close()


def test_it_is_coarse_at_first_then_fine_and_another_force_leaves_it_so(worker, found):
    start = shown("kntu-planar")
    worker.submit(start, fine=True)
    found.until(lambda found: found.counts == [COARSE, FINE])
    worker.submit(edits.set_wrench(start, [1.0, 0.0, 0.0]), fine=True)
    found.until(lambda found: len(found.seen) == 3)
    assert found.seen[2] == found.seen[1]  # at once


def test_while_something_is_dragged_it_stays_coarse(worker, found):
    state = shown("kntu-planar")
    for step in range(5):
        state = edits.move_anchor(state, "cable-1", state.anchors[0] + [0.01 * step, 0.0])
        worker.submit(state, fine=False)
    low = bounds(state.rig)[0]
    found.until(lambda found: found.seen and found.seen[-1][0].axes[0][0] == low[0])
    assert set(found.counts) == {COARSE}


def test_the_other_rig_has_its_workspace_in_the_same_box(worker, found):
    worker.submit(shown("kntu-planar", ghost=tl.load_rig("kntu-planar")), fine=False)
    found.until(lambda found: found.seen and found.seen[-1][1] is not None)
    volume, ghost = found.seen[-1]
    assert ghost.axes[0].tolist() == volume.axes[0].tolist()


def test_a_metric_that_a_rig_has_not_is_no_end(worker, found):
    worker.submit(shown(metric="body-distance"), fine=False)
    worker.submit(shown(), fine=False)
    found.until(lambda found: found.seen)


def test_what_is_at_work_learns_that_it_is_no_longer_wanted():
    begun, dropped = threading.Event(), threading.Event()

    def work(item, wanted):
        begun.set()
        while item == 1 and wanted():
            pass
        dropped.set()

    worker = Latest("test", work)
    worker.submit(1)
    assert begun.wait(HANGS_S)
    worker.submit(2)
    assert dropped.wait(HANGS_S)
    worker.close()


def test_it_outlives_what_fails(caplog):
    failed, done = threading.Event(), threading.Event()

    def work(item, wanted):
        if item == "impossible":
            failed.set()
            raise ValueError("shapes differ")
        done.set()

    worker = Latest("example", work)
    worker.submit("impossible")
    assert failed.wait(HANGS_S)
    worker.submit("possible")
    assert done.wait(HANGS_S)
    worker.close()
    assert caplog.messages == ["view example: ValueError: shapes differ"]
