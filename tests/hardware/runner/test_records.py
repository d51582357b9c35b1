import numpy as np
import pytest

from tensionlab.allocation import Status
from tensionlab.hardware.runner.records import Statistics


def test_a_good_run_has_few_rows_and_another_one_for_each_thing_that_went_wrong():
    good, bad = Statistics(), Statistics(missed=2, derated={"top": 4.0}, lost={"floor-1": "FAULT: encoder"})
    bad.late_telemetry["top"] = 5
    for status in (Status.EXACT, Status.NEAREST):
        good.add(Status.EXACT, 1e-4, 2e-4, fallback_used=False, slew_limited=False)
        bad.add(status, 1e-4, 0.0, fallback_used=status is Status.NEAREST, slew_limited=True)
    names = [name for name, _ in good.rows()]
    assert [name for name, _ in bad.rows()][: len(names)] == names
    values = [value for _, value in bad.rows()[len(names) :]]
    assert values == ["2", "5", "down to 4.00 N, so that it did not get too hot", "FAULT: encoder"]
    assert (good.answers, bad.answers) == ("2 EXACT", "1 EXACT, 1 NEAREST, 1 by newton, as fallback of the solver")
    assert good.percentiles()["start_delay"] == pytest.approx((1e-4,) * 3)
    assert good.in_real_time
    assert not Statistics().in_real_time
    assert np.isnan(Statistics().percentiles()["start_delay"]).all()
