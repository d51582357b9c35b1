"""The thread that evaluates the workspace of the newest state."""

import threading

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.state import begin
from tensionlab.viewer.volume import COARSE, FINE
from tensionlab.viewer.workers import Latest, WorkspaceWorker

HANGS_S = 600.0


class Found:
    """What a worker found, to be waited for."""

    def __init__(self):
        self.seen, self._more = [], threading.Condition()

    def __call__(self, state, volume, ghost):
        with self._more:
            self.seen.append((state, len(volume.axes[0]), ghost))
            self._more.notify_all()

    def until(self, met):
        with self._more:
            assert self._more.wait_for(lambda: any(met(*each) for each in self.seen), HANGS_S)


def shown(name="bartels2026-validation", **changes):
    return edits.set_fields(display="surface", **changes)(begin(tl.load_rig(name)))


def test_it_is_coarse_at_first_then_fine():
    found = Found()
    worker = WorkspaceWorker(found)
    worker.submit(shown(metric="least-singular-value"), fine=True)
    found.until(lambda state, count, ghost: count == FINE)
    worker.close()
    assert [count for _, count, _ in found.seen] == [COARSE, FINE]


def test_while_something_is_dragged_it_stays_coarse():
    found = Found()
    worker = WorkspaceWorker(found)
    start = shown("kntu-planar")
    for step in range(5):
        start = edits.move_anchor(start, "cable-1", start.anchors[0] + [0.01 * step, 0.0])
        worker.submit(start, fine=False)
    found.until(lambda state, count, ghost: state is start)
    worker.close()
    assert {count for _, count, _ in found.seen} == {COARSE}


def test_another_force_leaves_the_workspace_as_it_is():
    found = Found()
    worker = WorkspaceWorker(found)
    start = shown("kntu-planar")
    worker.submit(start, fine=True)
    found.until(lambda state, count, ghost: count == FINE)
    other = edits.set_wrench(start, [1.0, 0.0, 0.0])
    worker.submit(other, fine=True)
    found.until(lambda state, count, ghost: state is other and count == FINE)  # at once the fine one
    worker.close()
    assert [count for state, count, _ in found.seen if state is other] == [FINE]


def test_the_other_rig_has_its_workspace_in_the_same_box():
    found = Found()
    worker = WorkspaceWorker(found)
    worker.submit(shown("kntu-planar", ghost=tl.load_rig("kntu-planar")), fine=False)
    found.until(lambda state, count, ghost: ghost is not None)
    worker.close()


def test_a_metric_that_a_rig_has_not_is_no_end():
    found = Found()
    worker = WorkspaceWorker(found)
    worker.submit(shown(metric="body-distance"), fine=False)
    worker.submit(shown(), fine=False)
    found.until(lambda state, count, ghost: state.metric == "capacity-margin")
    worker.close()


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
