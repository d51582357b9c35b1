"""Impedances that together are nearest to a desired stiffness: optimal, inside the limits, passive."""

import math
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.impedance_field import conic_optimum, objective, random_problem
from tensionlab.haptics.effects import AxisImpedance, Motion, Plane, Wall
from tensionlab.haptics.rendering.assignment import RULE, CableState, ModuleLimits, assign, module_springs
from tensionlab.haptics.rendering.field import CableRanges, allocate_field, optimality_gap, predict, stable_share
from tensionlab.model.directions import fibonacci
from tensionlab.model.wall_stiffness import HAND_DAMPING, MARGIN, MIN_HAND_MASS_KG


def test_it_is_the_optimum_of_a_conic_solver_and_inside_the_ranges():
    """The benchmark has ten thousand of these."""
    pytest.importorskip("cvxpy")
    rng = np.random.default_rng(38)
    for _ in range(60):
        problem = random_problem(rng)
        found, ranges = allocate_field(*problem), problem.ranges
        reference, solved = conic_optimum(problem)
        assert objective(problem, found) <= reference + 1e-8 * max(1.0, reference)
        assert objective(problem, found) == pytest.approx(reference, abs=1e-8, rel=1e-8) or not solved
        assert found.gap < 1e-7
        np.testing.assert_allclose(problem.structure @ found.tensions, problem.force, atol=1e-6)
        assert (found.stiffness >= 0.0).all()
        assert (found.stiffness <= ranges.stiffness).all()
        assert (found.damping <= ranges.damping).all()
        assert (found.tensions - ranges.fall * found.stiffness >= ranges.lower - 1e-8).all()
        assert (found.tensions + ranges.rise * found.stiffness <= ranges.upper + 1e-8).all()


def test_the_certificate_bounds_the_distance_to_the_optimum_of_any_answer():
    rng = np.random.default_rng(4)
    for _ in range(200):
        problem = random_problem(rng)
        best = allocate_field(*problem)
        assert optimality_gap(*problem, best) == pytest.approx(best.gap, abs=1e-12)
        worse = replace(best, stiffness=best.stiffness * rng.uniform(0.5, 1.0), damping=0.7 * best.damping)
        # The bound is on half the objective.
        excess = (objective(problem, worse) - objective(problem, best)) / 2
        assert optimality_gap(*problem, worse) >= excess - 1e-9
        outside = replace(best, stiffness=best.stiffness + 1e-6 + problem.ranges.stiffness)
        assert math.isinf(optimality_gap(*problem, outside))


def test_a_wall_that_bisects_cables_is_rendered_by_them_and_a_force_that_is_infeasible_is_the_nearest():
    """On the cube, four cables at 54.7 degrees share a wall: k = K / (4 cos²) if nothing else counted."""
    rig = tl.load_rig("cube-8")
    unit, up, none = rig.structure_matrix(rig.home), np.array([0.0, 0.0, 1.0]), np.zeros(rig.m)
    wall, pulls = np.outer(up, up), up @ unit > 0.0
    ranges = CableRanges(rig.limits.lower, rig.limits.upper, 500.0 * pulls, 10.0 * pulls, none, none)
    found = allocate_field(unit, 2.0 * up, 200.0 * wall, 2.0 * wall, ranges)
    assert found.stiffness[pulls] == pytest.approx(found.stiffness[pulls][0])
    assert not found.stiffness[~pulls].any()
    matrix = (unit * found.stiffness) @ unit.T
    # Least squares by hand: error (1 - k/k0)² along, (k/k0)² s⁴ 2 across, with s = 1/2.
    assert matrix[2, 2] == pytest.approx(200.0 / (1.0 + 2.0 * 0.5**4), rel=1e-4)
    turning = found.tensions / rig.cables(rig.home).lengths
    geometric = turning.sum() * np.eye(3) - (unit * turning) @ unit.T
    pull = found.tensions.sum() / math.sqrt(0.75)
    assert np.trace(geometric) == pytest.approx(2.0 * pull)  # each cable, t/l in two directions
    hard = allocate_field(unit, 100.0 * up, 200.0 * wall, 2.0 * wall, ranges)
    nearest = tl.allocate(unit, 100.0 * up, rig.limits).wrench
    np.testing.assert_allclose(hard.force, nearest, rtol=2e-6, atol=1e-9)


def test_springs_leave_room_for_their_reach():
    """One cable up against one down: 2.5 N is left below 6 N, for 10 mm."""
    ranges = CableRanges(*(np.full(2, each) for each in (0.5, 6.0, 500.0, 0.0, 0.0, 0.01)))
    found = allocate_field(np.array([[1.0, -1.0]]), np.array([3.0]), np.array([[900.0]]), np.zeros((1, 1)), ranges)
    assert found.stiffness == pytest.approx([250.0, 500.0], abs=0.5)
    none = allocate_field(np.array([[1.0, -1.0]]), np.array([3.0]), np.array([[math.nan]]), np.eye(1), ranges)
    assert math.isinf(none.gap)
    assert not none.stiffness.any()


@pytest.mark.parametrize("host", [5.0, 20.0, 80.0])
def test_what_the_host_takes_back_and_adds_never_makes_the_damping_negative(host):
    """With ``tau = 1``: ``b = H`` of the hand, and the rest as in `predict`, in any basis."""
    rng = np.random.default_rng(7)
    for _ in range(300):
        structure = rng.normal(size=(3, 5))
        matrix = (structure * rng.uniform(0.0, 100.0, 5)) @ structure.T
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        found = predict(matrix, axis, 1.2 * axis @ matrix @ axis, host)
        across = np.eye(3) - np.outer(axis, axis)
        taken_back = found.share * across @ matrix @ axis
        damping = found.share * matrix @ across + np.outer(taken_back, axis) - found.added * np.outer(axis, axis)
        damping = host * np.eye(3) + (damping + damping.T) / 2
        assert np.linalg.eigvalsh(damping)[0] > -1e-9 * host
        assert 0.0 <= found.added <= host
        missing = 1.2 * matrix @ axis @ axis * axis - matrix @ axis + taken_back - found.added * axis
        assert found.error == pytest.approx(np.linalg.norm(missing) / (1.2 * axis @ matrix @ axis))


@pytest.mark.parametrize("late", [0.03, 0.07, 0.15])
def test_the_lightest_hand_does_not_shake_across_a_stable_share_and_shakes_far_above_it(late):
    """Its own damping holds it at the limit; the spring across, in any basis, is late by ``late`` s."""
    step, host = 1e-3, MARGIN * HAND_DAMPING / late
    basis = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    matrix = basis @ np.diag([200.0, 5000.0, 300.0]) @ basis.T
    spring = 5000.0 * stable_share(matrix, basis[:, 0], host)
    assert spring < 5000.0
    assert stable_share(0.1 * spring / 5000.0 * matrix, basis[:, 0], host) == 1.0
    swings = []
    for stiffness in (spring, 4.0 * spring):
        path, speed = [0.0] * (1 + round(late / step)), 0.1
        for _ in range(4000):
            force = -stiffness * (path[-1] - path[-1 - round(late / step)]) - HAND_DAMPING * speed
            speed += step * force / MIN_HAND_MASS_KG
            path.append(path[-1] + step * speed)
        tail = np.array(path[-1000:])
        swings.append(np.ptp(tail - np.linspace(tail[0], tail[-1], len(tail))))
    assert swings[0] < 1e-4
    assert swings[1] > 1e-3


def test_a_field_that_would_damp_a_hand_less_than_the_host_is_softened_slowly():
    """Force across costs ``tau c A/Y`` of the damping, a late host ``tau H``; no cable is near these normals."""
    rig, host, damping = tl.load_rig("bartels2026-validation"), 14.0, 2.0
    cables, lag = rig.cables(rig.home), MARGIN * HAND_DAMPING / host
    state = CableState(cables.lengths, cables.directions, np.ones(rig.m, dtype=bool))
    motion, shares = Motion(rig.home, np.zeros(3), step=0.02), []
    for normal in fibonacci(100):
        if (cables.directions @ normal).max() > math.cos(math.radians(45.0)):
            continue
        part = AxisImpedance(normal, 0.01, 200.0, damping)
        best = module_springs(part, motion, state, state.available, host_stiffness=host)
        unit = cables.directions[list(best.impedances)].T
        field = (unit * [each.stiffness for each in best.impedances.values()]) @ unit.T
        coupling = field @ normal - (normal @ field @ normal) * normal
        felt = predict(field, normal, 200.0, host / (1.0 - RULE.lead))
        more = min(damping * (1.0 + RULE.yielding * felt.across / felt.along), 0.8 * MIN_HAND_MASS_KG / lag)
        lost = lag * np.linalg.norm(coupling) * felt.across / RULE.yielding_stiffness
        assert more - lost >= damping - lag * host - 1e-9
        assert best.share == 1.0 or more - lost < damping - lag * host + 0.1, "and no softer than that"
        later = module_springs(part, motion, state, state.available, host_stiffness=host, previous_share=1.0)
        assert later.share == pytest.approx(1.0 - (1.0 - best.share) * (1.0 - math.exp(-0.02 / RULE.settling)))
        shares.append(best.share)
    assert 0.0 < np.mean(np.less(shares, 1.0)) < 0.5


@pytest.mark.parametrize("rig_name", ["bartels2026-validation", "tetra-4", "cube-8", "seven-modules"])
def test_springs_whose_rest_lengths_are_moved_late_give_no_more_energy_than_half_the_hands_damping_takes(rig_name):
    """Hands go round against a wall, in and out of it; the host is 40 ms late, and holds for 20 ms."""
    rig, rng = tl.load_rig(rig_name), np.random.default_rng(11)
    step, held, late, damping = 0.002, 10, 20, 2.0
    bound = 0.5 * damping / (step * (late + held / 2))
    time = np.arange(0.0, 2.0, step)
    for _ in range(4):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        turns, phases, sizes = rng.integers(1, 4, 3), rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(0.002, 0.01, 3)
        path = rig.home + sizes * np.sin(np.pi * turns * time[:, None] + phases)  # closed
        wall = Wall(Plane(tuple(rig.home + 0.003 * normal), tuple(normal)), 200.0, 0.0)
        cables, given, springs, correction = rig.cables(path), 0.0, {}, np.zeros(3)
        for now in range(len(time) - 1):
            if now % held == 0:
                seen = max(now - late, 0)
                state = CableState(cables.lengths[seen], cables.directions[seen], np.ones(rig.m, dtype=bool))
                plan = assign((wall,), Motion(path[seen], np.zeros(3)), state, ModuleLimits(), bound)
                springs = plan.impedances
                pulls = [s.tension(state.lengths[i], 0.0) * state.directions[i] for i, s in springs.items()]
                correction = plan.force + plan.expected - np.sum(pulls, axis=0)
            force = correction + sum(
                (s.tension(cables.lengths[now, i], 0.0) * cables.directions[now, i] for i, s in springs.items()),
                np.zeros(3),
            )
            given += force @ (path[now + 1] - path[now])
        speeds = np.diff(path, axis=0) / step
        assert given < 0.5 * damping * step * np.sum(speeds**2)
