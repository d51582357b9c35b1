"""Layout searches that the design page starts and stops."""

import threading

import pytest

import tensionlab as tl
from tensionlab.errors import InputError
from tensionlab.viewer.layout_runner import LayoutRunner
from tensionlab.workspace.layout.task import load_task

HANGS_S = 600.0
RIG = tl.load_rig("seven-modules")


@pytest.fixture
def task():
    return load_task("four-in-a-room")._replace(generations=2, starts=1)


def test_what_is_better_is_told_and_what_is_best_is_last(task):
    found, said = [], []
    runner = LayoutRunner(found.append, lambda share, text: said.append((share, text)))
    runner.start(task, RIG)
    runner._thread.join(HANGS_S)
    assert not runner.running
    scores = [layout.score for layout in found]
    assert scores == sorted(scores)
    assert scores
    assert said[-1][0] == 1.0
    assert said[-1][1].startswith("four-in-a-room-4: ")
    assert found[-1].rig == task.run().best.rig


def test_a_search_is_stopped_where_it_is(task):
    found, first, said = [], threading.Event(), []

    def better(layout):
        found.append(layout)
        first.set()

    runner = LayoutRunner(better, lambda share, text: said.append(text))
    runner.start(task._replace(generations=100_000), RIG)
    assert first.wait(HANGS_S)
    runner.stop()
    assert not runner.running
    assert said[-1].startswith("stopped; ")


def test_there_is_one_search_at_a_time(task):
    first = threading.Event()
    runner = LayoutRunner(lambda layout: first.set(), lambda share, text: None)
    runner.start(task._replace(generations=100_000), RIG)
    running = runner._thread
    runner.start(task, RIG)
    assert runner._thread is running
    runner.stop()


def test_rigs_of_another_kind_are_not_searched_for(task):
    runner = LayoutRunner(lambda layout: None, lambda share, text: None)
    with pytest.raises(InputError, match="is searched for point rigs, and ipanema-2 is a platform rig"):
        runner.start(task, tl.load_rig("ipanema-2"))
