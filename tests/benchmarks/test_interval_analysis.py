import numpy as np
import pytest

from benchmarks.certify import cases, planar_point
from benchmarks.interval_analysis import directions, judge, main, prove_by_intervals
from tensionlab.model.files import load_rig
from tensionlab.workspace.certified import subdivide

CASES = {case.name: case for case in cases()}


def test_every_pose_of_a_cell_has_a_structure_matrix_in_the_intervals():
    rng = np.random.default_rng(0)
    for rig in (load_rig("bartels2026-validation"), planar_point([(0, 0), (1, 0), (0, 1)])):
        centres = rng.uniform(-0.4, 0.4, (50, rig.dimension))
        half = rng.uniform(0.01, 0.3, rig.dimension)
        low, high = directions(rig, centres, half)
        # At corners and in between: the least and the greatest are met somewhere on the border.
        for share in [*rng.uniform(-1, 1, (100, rig.dimension)), *np.sign(rng.normal(size=(100, rig.dimension)))]:
            matrix = rig.structure_matrix(centres + share * half)
            assert (matrix >= low - 1e-12).all()
            assert (matrix <= high + 1e-12).all()


def test_a_known_area_is_within_the_bounds():
    case = CASES["two cables, a weight"]
    volume, looked = prove_by_intervals(case, 0.02)
    assert volume.lower < case.volume < volume.upper
    assert looked > 100


def test_single_poses_in_judged_cells_agree():
    case, rng = CASES["published rig, 1 N"], np.random.default_rng(1)
    cells = subdivide(case.region, 0.1, 3)
    places = cells.first()
    centres, half = cells.centres(0, places), cells.edges(0) / 8
    verdict = judge(case, centres, half)
    assert {-1.0, 0.0, 1.0} == set(verdict)
    for share in rng.uniform(-1, 1, (20, 3)):
        holds = case.holds(centres + share * half)
        assert holds[verdict == 1].all()
        assert not holds[verdict == -1].any()


def test_the_table_has_both(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["interval_analysis", "--resolution", "0.1"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 3 * 3
    assert lines[1] == "published rig, 1 N"
