"""A sweep says what it needs before it begins, and is refused where it cannot fit."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.workspace.sweep import needs as room
from tensionlab.workspace.sweep.plan import Plan, vary

RIG = tl.load_rig("bartels2026-validation")


class Instants:
    """A clock on which each look at it is a second later."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        self.now += 1.0
        return self.now


def planned(*steps, metrics=("capacity-margin", "tension-factor")):
    axes = [np.linspace(-0.5, 0.5, count) for count in steps]
    return Plan(
        vary(RIG), tl.workspace.Grid(*axes), {name: tl.workspace.METRICS[name]() for name in metrics}, {}, 64
    )


def test_its_size_is_that_of_all_values():
    plan = planned(10, 20, 30)
    assert room.size(plan) == 8 * 2 * 6000
    assert room.describe(plan, 3661.4) == "12,000 values (6,000 poses, 2 metrics), about 1:01:01, 96 kB at most"
    assert room.describe(planned(1, 1, 1, metrics=("capacity-margin",)), None) == (
        "1 value (1 pose, 1 metric), 8 B at most"
    )


def test_its_time_is_that_of_the_sample_for_all_poses_on_all_threads(monkeypatch):
    monkeypatch.setattr(room, "time", Instants())
    monkeypatch.setattr(room, "thread_count", lambda: 4)
    # A second for each sample: 1/64 of the poses, but no more than a chunk.
    assert room.estimate_seconds(planned(8, 8, 8)) == pytest.approx(64 / 4)
    assert room.estimate_seconds(planned(16, 32, 32)) == pytest.approx(16384 / 64 / 4)


def test_two_million_million_values_are_refused_before_anything_is_written(tmp_path, run, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=10**12))
    out = tmp_path / "huge.zarr"
    box = ["--box", "-1,1,0,2,-1,1", "--step", "0.00016", "--metric", "capacity-margin"]
    code, _, err = run("workspace", "bartels2026-validation", *box, "--out", out)
    assert code == 2
    assert "1,953,593,787,501 values" in err
    assert "15.6 TB at most" in err
    assert "has 1 TB left" in err
    assert "take a longer step" in err
    assert not out.exists()


def test_what_just_fits_is_not_refused(tmp_path, monkeypatch):
    plan = planned(10, 20, 30)
    free = room.size(plan)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    room.require_space(plan, tmp_path / "new.zarr")
    free -= 1
    with pytest.raises(SweepError, match=r"96 kB at most, and .* has 96 kB left"):
        room.require_space(plan, tmp_path / "new.zarr")
    room.require_space(plan, tmp_path)  # what is there already had room when it began


def test_a_long_sweep_says_what_it_needs_and_a_short_one_nothing(monkeypatch, capsys):
    monkeypatch.setattr("tensionlab.workspace.sweep.estimate_seconds", lambda plan: 125.0)
    tl.sweep(RIG, [[0.0, 0.3, 0.0]], "capacity-margin")
    assert capsys.readouterr().err == "sweep: 1 value (1 pose, 1 metric), about 0:02:05, 8 B at most\n"
    monkeypatch.setattr("tensionlab.workspace.sweep.estimate_seconds", lambda plan: 1.0)
    tl.sweep(RIG, [[0.0, 0.3, 0.0]], "capacity-margin")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("count", "text"), [(0, "0 B"), (999, "999 B"), (1000, "1 kB"), (15_628e9, "15.6 TB")])
def test_bytes_have_units(count, text):
    assert room.in_bytes(int(count)) == text
