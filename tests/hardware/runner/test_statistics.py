"""What is said of a run at its end."""

import numpy as np
import pytest

from tensionlab.allocation import Status
from tensionlab.hardware.runner.records import Statistics


def test_a_good_run_is_told_in_few_lines():
    run = Statistics(ended="duration reached")
    for _ in range(3):
        run.add(Status.EXACT, 1e-4, 2e-4, fallback_used=False, slew_limited=False)
    assert run.title == "3 cycles, finished: duration reached"
    assert run.explained == run.answers == "3 EXACT"
    assert [name for name, _ in run.rows()] == [
        "answers",
        "start jitter",
        "compute time of a cycle",
        "deadlines missed",
    ]
    assert run.percentiles()["start_delay"] == pytest.approx((1e-4,) * 3)
    assert np.isnan(Statistics().percentiles()["start_delay"]).all()
    assert "fallback" not in run._repr_html_()


def test_what_went_wrong_has_a_line_each():
    run = Statistics(missed=2, derated={"top": 4.0}, lost={"floor-1": "FAULT: encoder"})
    run.late_telemetry["top"] = 5
    for status in (Status.EXACT, Status.NEAREST):
        run.add(status, 0.0, 0.0, fallback_used=status is Status.NEAREST, slew_limited=True)
    assert run.title == "2 cycles"
    assert run.answers == "1 EXACT, 1 NEAREST, 1 by newton, as fallback of the solver"
    assert run.explained.startswith(run.answers + "; NEAREST: what is desired is infeasible")
    assert dict(run.rows()[3:]) == {
        "deadlines missed": "2",
        "cycles that were slew-rate limited": "2",
        "cycles with late telemetry of top": "5",
        "derated: top": "down to 4.00 N, so that it did not get too hot",
        "lost: floor-1": "FAULT: encoder",
    }
    for words in ("by newton, as fallback", "lost: floor-1", "2 cycles"):
        assert words in run._repr_html_()
