"""Texts of a run's statistics."""

import numpy as np
import pytest

from tensionlab.allocation import Status
from tensionlab.hardware.runner.records import Statistics


def test_a_good_run_has_few_rows_and_another_one_for_each_thing_that_went_wrong():
    good = Statistics(ended="duration reached")
    for _ in range(3):
        good.add(Status.EXACT, 1e-4, 2e-4, fallback_used=False, slew_limited=False)
    assert good.title == "3 cycles, finished: duration reached"
    assert good.explained == good.answers == "3 EXACT"
    names = [name for name, _ in good.rows()]
    assert names == ["answers", "start jitter", "compute time of a cycle", "deadlines missed"]
    assert good.percentiles()["start_delay"] == pytest.approx((1e-4,) * 3)
    assert np.isnan(Statistics().percentiles()["start_delay"]).all()

    bad = Statistics(missed=2, derated={"top": 4.0}, lost={"floor-1": "FAULT: encoder"})
    bad.late_telemetry["top"] = 5
    for status in (Status.EXACT, Status.NEAREST):
        bad.add(status, 0.0, 0.0, fallback_used=status is Status.NEAREST, slew_limited=True)
    assert bad.explained.startswith("1 EXACT, 1 NEAREST, 1 by newton, as fallback of the solver; NEAREST: what is")
    assert dict(bad.rows()[3:]) == {
        "deadlines missed": "2",
        "cycles that were slew-rate limited": "2",
        "cycles with late telemetry of top": "5",
        "derated: top": "down to 4.00 N, so that it did not get too hot",
        "lost: floor-1": "FAULT: encoder",
    }
