"""Directions of a run's forces, and reasons where they are off."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.protocol.codes import Limit
from tensionlab.scenarios.checks import REASONS, check_directions, direction_reasons
from tensionlab.solvers.base import Status
from tests.helpers.runs import logged

COUNT = 200


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A run as it was logged."""
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    logged(path, tl.load_rig("datasets/rigs/bartels2026-validation.toml"), COUNT, rate=100.0)
    return read_run(path)


@pytest.fixture
def run(found):
    """A run with no module limited, all feasible, a loop that is 20 ms late, and no force at all."""
    rig = found.rig
    return replace(
        found,
        status=np.full(COUNT, Status.EXACT, dtype=np.int8),
        limiters=np.full((COUNT, rig.m), Limit.NONE),
        delays=np.full((COUNT, rig.m), 0.02),
        desired=np.zeros((COUNT, 3)),
        measured=np.zeros((COUNT, rig.m)),
    )


def pulling(run, measured, desired):
    """The same run with these forces, one a cycle."""
    tensions = np.array([np.linalg.pinv(W) @ force for W, force in zip(run.structure, measured, strict=True)])
    return replace(run, measured=tensions, desired=desired)


def along(*angles):
    """Forces of 2 N at these angles from x, in degrees, each for an equal part of the run."""
    turned = np.radians(np.repeat(angles, COUNT // len(angles)))
    return 2.0 * np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)


def test_a_force_within_45_degrees_is_convincing(run):
    found = check_directions(pulling(run, along(0, 44, 46, 180), along(0)))
    assert (found.cycles, found.within) == (COUNT, COUNT // 2)
    assert found.reasons["unexplained"] == COUNT // 2


def test_a_weak_force_has_no_direction(run):
    found = check_directions(pulling(run, 0.24 * along(180), along(0)))
    assert (found.cycles, found.within, sum(found.reasons.values())) == (0, 0, 0)


def test_where_nothing_is_desired_the_cables_are_only_taut(run):
    assert check_directions(pulling(run, along(180), 0.2 * along(0))).reasons["none desired"] == COUNT
    assert check_directions(pulling(run, along(0), np.full((COUNT, 3), np.nan))).reasons["none desired"] == COUNT


def test_a_force_that_turns_round_may_be_late_by_the_delay_and_the_settling(run):
    """Desired: x, then minus x. Measured: x all the time. 20 ms and 100 ms later that has no excuse any more."""
    found = direction_reasons(pulling(run, along(0), along(0, 180)))[COUNT // 2 :]
    delayed = int((found == REASONS.index("delayed")).sum())
    assert delayed in (12, 13)  # 0.12 s, in cycles of 10 ms
    assert (found[:delayed] == REASONS.index("delayed")).all()
    assert (found[delayed:] == REASONS.index("unexplained")).all()


def test_infeasible_and_limited_are_reasons(run):
    wrong = pulling(run, along(180), along(0))
    assert check_directions(replace(wrong, status=np.full(COUNT, Status.NEAREST))).reasons["infeasible"] == COUNT
    slewing = wrong.limiters.copy()
    slewing[: COUNT // 2, 1] = Limit.SLEW
    reasons = check_directions(replace(wrong, limiters=slewing)).reasons
    assert reasons["module limited"] == reasons["unexplained"] == COUNT // 2
