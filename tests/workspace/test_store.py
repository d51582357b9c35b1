"""A sweep that is killed goes on where it was, and never takes another's store for its own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tallied import Tallied, read

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.workspace.pose_sets import Grid
from tensionlab.workspace.store import LEDGER, Store
from tensionlab.workspace.vary import vary

RIGS = vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4])
POSES = Grid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), np.linspace(-1, 1, 3))
CHUNK = 9  # 2 x 2 x 5 x 2 chunks of 3 x 3 poses or less
COUNT = 40

PROGRAM = """
import sys
import numpy as np
import tensionlab as tl
from tallied import Tallied
from tensionlab.workspace.pose_sets import Grid
from tensionlab.workspace.vary import vary

tl.sweep(
    vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4]),
    Grid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), np.linspace(-1, 1, 3)),
    ["least-singular-value", Tallied(sys.argv[2], 0.1)],
    out=sys.argv[1],
    chunk=9,
)
"""


@pytest.fixture
def store(tmp_path):
    return tmp_path / "sweep.zarr"


def sweep(store, tally, **changed):
    arguments = {"rigs": RIGS, "poses": POSES, "measures": ["least-singular-value", Tallied(str(tally), 0.02)]}
    return tl.sweep(**{**arguments, **changed}, out=store, chunk=CHUNK)


def start(store, tally):
    path = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen([sys.executable, "-c", PROGRAM, store, tally], env={**os.environ, "PYTHONPATH": path})


def lines(store):
    ledger = store / LEDGER
    return ledger.read_text().splitlines() if ledger.exists() else []


def wait_for(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline, "waited for too long"
        time.sleep(0.001)


def test_a_finished_store_is_the_sweep_and_nothing_else(store, tmp_path):
    data = sweep(store, tmp_path / "a").load()
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", Tallied(str(tmp_path / "a"), 0.02)])
    assert data.drop_attrs(deep=False).identical(expected.drop_attrs(deep=False))
    assert not (store / LEDGER).exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "sweep.zarr"]
    assert data["least-singular-value"].encoding["chunks"] == (1, 1, 1, 3, 3)


def test_any_name_of_a_module_can_be_stored(store):
    rigs = vary(tl.box_corners([1, 1, 1]), anchors={"x- y- z+": [[0, 0, 0], [1, 0, 0]]})
    data = tl.sweep(rigs, POSES, "wrench-closure", out=store)
    assert set(data.data_vars) == {"wrench-closure"}
    assert data["anchor_x-_y-_z+_x"].values.tolist() == [0.0, 1.0]


def test_a_finished_sweep_is_only_opened(store, tmp_path):
    first = sweep(store, tmp_path / "a")
    before = read(tmp_path / "a")
    again = sweep(store, tmp_path / "a")
    assert read(tmp_path / "a") == before
    xr.testing.assert_identical(first.load(), again.load())


def test_after_kill_9_it_goes_on_and_computes_no_finished_chunk_again(store, tmp_path):
    tally = tmp_path / "tally"
    killed = 0
    for least in (5, 12, 25):  # killed three times
        process = start(store, tally)
        wait_for(lambda least=least: len(lines(store)) >= least)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        finished = {int(line) for line in lines(store)}
        assert killed < len(finished) < COUNT
        killed = len(finished)

    evaluated = len(read(tally))
    times = {path: path.stat().st_mtime_ns for path in (store / "least-singular-value").glob("[0-9]*")}
    in_ledger = {path: time_ns for path, time_ns in times.items() if number(path) in finished}
    assert len(in_ledger) == len(finished)

    assert start(store, tally).wait() == 0
    assert len(read(tally)) - evaluated == COUNT - len(finished)
    assert {path: path.stat().st_mtime_ns for path in in_ledger} == in_ledger
    data = xr.open_zarr(store, chunks=None)
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", Tallied(str(tmp_path / "b"))])
    for name in expected.data_vars:
        np.testing.assert_array_equal(data[name], expected[name])


def number(path):
    """Number of the chunk that a file holds."""
    return int(np.ravel_multi_index([int(i) for i in path.name.split(".")], (2, 2, 5, 2, 1)))


def stop(store, tally, count, monkeypatch):
    """Sweep until so many chunks are finished."""
    write = Store.write

    def until(self, task, values):
        if len(lines(store)) == count:
            raise KeyboardInterrupt
        write(self, task, values)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "write", until)
        with pytest.raises(KeyboardInterrupt):
            sweep(store, tally)


@pytest.fixture
def interrupted(store, tmp_path, monkeypatch):
    """A store with 12 finished chunks, and the number of those evaluated for it."""
    stop(store, tmp_path / "tally", 12, monkeypatch)
    return len(read(tmp_path / "tally"))


def test_a_line_cut_short_does_not_count(store, interrupted, tmp_path, monkeypatch):
    def cut_short():
        unfinished = max(set(range(COUNT)) - {int(line) for line in lines(store)})
        with (store / LEDGER).open("a") as ledger:
            ledger.write(str(unfinished))

    cut_short()
    stop(store, tmp_path / "tally", 20, monkeypatch)
    assert len({int(line) for line in lines(store)} & set(range(COUNT))) == 20
    cut_short()
    evaluated = len(read(tmp_path / "tally"))
    data = sweep(store, tmp_path / "tally")
    assert len(read(tmp_path / "tally")) - evaluated == COUNT - 20
    assert not data["Tallied"].isnull().any()


def test_data_that_the_ledger_does_not_know_are_written_again(store, interrupted, tmp_path):
    finished = {int(line) for line in lines(store)}
    last = np.unravel_index(max(set(range(COUNT)) - finished), (2, 2, 5, 2, 1))
    (store / "least-singular-value" / ".".join(map(str, last))).write_bytes(b"half a chunk")
    data = sweep(store, tmp_path / "tally").load()
    expected = tl.sweep(RIGS, POSES, "least-singular-value")
    np.testing.assert_array_equal(data["least-singular-value"], expected["least-singular-value"])


def test_a_store_half_made_is_made_anew(store, tmp_path):
    (tmp_path / ".sweep.zarr.new").mkdir()
    (tmp_path / ".sweep.zarr.new" / ".zgroup").write_text("{")
    assert sweep(store, tmp_path / "tally").sizes["x"] == 5
    assert not (tmp_path / ".sweep.zarr.new").exists()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rigs": vary(tl.ring_plus_top, side=[0.5, 1.1], count=[3, 4])}, "rigs"),
        ({"poses": Grid(POSES.x, POSES.y, POSES.z + 1e-9)}, "poses"),
        ({"measures": ["condition-number"]}, "measures"),
        ({"poses": Grid(POSES.x, POSES.y, POSES.z[:2])}, "poses and chunks"),
    ],
)
def test_the_store_of_another_sweep_is_refused(store, tmp_path, changed, words):
    sweep(store, tmp_path / "tally")
    before = {path: path.stat().st_mtime_ns for path in store.rglob("*")}
    with pytest.raises(SweepError, match=f"sweep.zarr holds a sweep that differs in {words};"):
        sweep(store, tmp_path / "tally", **changed)
    assert {path: path.stat().st_mtime_ns for path in store.rglob("*")} == before


def test_another_version_does_not_go_on(store, tmp_path, interrupted, monkeypatch):
    monkeypatch.setattr(tl, "__version__", "99.0")
    with pytest.raises(SweepError, match="differs in version"):
        sweep(store, tmp_path / "tally")


@pytest.mark.parametrize("what", ["empty", "file", "zarr"])
def test_what_is_no_sweep_is_refused(store, tmp_path, what):
    if what == "empty":
        store.mkdir()
    elif what == "file":
        store.write_text("mine")
    else:
        xr.Dataset({"a": ("b", [1.0])}).to_zarr(store, zarr_format=2)
    with pytest.raises(SweepError, match="is there and holds no sweep"):
        sweep(store, tmp_path / "tally")
    assert store.exists()


def test_the_folder_must_be_there(tmp_path):
    with pytest.raises(SweepError, match=f"no folder {tmp_path / 'none'}"):
        sweep(tmp_path / "none" / "a.zarr", tmp_path / "tally")
