"""An interrupted sweep is resumed, and never takes another's store for its own."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
import zarr
from distributed import LocalCluster

import tensionlab as tl
from tensionlab.errors import MissingDependency, SweepError
from tensionlab.workspace import Grid, vary
from tensionlab.workspace.sweep.store import WritingTask, ZarrStore
from tests.helpers.tallied import read, tallied

RIGS = vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4])
POSES = Grid(np.linspace(-1, 1, 5), np.linspace(0, 1, 4), np.linspace(-1, 1, 3))
CHUNK = 9  # 2 x 2 x 5 x 2 chunks of 3 x 3 poses or less
COUNT = 40
CHUNK_FILE = Path("least-singular-value") / "c" / "0" / "0" / "0" / "0" / "0"
PROGRAM = """
import sys
from tests.workspace.sweep.test_store import sweep
print(flush=True)
sys.stdin.readline()
sweep(sys.argv[1], sys.argv[2], seconds=0.02)
"""


@pytest.fixture
def store(tmp_path):
    return tmp_path / "sweep.zarr"


@pytest.fixture
def tally(tmp_path):
    return tmp_path / "tally"


def sweep(store, tally, seconds=0.0, **changed):
    arguments = {"rigs": RIGS, "poses": POSES, "metrics": ["least-singular-value", tallied(tally, seconds)]}
    return tl.sweep(**{**arguments, **changed}, out=store, chunk=CHUNK)


def finished(store):
    return zarr.open_group(store, mode="r")["tallied"].nchunks_initialized


def stop(store, tally, count, inside=False):
    """Sweep until this number of chunks is finished; the next may have been written in part."""
    write, written = ZarrStore.write, []

    def until(self, task, values):
        if len(written) == count:
            if inside:
                self._arrays[0][task.block] = values[0]
            raise KeyboardInterrupt
        written.append(task.number)
        write(self, task, values)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ZarrStore, "write", until)
        with pytest.raises(KeyboardInterrupt):
            sweep(store, tally)
    assert finished(store) == count


def start(store, tally):
    path = os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, store, tally],
        env={**os.environ, "PYTHONPATH": path},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_finished_store_is_the_sweep_and_is_only_opened(store, tally, tmp_path):
    data = sweep(store, tally).load()
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", tallied(tally)])
    assert data.drop_attrs().equals(expected.drop_attrs())
    assert {name: values.attrs for name, values in data.items()} == {n: v.attrs for n, v in expected.items()}
    assert list(data.data_vars) == list(expected.data_vars)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sweep.zarr", "tally"]
    assert data["least-singular-value"].encoding["chunks"] == (1, 1, 1, 3, 3)
    before = read(tally)
    xr.testing.assert_identical(sweep(store, tally).load(), data)
    assert read(tally) == before


@pytest.mark.parametrize("inside", [False, True], ids=["between chunks", "inside a chunk"])
def test_an_interrupted_sweep_is_resumed(store, tally, inside):
    stop(store, tally, 12, inside)
    evaluated, shares = len(read(tally)), []
    data = sweep(store, tally, progress=shares.append)
    assert len(read(tally)) - evaluated == COUNT - 12
    assert shares == pytest.approx(np.arange(13, COUNT + 1) / COUNT)
    expected = tl.sweep(RIGS, POSES, ["least-singular-value", tallied(tally)])
    for name in expected.data_vars:
        np.testing.assert_array_equal(data[name], expected[name])


def test_two_sweeps_that_start_together_end_well(store, tally, tmp_path):
    """Each is refused in words, or opens what the other finished; the store is whole."""
    with start(store, tally) as one, start(store, tally) as other:
        assert one.stdout.readline() == other.stdout.readline() == "\n"
        for process in (one, other):
            process.stdin.write("go\n")
            process.stdin.flush()
        said = [process.communicate()[1] for process in (one, other)]
    codes = [one.returncode, other.returncode]
    assert 0 in codes
    assert all(code == 0 or "another sweep writes to it" in text for code, text in zip(codes, said, strict=True))
    assert not list(tmp_path.glob(".*"))
    assert len(read(tally)) == COUNT


def test_a_second_sweep_in_the_same_store_is_refused(store, tally, monkeypatch):
    write, refused = ZarrStore.write, []

    def meanwhile(self, task, values):
        if not refused:
            with pytest.raises(SweepError, match="another sweep writes to it") as caught:
                sweep(store, tally)
            refused.append(caught.value)
        write(self, task, values)

    monkeypatch.setattr(ZarrStore, "write", meanwhile)
    sweep(store, tally)
    assert refused


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_a_flipped_byte_in_values_is_found_when_they_are_read(store, tally):
    data = sweep(store, tally)
    flip(store / CHUNK_FILE)
    with pytest.raises(ValueError, match="checksum"):
        data["least-singular-value"].load()
    with pytest.raises(SweepError, match="least-singular-value: its values are damaged"):
        tl.workspace.summary(sweep(store, tally))


@pytest.mark.parametrize("name", ["x/c/0", "zarr.json"])
def test_damage_elsewhere_is_found_when_the_store_is_opened(store, tally, name):
    sweep(store, tally)
    if name.endswith("json"):
        (store / name).write_text((store / name).read_text()[:-9])
    else:
        flip(store / name)
    with pytest.raises(SweepError, match=f"{re.escape(str(store))} is damaged"):
        sweep(store, tally)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"rigs": vary(tl.ring_plus_top, side=[0.5, 1.1], count=[3, 4])}, "rigs"),
        ({"poses": Grid(POSES.x, POSES.y, POSES.z + 1e-9)}, "poses"),
        ({"metrics": ["condition-number"]}, "metrics"),
        ({"poses": Grid(POSES.x, POSES.y, POSES.z[:2])}, "poses and chunks"),
        ({"required": np.ones(3)}, "required"),
    ],
)
def test_the_store_of_another_sweep_is_refused(store, tally, changed, words):
    sweep(store, tally)
    before = {path: path.stat().st_mtime_ns for path in store.rglob("*")}
    with pytest.raises(SweepError, match=f"sweep.zarr holds a sweep that differs in {words};"):
        sweep(store, tally, **changed)
    assert {path: path.stat().st_mtime_ns for path in store.rglob("*")} == before


def test_another_version_does_not_resume(store, tally, monkeypatch):
    stop(store, tally, 12)
    monkeypatch.setattr(tl, "__version__", "99.0")
    with pytest.raises(SweepError, match="differs in version"):
        sweep(store, tally)


@pytest.mark.parametrize("what", ["empty", "file", "zarr"])
def test_a_path_that_holds_no_sweep_is_refused(store, tally, what):
    if what == "empty":
        store.mkdir()
    elif what == "file":
        store.write_text("mine")
    else:
        xr.Dataset({"a": ("b", [1.0])}).to_zarr(store, zarr_format=2)
    with pytest.raises(SweepError, match="is there and holds no sweep"):
        sweep(store, tally)
    assert store.exists()


def test_a_chunk_without_a_file_is_evaluated_again_and_never_read_as_nan(store, tally):
    data = sweep(store, tally).load()
    (store / CHUNK_FILE).unlink()
    shares = []
    xr.testing.assert_equal(sweep(store, tally, progress=shares.append).load(), data)
    assert shares == [1.0]


def test_chunks_without_values_are_finished_too(store):
    """Zarr would leave them out."""
    on_an_anchor = [[1.0, 0.5, 1.0], [0.0, 0.0, 0.0]]
    shares = []
    for _ in range(2):
        data = tl.sweep(
            tl.box_corners([2, 1, 2]), on_an_anchor, "tension-factor", out=store, chunk=1, progress=shares.append
        )
        assert data["tension-factor"].isnull().values.tolist() == [[True, False]]
    assert shares == [0.5, 1.0]


def test_a_sweep_that_the_disk_has_no_space_for_is_refused_before_any_work(store, tally, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=1_000))
    with pytest.raises(SweepError, match="GB are free; give another place"):
        sweep(store, tally)
    assert read(tally) == []
    assert not store.exists()


@pytest.fixture
def bucket():
    """URL in a file system of fsspec, and its files."""
    import fsspec

    files = fsspec.filesystem("memory")
    yield "memory://bucket/sweep.zarr", files
    files.store.clear()


@pytest.mark.parametrize("on_cluster", [False, True], ids=["threads", "cluster"])
def test_a_sweep_at_a_url_is_resumed_and_read_back(bucket, tally, tmp_path, on_cluster):
    url, files = bucket
    where = {"protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": ":0"}
    with contextlib.ExitStack() as stack:
        if on_cluster:  # whose workers are threads of this process, and write
            cluster = LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **where)
            scheduler = {"scheduler": stack.enter_context(cluster).scheduler_address}
        else:
            scheduler = {}
        with pytest.raises(ZeroDivisionError):
            sweep(url, tally, **scheduler, progress=lambda share: share < 0.3 or 1 / 0)
        held = set(files.glob("/bucket/sweep.zarr/tallied/c/**"))
        evaluated, finished = len(read(tally)), sum(files.isfile(name) for name in held)
        assert 0 < finished < COUNT
        data = sweep(url, tally, **scheduler).load()
    assert len(read(tally)) - evaluated <= COUNT - finished + 2  # a chunk under way may have been written since
    assert data.drop_attrs().equals(
        tl.sweep(RIGS, POSES, ["least-singular-value", tallied(tmp_path / "x")]).drop_attrs()
    )
    before = read(tally)
    xr.testing.assert_identical(sweep(url, tally).load(), data)
    assert read(tally) == before


def test_damage_and_another_sweep_are_found_at_a_url(bucket, tally):
    url, files = bucket
    data = sweep(url, tally)
    with pytest.raises(SweepError, match=f"{url} holds a sweep that differs in poses;"):
        sweep(url, tally, poses=Grid(POSES.x, POSES.y, POSES.z + 1e-9))
    chunk = f"/bucket/sweep.zarr/{CHUNK_FILE.as_posix()}"
    content = bytearray(files.cat_file(chunk))
    content[len(content) // 2] ^= 1
    files.pipe_file(chunk, bytes(content))
    with pytest.raises(ValueError, match="checksum"):
        data["least-singular-value"].load()
    files.pipe_file("/bucket/other/notes.txt", b"mine")
    with pytest.raises(SweepError, match="is there and holds no sweep"):
        sweep("memory://bucket/other", tally)


def test_values_that_workers_write_elsewhere_are_missed(bucket, monkeypatch):
    monkeypatch.setattr(WritingTask, "evaluate", lambda task: task.task.evaluate() is None)
    with pytest.raises(SweepError, match="give one that all of them see"):
        tl.sweep(RIGS, POSES, "least-singular-value", out=bucket[0])


def test_a_url_that_cannot_be_used_is_refused_before_any_work(tally, monkeypatch):
    from fsspec.implementations.memory import MemoryFileSystem
    from fsspec.registry import known_implementations

    with pytest.raises(SweepError, match=r"nonsense://a/b.zarr cannot be used .Protocol not known: nonsense"):
        sweep("nonsense://a/b.zarr", tally)
    lost = {"class": "tensionlab.no_such.FileSystem", "err": "Install it to access it"}
    monkeypatch.setitem(known_implementations, "lost", lost)
    with pytest.raises(MissingDependency, match=r"lost://a/b.zarr needs another library: Install it to access it"):
        sweep("lost://a/b.zarr", tally)

    def refuse(*_, **__):
        raise RuntimeError("Could not connect to the endpoint")

    monkeypatch.setattr(MemoryFileSystem, "exists", refuse)
    with pytest.raises(SweepError, match=r"cannot be used .Could not connect to the endpoint.; check the address"):
        sweep("memory://bucket/sweep.zarr", tally)
    assert read(tally) == []


def test_the_folder_must_be_there(tmp_path, tally):
    with pytest.raises(SweepError, match=f"no folder {tmp_path / 'none'}"):
        sweep(tmp_path / "none" / "a.zarr", tally)
