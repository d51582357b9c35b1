from tensionlab.benchmark import daqp_direct
from tensionlab.benchmark.calls import single_calls


def test_single_calls_of_all_four_callers():
    found = single_calls(3, 8, calls=45)
    assert [call.caller for call in found] == [
        "tl.Allocator", "tl.allocate", "daqp.solve", 'qpsolvers.solve_qp(solver="daqp")',
    ]  # fmt: skip
    assert all(1e-7 < call.median_s <= call.p999_s < 1.0 for call in found)
    assert all(call.quiet_p999_s <= call.p999_s for call in found)


def test_without_daqp_its_rows_are_missing(monkeypatch):
    monkeypatch.setattr(daqp_direct, "installed", lambda: False)
    assert [call.caller for call in single_calls(3, 4, calls=20)] == ["tl.Allocator", "tl.allocate"]
