"""A sweep that is killed goes on where it was, and never takes another's store for its own."""

import importlib.metadata
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep.configurations import vary
from tensionlab.workspace.sweep.store import LEDGER, LOCK, ZarrStore
from tests.support.tallied import Tallied, read

pytestmark = pytest.mark.realtime  # sweeps that are killed

RIGS = vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4])
POSES = Grid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), np.linspace(-1, 1, 3))
CHUNK = 9  # 2 x 2 x 5 x 2 chunks of 3 x 3 poses or less
COUNT = 40

PROGRAM = """
import sys
import numpy as np
import tensionlab as tl
from tests.support.tallied import Tallied
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep.configurations import vary

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


def command(store, tally):
    path = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
    return [sys.executable, "-c", PROGRAM, store, tally], {**os.environ, "PYTHONPATH": path}


def start(store, tally):
    program, environment = command(store, tally)
    return subprocess.Popen(program, env=environment)


def lines(store):
    """The numbers of the chunks in the ledger, in its order."""
    ledger = store / LEDGER
    rows = ledger.read_text().split("\n")[:-1] if ledger.exists() else []
    contents = [json.loads(row.partition(" ")[2]) for row in rows]
    return [each["chunk"] for each in contents if "chunk" in each]


def wait_for(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline, "waited for too long"
        time.sleep(0.001)


def test_a_finished_store_is_the_sweep(store, tmp_path):
    data = sweep(store, tmp_path / "a").load()
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", Tallied(str(tmp_path / "a"), 0.02)])
    assert data.drop_attrs(deep=False).identical(expected.drop_attrs(deep=False))
    assert lines(store) == list(range(COUNT))
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
        finished = set(lines(store))
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
    write = ZarrStore.write

    def until(self, task, values):
        if len(lines(store)) == count:
            raise KeyboardInterrupt
        write(self, task, values)

    with monkeypatch.context() as patch:
        patch.setattr(ZarrStore, "write", until)
        with pytest.raises(KeyboardInterrupt):
            sweep(store, tally)


@pytest.fixture
def interrupted(store, tmp_path, monkeypatch):
    """A store with 12 finished chunks, and the number of those evaluated for it."""
    stop(store, tmp_path / "tally", 12, monkeypatch)
    return len(read(tmp_path / "tally"))


def test_a_line_cut_short_does_not_count(store, interrupted, tmp_path, monkeypatch):
    def cut_short():
        unfinished = max(set(range(COUNT)) - set(lines(store)))
        with (store / LEDGER).open("a") as ledger:
            ledger.write(f'0123456789abcdef {{"chunk": {unfinished}, "files": {{}}')

    cut_short()
    stop(store, tmp_path / "tally", 20, monkeypatch)
    assert len(set(lines(store))) == 20
    cut_short()
    evaluated = len(read(tmp_path / "tally"))
    data = sweep(store, tmp_path / "tally")
    assert len(read(tmp_path / "tally")) - evaluated == COUNT - 20
    assert not data["Tallied"].isnull().any()


def test_data_that_the_ledger_does_not_know_are_written_again(store, interrupted, tmp_path):
    finished = set(lines(store))
    last = np.unravel_index(max(set(range(COUNT)) - finished), (2, 2, 5, 2, 1))
    (store / "least-singular-value" / ".".join(map(str, last))).write_bytes(b"half a chunk")
    data = sweep(store, tmp_path / "tally").load()
    expected = tl.sweep(RIGS, POSES, "least-singular-value")
    np.testing.assert_array_equal(data["least-singular-value"], expected["least-singular-value"])


def test_what_a_killed_process_had_half_made_is_cleared_away(store, tmp_path):
    left = tmp_path / ".sweep.zarr.0123456789ab.new"
    left.mkdir()
    (left / ".zgroup").write_text("{")
    (left / LOCK).touch()
    assert sweep(store, tmp_path / "tally").sizes["x"] == 5
    assert not left.exists()


def flip(path, index=-1):
    content = bytearray(path.read_bytes())
    content[index] ^= 1
    path.write_bytes(content)


ARRAY = Path("least-singular-value")
CHUNK_FILE = ARRAY / "0.0.0.0.0"


@pytest.mark.parametrize(
    "name", [CHUNK_FILE, ARRAY / ".zarray", Path(".zattrs"), Path(".zmetadata"), Path("anchor") / "0.0.0.0"]
)
def test_a_flipped_byte_in_a_finished_store_is_found(store, tmp_path, name):
    sweep(store, tmp_path / "tally")
    flip(store / name)
    with pytest.raises(SweepError, match=re.escape(str(store / name)) + " was changed since the sweep wrote it"):
        sweep(store, tmp_path / "tally")


def test_a_flipped_byte_in_an_unfinished_store_is_found(store, interrupted, tmp_path):
    name = sorted((store / ARRAY).glob("[0-9]*"))[0]
    if number(name) in set(lines(store)):
        flip(name)
        with pytest.raises(SweepError, match="was changed since the sweep wrote it"):
            sweep(store, tmp_path / "tally")


@pytest.mark.parametrize("name", [ARRAY, Path("anchor"), ARRAY / ".zarray"])
def test_an_array_that_is_missing_is_found(store, tmp_path, name):
    sweep(store, tmp_path / "tally")
    shutil.rmtree(store / name) if (store / name).is_dir() else (store / name).unlink()
    with pytest.raises(SweepError, match=f"{re.escape(str(store / name))}.* is missing"):
        sweep(store, tmp_path / "tally")


def test_values_that_are_missing_are_evaluated_again(store, tmp_path):
    expected = sweep(store, tmp_path / "tally").load()
    evaluated = len(read(tmp_path / "tally"))
    (store / CHUNK_FILE).unlink()
    xr.testing.assert_identical(sweep(store, tmp_path / "tally").load(), expected)
    assert len(read(tmp_path / "tally")) - evaluated == 1


def test_a_store_that_lost_its_ledger_does_not_count_as_finished(store, interrupted, tmp_path):
    (store / LEDGER).unlink()
    with pytest.raises(SweepError, match="has no ledger, which says what is complete"):
        sweep(store, tmp_path / "tally")


@pytest.mark.parametrize("row", [1, 5, -1])
def test_a_damaged_line_of_the_ledger_does_not_count(store, tmp_path, row):
    expected = sweep(store, tmp_path / "tally").load()
    rows = (store / LEDGER).read_bytes().split(b"\n")[:-1]
    rows[row] = rows[row][:-2] + b"?}"
    (store / LEDGER).write_bytes(b"\n".join([*rows, b""]))
    evaluated = len(read(tmp_path / "tally"))
    xr.testing.assert_identical(sweep(store, tmp_path / "tally").load(), expected)
    assert len(read(tmp_path / "tally")) - evaluated == (0 if row == -1 else 1)


def test_a_second_sweep_in_the_same_store_is_refused(store, tmp_path, monkeypatch):
    write = ZarrStore.write
    refused = []

    def meanwhile(self, task, values):
        if not refused:
            with pytest.raises(SweepError, match="another sweep writes to it") as caught:
                sweep(store, tmp_path / "tally")
            refused.append(caught.value)
        write(self, task, values)

    monkeypatch.setattr(ZarrStore, "write", meanwhile)
    sweep(store, tmp_path / "tally")
    assert refused


def test_two_sweeps_that_start_together_end_well(store, tmp_path):
    """Each is refused in words, or opens what the other finished; the store is whole."""
    processes = [
        subprocess.Popen(started, stderr=subprocess.PIPE, text=True, env=env)
        for started, env in [command(store, tmp_path / "tally")] * 2
    ]
    said = [process.communicate()[1] for process in processes]
    codes = [process.returncode for process in processes]
    assert 0 in codes
    assert all(code == 0 or "another sweep writes to it" in text for code, text in zip(codes, said, strict=True))
    assert not list(tmp_path.glob(".*"))
    assert len(read(tmp_path / "tally")) == COUNT


def test_a_finished_store_is_opened_while_another_has_it_open(store, tmp_path, monkeypatch):
    sweep(store, tmp_path / "tally")
    monkeypatch.setattr("tensionlab.files.writing.acquire_lock", None)  # not needed
    assert sweep(store, tmp_path / "tally").sizes["x"] == 5


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
    installed = importlib.metadata.version
    later = {"tensionlab": "99.0"}
    monkeypatch.setattr(importlib.metadata, "version", lambda name: later.get(name) or installed(name))
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
