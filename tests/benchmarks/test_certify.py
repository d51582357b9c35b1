import numpy as np
import pytest

from benchmarks import certify
from benchmarks.certify import Case, area_of_two_cables, cases, contradictions


@pytest.fixture(scope="module", params=range(3, 6), ids=lambda number: cases()[number].name)
def case(request):
    return cases()[request.param]


def test_known_areas_are_within_their_bounds_and_no_pose_contradicts(case):
    proved = case.prove()
    assert proved.volume.lower <= case.volume <= proved.volume.upper
    assert (proved.volume.upper - proved.volume.lower) / case.volume < 0.01
    assert contradictions(case, proved, 2_000) == (2_000, 0)


def test_a_contradiction_is_counted(case, monkeypatch):
    proved, holds = case.prove(), Case.holds
    monkeypatch.setattr(Case, "holds", lambda *given: ~holds(*given))
    assert contradictions(case, proved, 2_000) == (2_000, 2_000)


def test_strong_cables_hold_a_weight_almost_anywhere_under_them():
    x = np.linspace(0, 1, 100_001)
    share = np.maximum(x, 1 - x)
    for ratio in (1.01, 1.5, 10.0):
        above = (1 - share) * share / np.sqrt(ratio**2 - share**2)
        assert area_of_two_cables(ratio) == pytest.approx(1 - np.trapezoid(above, x), abs=1e-6)


def test_the_table_ends_with_the_hole(monkeypatch, capsys):
    every = cases()
    monkeypatch.setattr(certify, "cases", lambda: [every[4], every[-1]])
    monkeypatch.setattr("sys.argv", ["certify", "--poses", "1000"])
    with pytest.raises(SystemExit) as left:
        certify.main()
    assert not left.value.code
    triangle, hole, last = capsys.readouterr().out.splitlines()[1:]
    assert "0.50000" in triangle
    assert hole.split()[-1] == "0"
    assert last.startswith("the hole: ")
