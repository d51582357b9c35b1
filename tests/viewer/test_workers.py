"""The thread that evaluates the workspace of the newest state."""

import threading

import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.scene import bounds
from tensionlab.viewer.state import begin
from tensionlab.viewer.workspace import COARSE, FINE, Latest, WorkspaceWorker

HANGS_S = 600.0


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
