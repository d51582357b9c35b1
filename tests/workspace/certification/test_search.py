import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import InputError
from tensionlab.workspace import certification

REGION = [(-0.4, 0.4), (0.0, 1.6), (-0.4, 0.4)]
BALL = ([0.0, 0.0, 0.0], 1.0)


def in_order(proved):
    order = np.lexsort((*proved.place.T, proved.level))
    return [each[order] for each in (proved.level, proved.place, proved.verdict, proved.shares)]


def test_a_cluster_proves_the_same(monkeypatch):
    from distributed import LocalCluster

    rig = tl.load_rig("bartels2026-validation")
    whole = tl.workspace.certify(rig, REGION, BALL, 0.02)
    monkeypatch.setattr(certification, "CHUNK_CELLS", 2_000)
    where = {"protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": ":0"}
    shares = []
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **where) as cluster:
        scheduler = cluster.scheduler_address
        found = tl.workspace.certify(
            rig, REGION, BALL, 0.02, scheduler=scheduler, progress=lambda share, _: shares.append(share)
        )
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    for one, other in zip(in_order(found), in_order(whole), strict=True):
        np.testing.assert_array_equal(one, other)


def test_bounds_close_until_the_gap_that_was_asked_for():
    rig, bounds = tl.load_rig("bartels2026-validation"), []
    whole = tl.workspace.certify(rig, REGION, BALL, 0.02, progress=lambda _, volume: bounds.append(volume))
    rough = tl.workspace.certify(rig, REGION, BALL, 0.02, gap=0.2)
    lower, upper = np.array(bounds).T
    assert (np.diff(lower) >= 0).all()
    assert (np.diff(upper) <= 0).all()
    assert bounds[-1] == pytest.approx(whole.volume)
    assert rough.volume.lower <= whole.volume.lower
    assert whole.volume.upper <= rough.volume.upper
    assert 0.05 < rough.share.upper - rough.share.lower <= 0.2
    assert rough.evaluations < whole.evaluations / 3
    assert rough.cell_volumes.sum() == pytest.approx(rough.region_volume)
    with pytest.raises(InputError, match=r"gap is 1.0; give a share"):
        tl.workspace.certify(rig, REGION, BALL, 0.02, gap=1.0)


def test_more_cells_than_memory_holds_are_refused(monkeypatch):
    rig = tl.load_rig("kntu-planar")
    examined = tl.workspace.certify(rig, [(-0.1, 0.1)] * 2, tl.Requirement(ball=2.0), 0.05).evaluations
    monkeypatch.setattr(certification, "MAX_CELLS", examined)
    assert tl.workspace.certify(rig, [(-0.1, 0.1)] * 2, tl.Requirement(ball=2.0), 0.05).evaluations == examined
    monkeypatch.setattr(certification, "MAX_CELLS", examined - 1)
    with pytest.raises(InputError, match=f"{examined} cells are undecided at 0.05 m; give a longer one"):
        tl.workspace.certify(rig, [(-0.1, 0.1)] * 2, tl.Requirement(ball=2.0), 0.05)
