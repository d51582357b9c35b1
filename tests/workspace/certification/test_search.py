import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import DataError, InputError, WriteError
from tensionlab.workspace.certification import certify as search
from tensionlab.workspace.certification.problem import CellProblem
from tensionlab.workspace.certification.result import subdivide

REGION = [(-0.4, 0.4), (0.0, 1.6), (-0.4, 0.4)]
BALL = ([0.0, 0.0, 0.0], 1.0)


@pytest.fixture(scope="module")
def rig():
    return tl.load_rig("bartels2026-validation")


@pytest.fixture(scope="module")
def whole(rig):
    return tl.workspace.certify(rig, REGION, BALL, 0.02)


def in_order(proved):
    order = np.lexsort((*proved.place.T, proved.level))
    return [each[order] for each in (proved.level, proved.place, proved.verdict, proved.shares)]


class KilledError(Exception):
    pass


def test_a_killed_proof_goes_on_where_it_was(tmp_path, monkeypatch, rig, whole):
    monkeypatch.setattr(search, "CHUNK_CELLS", 500)
    monkeypatch.setattr(search, "SAVE_INTERVAL_S", 0.0)
    file = tmp_path / "proof.npz"
    prove, calls = CellProblem.prove, []

    def killed_now_and_then(self, centres, half_edges, shares):
        calls.append(len(centres))
        if len(calls) in (5, 9, 14):
            raise KilledError
        return prove(self, centres, half_edges, shares)

    monkeypatch.setattr(CellProblem, "prove", killed_now_and_then)
    for _ in range(3):
        with pytest.raises(KilledError):
            tl.workspace.certify(rig, REGION, BALL, 0.02, out=file)
    done = tl.workspace.certify(rig, REGION, BALL, 0.02, out=file)
    for found, expected in zip(in_order(done), in_order(whole), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert done.evaluations == whole.evaluations == sum(calls) - sum(calls[i - 1] for i in (5, 9, 14))
    count = len(calls)
    assert tl.workspace.certify(rig, REGION, BALL, 0.02, out=file).volume == done.volume  # only read
    assert len(calls) == count


def test_a_cluster_proves_the_same(monkeypatch, rig, whole):
    from distributed import LocalCluster

    monkeypatch.setattr(search, "CHUNK_CELLS", 2_000)
    where = {"protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": ":0"}
    shares = []
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **where) as cluster:
        scheduler = cluster.scheduler_address
        found = tl.workspace.certify(rig, REGION, BALL, 0.02, scheduler=scheduler, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    for one, other in zip(in_order(found), in_order(whole), strict=True):
        np.testing.assert_array_equal(one, other)


def test_more_cells_than_memory_holds_are_refused(monkeypatch):
    cells = subdivide([(0.0, 1.0)] * 2, 0.25, 2)
    count = len(cells.first())
    monkeypatch.setattr(search, "MAX_CELLS", count)
    assert sum(len(task.places) for task in search.CellSearch(None, cells).tasks()) == count
    monkeypatch.setattr(search, "MAX_CELLS", count - 1)
    with pytest.raises(InputError, match=f"{count} cells are undecided at 0.25 m; give a longer one"):
        next(search.CellSearch(None, cells).tasks())


def test_the_file_of_another_proof_is_refused(tmp_path, rig):
    file = tmp_path / "proof.npz"
    tl.workspace.certify(rig, REGION, BALL, 0.1, out=file)
    for other in ({"resolution": 0.05}, {"required": ([0.0, 0.0, 0.0], 1.1)}, {"clearance": 0.0}):
        arguments = {"required": BALL, "resolution": 0.1} | other
        with pytest.raises(DataError, match="another region"):
            tl.workspace.certify(rig, REGION, **arguments, out=file)
    file.write_bytes(b"PK nothing")
    with pytest.raises(DataError, match=r"proof\.npz"):
        tl.workspace.certify(rig, REGION, BALL, 0.1, out=file)


def test_places_that_cannot_be_written_are_refused_first(tmp_path, rig):
    with pytest.raises(WriteError, match=r"must end in \.npz"):
        tl.workspace.certify(rig, REGION, BALL, 0.1, out=tmp_path / "proof.zarr")
    with pytest.raises(WriteError, match="make it first"):
        tl.workspace.certify(rig, REGION, BALL, 0.1, out=tmp_path / "nowhere" / "proof.npz")
