"""Where a run's forces pointed, and why not where they were meant to."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import Limit
from tensionlab.scenarios.direction import REASONS, directions, why
from tensionlab.solvers.base import Status
from tests.support.runs import logged

COUNT = 200


@pytest.fixture
def run(tmp_path):
    """A run with nothing held back, all within reach, a loop that is 20 ms late, and no force at all."""
    rig = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
    logged(tmp_path / "run.mcap", rig, COUNT, rate=100.0)
    found = read_run(tmp_path / "run.mcap")
    return replace(
        found,
        status=np.full(COUNT, Status.EXACT, dtype=np.int8),
        limits=np.full((COUNT, rig.m), Limit.NONE),
        delays=np.full((COUNT, rig.m), 0.02),
        demanded=np.zeros((COUNT, 3)),
        tensions=np.zeros((COUNT, rig.m)),
    )


def pulling(run, told, meant):
    """The same run with these forces, one a cycle."""
    tensions = np.array([np.linalg.pinv(W) @ force for W, force in zip(run.structure, told, strict=True)])
    return replace(run, measured=tensions, desired=meant)


def along(*angles):
    """Forces of 2 N at these angles from x, in degrees, each for an equal part of the run."""
    turned = np.radians(np.repeat(angles, COUNT // len(angles)))
    return 2.0 * np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)


def test_a_force_within_45_degrees_is_convincing(run):
    found = directions(pulling(run, along(0, 44, 46, 180), along(0)))
    assert (found.judged, found.within) == (COUNT, COUNT // 2)
    assert found.reasons["unexplained"] == COUNT // 2


def test_a_weak_force_has_no_direction(run):
    found = directions(pulling(run, 0.24 * along(180), along(0)))
    assert (found.judged, found.within, sum(found.reasons.values())) == (0, 0, 0)


def test_where_nothing_is_meant_the_cables_are_only_taut(run):
    assert directions(pulling(run, along(180), 0.2 * along(0))).reasons["none intended"] == COUNT
    assert directions(pulling(run, along(0), np.full((COUNT, 3), np.nan))).reasons["none intended"] == COUNT


def test_a_force_that_turns_round_may_be_late_by_the_delay_and_the_settling(run):
    """Meant: x, then minus x. Told: x all the time. 20 ms and 100 ms later that has no excuse any more."""
    found = why(pulling(run, along(0), along(0, 180)))[COUNT // 2 :]
    late = int((found == REASONS.index("late")).sum())
    assert late in (12, 13)  # 0.12 s, in cycles of 10 ms
    assert (found[:late] == REASONS.index("late")).all()
    assert (found[late:] == REASONS.index("unexplained")).all()


def test_out_of_reach_and_held_back_are_reasons(run):
    wrong = pulling(run, along(180), along(0))
    assert directions(replace(wrong, status=np.full(COUNT, Status.NEAREST))).reasons["out of reach"] == COUNT
    slewing = wrong.limits.copy()
    slewing[: COUNT // 2, 1] = Limit.SLEW
    reasons = directions(replace(wrong, limits=slewing)).reasons
    assert reasons["held back"] == reasons["unexplained"] == COUNT // 2


def test_every_strong_force_is_within_or_has_a_reason(run):
    random = np.random.default_rng(1)
    found = directions(pulling(run, random.normal(size=(COUNT, 3)), random.normal(size=(COUNT, 3))))
    assert found.within + sum(found.reasons.values()) == found.judged
