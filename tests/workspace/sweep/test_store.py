"""A sweep that is killed goes on where it was, and never takes another's store for its own."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep.plan import vary
from tensionlab.workspace.sweep.store import LEDGER, LOCK, ZarrStore
from tests.helpers.tallied import Tallied, read

RIGS = vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4])
POSES = Grid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), np.linspace(-1, 1, 3))
CHUNK = 9  # 2 x 2 x 5 x 2 chunks of 3 x 3 poses or less
COUNT = 40

PROGRAM = """
import os, signal, sys
import numpy as np, xarray, zarr
import tensionlab as tl
from tensionlab.workspace.poses import Grid
from tensionlab.workspace.sweep import store
from tensionlab.workspace.sweep.plan import vary
from tests.helpers.tallied import Tallied

def sweep(seconds):
    tl.sweep(
        vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4]),
        Grid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), np.linspace(-1, 1, 3)),
        ["least-singular-value", Tallied(sys.argv[2], seconds)],
        out=sys.argv[1],
        chunk=9,
        progress=False,
    )
"""
TOGETHER = """
print(flush=True)
sys.stdin.readline()
sweep(0.02)
"""
KILLED = """
def before_the_line(self, number, files):
    os.kill(os.getpid(), signal.SIGKILL)

def within_the_line(self, number, files):
    with (self._store / store.LEDGER).open("ab") as ledger:
        ledger.write(store._line({"chunk": number, "files": files})[:-5])
    os.kill(os.getpid(), signal.SIGKILL)

def after_the_line(self, number, files):
    add(self, number, files)
    os.kill(os.getpid(), signal.SIGKILL)

add = store.Ledger.add
for finished, killed in ((5, before_the_line), (12, within_the_line), (25, after_the_line)):
    child = os.fork()
    if child == 0:
        store.Ledger.add = lambda self, *line: (killed if len(self._chunks) == finished else add)(self, *line)
        sweep(0.0)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    print(os.WTERMSIG(status), open(f"{sys.argv[1]}/{store.LEDGER}").read().count("\\n") - 1, flush=True)
"""


@pytest.fixture
def store(tmp_path):
    return tmp_path / "sweep.zarr"


def sweep(store, tally, **changed):
    arguments = {"rigs": RIGS, "poses": POSES, "metrics": ["least-singular-value", Tallied(str(tally))]}
    return tl.sweep(**{**arguments, **changed}, out=store, chunk=CHUNK, progress=False)


@pytest.fixture(scope="module")
def templates(tmp_path_factory):
    """A finished store, one with 12 finished chunks, and the tally of both: tests get copies."""
    folder = tmp_path_factory.mktemp("templates")
    stop(folder / "interrupted.zarr", folder / "tally", 12)
    shutil.copytree(folder / "interrupted.zarr", folder / "finished.zarr")
    sweep(folder / "finished.zarr", folder / "tally")
    return folder


@pytest.fixture
def finished(templates, store):
    """Make the store a finished one, and return its tally."""
    shutil.copytree(templates / "finished.zarr", store)
    return templates / "tally"


@pytest.fixture
def interrupted(templates, store):
    """Make the store one with 12 finished chunks, and return its tally."""
    shutil.copytree(templates / "interrupted.zarr", store)
    return templates / "tally"


def stop(store, tally, count):
    """Sweep until so many chunks are finished."""
    write = ZarrStore.write

    def until(self, task, values):
        if len(lines(store)) == count:
            raise KeyboardInterrupt
        write(self, task, values)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ZarrStore, "write", until)
        with pytest.raises(KeyboardInterrupt):
            sweep(store, tally)


def start(program, store, tally):
    path = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM + program, store, tally],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def lines(store):
    """The numbers of the chunks in the ledger, in its order."""
    ledger = store / LEDGER
    rows = ledger.read_text().split("\n")[:-1] if ledger.exists() else []
    contents = [json.loads(row.partition(" ")[2]) for row in rows]
    return [each["chunk"] for each in contents if "chunk" in each]


def test_a_finished_store_is_the_sweep(store, tmp_path):
    data = sweep(store, tmp_path / "a").load()
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", Tallied(str(tmp_path / "a"))])
    assert data.drop_attrs(deep=False).identical(expected.drop_attrs(deep=False))
    assert lines(store) == list(range(COUNT))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "sweep.zarr"]
    assert data["least-singular-value"].encoding["chunks"] == (1, 1, 1, 3, 3)


def test_any_name_of_a_module_can_be_stored(store):
    rigs = vary(tl.box_corners([1, 1, 1]), anchors={"x- y- z+": [[0, 0, 0], [1, 0, 0]]})
    data = tl.sweep(rigs, POSES, "wrench-closure", out=store)
    assert set(data.data_vars) == {"wrench-closure"}
    assert data["anchor_x-_y-_z+_x"].values.tolist() == [0.0, 1.0]


def test_a_finished_sweep_is_only_opened(store, finished):
    first = xr.open_zarr(store, chunks=None).load()
    before = read(finished)
    again = sweep(store, finished)
    assert read(finished) == before
    xr.testing.assert_identical(first, again.load())


@pytest.mark.realtime  # processes that are killed with -9
def test_after_kill_9_it_goes_on_and_computes_no_finished_chunk_again(store, tmp_path):
    """Killed three times: before, within and after a line of the ledger."""
    tally = tmp_path / "tally"
    with start(KILLED, store, tally) as process:
        assert process.communicate() == ("9 5\n9 12\n9 26\n", "")
    finished = set(lines(store))
    evaluated = len(read(tally))
    times = {path: path.stat().st_mtime_ns for path in (store / "least-singular-value").glob("[0-9]*")}
    in_ledger = {path: time_ns for path, time_ns in times.items() if number(path) in finished}
    assert len(in_ledger) == len(finished) == 26

    data = sweep(store, tally)
    assert len(read(tally)) - evaluated == COUNT - len(finished)
    assert {path: path.stat().st_mtime_ns for path in in_ledger} == in_ledger
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", Tallied(str(tmp_path / "b"))])
    for name in expected.data_vars:
        np.testing.assert_array_equal(data[name], expected[name])


def number(path):
    """Number of the chunk that a file holds."""
    return int(np.ravel_multi_index([int(i) for i in path.name.split(".")], (2, 2, 5, 2, 1)))


def test_a_line_cut_short_does_not_count(store, interrupted):
    def cut_short():
        unfinished = max(set(range(COUNT)) - set(lines(store)))
        with (store / LEDGER).open("a") as ledger:
            ledger.write(f'0123456789abcdef {{"chunk": {unfinished}, "files": {{}}')

    cut_short()
    stop(store, interrupted, 20)
    assert len(set(lines(store))) == 20
    cut_short()
    evaluated = len(read(interrupted))
    data = sweep(store, interrupted)
    assert len(read(interrupted)) - evaluated == COUNT - 20
    assert not data["Tallied"].isnull().any()


def test_data_that_the_ledger_does_not_know_are_written_again(store, interrupted):
    finished = set(lines(store))
    last = np.unravel_index(max(set(range(COUNT)) - finished), (2, 2, 5, 2, 1))
    (store / "least-singular-value" / ".".join(map(str, last))).write_bytes(b"half a chunk")
    data = sweep(store, interrupted).load()
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
def test_a_flipped_byte_in_a_finished_store_is_found(store, finished, name):
    flip(store / name)
    with pytest.raises(SweepError, match=re.escape(str(store / name)) + " was changed since the sweep wrote it"):
        sweep(store, finished)


def test_a_flipped_byte_in_an_unfinished_store_is_found(store, interrupted):
    assert len(lines(store)) == 12
    flip(next(path for path in (store / ARRAY).glob("[0-9]*") if number(path) == lines(store)[0]))
    with pytest.raises(SweepError, match="was changed since the sweep wrote it"):
        sweep(store, interrupted)


@pytest.mark.parametrize("name", [ARRAY, Path("anchor"), ARRAY / ".zarray"])
def test_an_array_that_is_missing_is_found(store, finished, name):
    shutil.rmtree(store / name) if (store / name).is_dir() else (store / name).unlink()
    with pytest.raises(SweepError, match=f"{re.escape(str(store / name))}.* is missing"):
        sweep(store, finished)


def test_values_that_are_missing_are_evaluated_again(store, finished):
    expected = xr.open_zarr(store, chunks=None).load()
    evaluated = len(read(finished))
    (store / CHUNK_FILE).unlink()
    xr.testing.assert_identical(sweep(store, finished).load(), expected)
    assert len(read(finished)) - evaluated == 1


def test_a_store_that_lost_its_ledger_does_not_count_as_finished(store, interrupted):
    (store / LEDGER).unlink()
    with pytest.raises(SweepError, match="has no ledger, which says what is complete"):
        sweep(store, interrupted)


@pytest.mark.parametrize("row", [1, 5, -1])
def test_a_damaged_line_of_the_ledger_does_not_count(store, finished, row):
    expected = xr.open_zarr(store, chunks=None).load()
    rows = (store / LEDGER).read_bytes().split(b"\n")[:-1]
    rows[row] = rows[row][:-2] + b"?}"
    (store / LEDGER).write_bytes(b"\n".join([*rows, b""]))
    evaluated = len(read(finished))
    xr.testing.assert_identical(sweep(store, finished).load(), expected)
    assert len(read(finished)) - evaluated == (0 if row == -1 else 1)


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


@pytest.mark.realtime  # two processes that race
def test_two_sweeps_that_start_together_end_well(store, tmp_path):
    """Each is refused in words, or opens what the other finished; the store is whole."""
    with start(TOGETHER, store, tmp_path / "tally") as one, start(TOGETHER, store, tmp_path / "tally") as other:
        assert one.stdout.readline() == other.stdout.readline() == "\n"
        for process in (one, other):
            process.stdin.write("go\n")
            process.stdin.flush()
        said = [process.communicate()[1] for process in (one, other)]
    codes = [one.returncode, other.returncode]
    assert 0 in codes
    assert all(code == 0 or "another sweep writes to it" in text for code, text in zip(codes, said, strict=True))
    assert not list(tmp_path.glob(".*"))
    assert len(read(tmp_path / "tally")) == COUNT


def test_a_finished_store_is_opened_while_another_has_it_open(store, finished, monkeypatch):
    monkeypatch.setattr("tensionlab.support.files.writing.acquire_lock", None)  # not needed
    assert sweep(store, finished).sizes["x"] == 5


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rigs": vary(tl.ring_plus_top, side=[0.5, 1.1], count=[3, 4])}, "rigs"),
        ({"poses": Grid(POSES.x, POSES.y, POSES.z + 1e-9)}, "poses"),
        ({"metrics": ["condition-number"]}, "metrics"),
        ({"poses": Grid(POSES.x, POSES.y, POSES.z[:2])}, "poses and chunks"),
    ],
)
def test_the_store_of_another_sweep_is_refused(store, finished, changed, words):
    before = {path: path.stat().st_mtime_ns for path in store.rglob("*")}
    with pytest.raises(SweepError, match=f"sweep.zarr holds a sweep that differs in {words};"):
        sweep(store, finished, **changed)
    assert {path: path.stat().st_mtime_ns for path in store.rglob("*")} == before


def test_another_version_does_not_go_on(store, interrupted, monkeypatch):
    monkeypatch.setattr(tl, "__version__", "99.0")
    with pytest.raises(SweepError, match="differs in version"):
        sweep(store, interrupted)


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
