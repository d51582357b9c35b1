import os

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark import batches, daqp_direct
from tensionlab.benchmark.batches import against_daqp, beyond, random_problems


@pytest.mark.parametrize(("n", "m"), batches.SHAPES)
def test_wrenches_are_within_or_out_of_reach_as_promised(n, m):
    structure, wrench = random_problems(n, m, 300, seed=1)
    np.testing.assert_allclose(np.linalg.norm(structure[:, :3], axis=1), 1.0)
    limits = (batches.LOWER, batches.UPPER)
    assert (tl.allocate(structure, wrench, limits).status == tl.Status.EXACT).all()
    far = beyond(structure, wrench, seed=1)
    assert (tl.allocate(structure, far, limits).status == tl.Status.NEAREST).all()
    # At most twice as far as the furthest in the same direction.
    assert (tl.allocate(structure, far / 2.01, limits).status == tl.Status.EXACT).mean() > 0.7
    cosine = np.sum(far * wrench, axis=1) / np.linalg.norm(far, axis=1) / np.linalg.norm(wrench, axis=1)
    np.testing.assert_allclose(cosine, 1.0)


@pytest.mark.parametrize("reachable", [True, False])
def test_the_batch_and_daqp_agree_and_are_both_timed(monkeypatch, reachable):
    monkeypatch.setattr(batches, "PEER_CALLS", 50)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    row = against_daqp(3, 5, reachable, count=200, rounds=2)
    for seconds in (row.one_core_s, row.all_cores_s, row.daqp_c_s, row.daqp_loop_s):
        assert 1e-9 < seconds < 1e-2
    assert row.daqp_c_s < row.daqp_loop_s
    assert row.ratio == row.one_core_s / row.daqp_c_s
    assert row.cores == os.cpu_count()
    assert row.gap_max < 1e-9 if reachable else np.isnan(row.gap_max)
    assert os.environ["TENSIONLAB_NUM_THREADS"] == "3"


def test_without_daqp_its_columns_are_empty(monkeypatch):
    monkeypatch.setattr(daqp_direct, "installed", lambda: False)
    row = against_daqp(3, 4, count=200, rounds=1)
    assert row.one_core_s > 0
    assert np.isnan([row.daqp_c_s, row.daqp_loop_s, row.gap_max, row.ratio]).all()
