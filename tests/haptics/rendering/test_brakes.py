from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, nnls

import tensionlab as tl
from tensionlab.errors import ShapeError
from tensionlab.haptics.rendering.brakes import LOCK_RULE, LockRule, brake_map, brake_strengths, choose_locks
from tensionlab.model.directions import fibonacci

FOUR = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
CUBE = tl.load_rig("datasets/rigs/cube-8.toml")
WALLS = fibonacci(2000)
FREE = LockRule(price=0.0)


def limits(m, lower=0.5, upper=6.0):
    return tl.TensionLimits(np.full(m, lower), np.full(m, upper))


def unit(rng, *shape):
    vectors = rng.normal(size=shape)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def brake_reaction(U, locked, load):
    """Tensions of locked one-way brakes against a load on a point at rest, and the net force that moves it.

    The load is projected onto the cone of the locked cables (Moreau 1962): a brake pulls only where its cable does
    not reel in.
    """
    tensions = np.zeros(len(locked))
    if locked.any():
        tensions[locked] = nnls(U[:, locked], -load)[0]
    return tensions, load + U @ tensions


def blocks_withdrawal(U, locked, n):
    """Whether a locked cable would have to pay out for the hand to leave a wall along its normal."""
    return (locked & (np.einsum("...im,...i->...m", U, n) < -1e-9)).any(axis=-1)


def traps(U, locked, n):
    """Whether the brakes hold every pull away from a wall, so that the hand cannot leave it at all (Farkas)."""
    return np.linalg.norm(brake_reaction(U, locked, n)[1]) <= 1e-9


def chosen_for(rig, force, **kwargs):
    strengths = np.full(rig.m, 186.0)
    return choose_locks(rig.structure_matrix(rig.home), WALLS, force, rig.limits, strengths, **kwargs)


def test_ten_thousand_random_walls_let_the_hand_go():
    rng = np.random.default_rng(8)
    locks = 0
    for m in (3, 4, 5, 8):
        U, n = np.swapaxes(unit(rng, 2500, m, 3), 1, 2), unit(rng, 2500, 3)
        found = choose_locks(U, n, rng.uniform(1.0, 150.0, 2500), limits(m), np.full(m, 186.0))
        assert not blocks_withdrawal(U, found.locked, n).any()
        assert not any(map(traps, U, found.locked, n))
        assert np.all(found.locked.sum(axis=1) <= 3)
        locks += found.locked.any(axis=1).sum()
    assert locks > 7000


def test_plain_least_squares_would_trap_the_hand():
    U = FOUR.structure_matrix(FOUR.home)
    locked = np.array([nnls(U, n)[0] > 1e-9 for n in WALLS])
    assert blocks_withdrawal(U, locked, WALLS).mean() > 0.75


@pytest.mark.parametrize(("rig", "force", "most"), [(FOUR, 10.0, 0.5), (FOUR, 50.0, 10.0), (CUBE, 50.0, 0.1)])
def test_the_mean_unresisted_force(rig, force, most):
    # The motors alone leave 4.9, 44.6 and 41.2 N.
    U = rig.structure_matrix(rig.home)
    assert chosen_for(rig, force).unresisted.mean() <= most
    assert choose_locks(U, WALLS, force, rig.limits, np.zeros(rig.m)).unresisted.mean() > 4 * most


def test_what_is_reported_is_what_a_push_meets():
    for rig, force in ((FOUR, 10.0), (FOUR, 50.0), (CUBE, 50.0)):
        U, found = rig.structure_matrix(rig.home), chosen_for(rig, force)
        load = found.motors @ U.T - force * WALLS
        reactions = [brake_reaction(U, *wall) for wall in zip(found.locked, load, strict=True)]
        tensions, net = (np.array(column) for column in zip(*reactions, strict=True))
        np.testing.assert_allclose(np.linalg.norm(net, axis=1), found.unresisted, atol=1e-8)
        np.testing.assert_allclose(load + found.brakes @ U.T, net, atol=1e-8)
        assert np.all(found.brakes >= 0.0)
        assert np.all(found.brakes[~found.locked] == 0.0)
        assert np.all((found.motors >= rig.limits.lower) & (found.motors <= rig.limits.upper))
        # Complementarity: a brake reacts only where its cable neither slackens nor pays out.
        assert np.abs(tensions * (net @ U)).max() <= 1e-9
        assert tensions.max() > 4.0
        assert np.all(np.where(found.locked, net @ U, 0.0) >= -1e-9)


def statement(U, n, F, box, strengths, pushing, held, stiffness_ratio, rule):
    """The rule of `choose_locks`, spelled out for one wall: the set, and what it leaves unresisted."""
    available = [
        i for i in range(len(strengths)) if U[:, i] @ n > (0.0 if held[i] else rule.margin) and strengths[i] > 0
    ]
    may = [i for i in available if F > 0 and (pushing or held[i])]
    best, cost, left = [], np.inf, np.inf
    same = 1e-6 * max(1.0, F)
    for each in (list(one) for size in range(rule.max_locked + 1) for one in combinations(may, size)):
        if np.abs(U[:, each].T @ U[:, each]).sum(axis=0).max(initial=0.0) > stiffness_ratio:
            continue
        upper = box.upper.copy()
        upper[each] = np.maximum(upper[each], strengths[each])
        tensions = tl.allocate(U, F * n, (box.lower, upper), reference="lower", policy="force").tensions
        missing = np.linalg.norm(U @ tensions - F * n)
        if not each and missing <= same:
            return [], missing
        kept = bool(each) and each == np.flatnonzero(held).tolist()
        own = missing + F * (rule.price * len(each) - rule.hysteresis * kept)
        if own < cost - same:
            best, cost, left = each, own, missing
    return best, left


def test_it_is_the_rule():
    rng = np.random.default_rng(11)
    locks = []
    for _ in range(400):
        m = int(rng.integers(3, 8))
        U, n, F = unit(rng, m, 3).T, unit(rng, 3), rng.choice([0.0, 3.0, 20.0, 80.0], p=[0.1, 0.1, 0.3, 0.5])
        box, strengths = limits(m), rng.choice([0.0, 4.0, 60.0, 186.0], m, p=[0.1, 0.1, 0.4, 0.4])
        pushing, held = rng.random() < 0.9, rng.random(m) < 0.3
        stiffness_ratio = rng.choice([0.9, 1.8, np.inf], p=[0.1, 0.2, 0.7])
        rule = LockRule(
            max_locked=rng.choice([0, 1, 2, 3], p=[0.1, 0.1, 0.2, 0.6]), hysteresis=rng.choice([0.0, 0.05, 0.3])
        )
        found = choose_locks(U, n, F, box, strengths, pushing, held, stiffness_ratio, rule)
        chosen, left = statement(U, n, F, box, strengths, pushing, held, stiffness_ratio, rule)
        assert np.flatnonzero(found.locked).tolist() == chosen
        assert found.unresisted == pytest.approx(left, abs=1e-9)
        locks.append(len(chosen))
    assert min(np.bincount(locks, minlength=4)) >= 5


def test_no_set_of_brakes_does_better():
    """The same by a bounded least squares of SciPy's."""
    rng = np.random.default_rng(3)
    for m in (3, 5, 6):
        U, n, F = unit(rng, m, 3).T, unit(rng, 3), rng.uniform(5.0, 80.0)
        box, strengths = limits(m), rng.uniform(20.0, 186.0, m)
        cables = [i for i in range(m) if U[:, i] @ n > LOCK_RULE.margin]
        costs = []
        for each in (list(one) for size in range(4) for one in combinations(cables, size)):
            upper = box.upper.copy()
            upper[each] = strengths[each]
            tensions = lsq_linear(U, F * n, (box.lower, upper), tol=1e-14).x
            costs.append(np.linalg.norm(U @ tensions - F * n) + LOCK_RULE.price * F * len(each))
        found = choose_locks(U, n, F, box, strengths)
        cost = found.unresisted + LOCK_RULE.price * F * found.locked.sum()
        assert cost == pytest.approx(min(costs), abs=1e-6)


def test_motors_alone_where_they_do():
    found = chosen_for(FOUR, 1.0)
    strong = found.unresisted < 1e-9
    assert strong.mean() > 0.5
    np.testing.assert_array_equal(chosen_for(FOUR, 0.0).locked, False)
    alone = tl.allocate(FOUR.structure_matrix(FOUR.home), WALLS, FOUR.limits, policy="force", reference="lower")
    exact = alone.status == tl.Status.EXACT
    assert not found.locked[exact].any()
    np.testing.assert_allclose(found.motors[exact], alone.tensions[exact], atol=1e-9)


def test_one_cable_straight_behind_the_wall():
    U = np.array([[0.0, 0.0, 1.0], [1.0, -1.0, 0.0]])
    found = choose_locks(U, [0.0, 1.0], 40.0, limits(3, lower=0.0), np.full(3, 186.0))
    np.testing.assert_array_equal(found.locked, [True, False, False])
    np.testing.assert_allclose(found.motors, [6.0, 0.0, 0.0])
    np.testing.assert_allclose(found.brakes, [34.0, 0.0, 0.0])
    assert found.unresisted == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(found.available, [True, False, False])
    # A brake that may be loaded with 25 N only leaves 15.
    weak = choose_locks(U, [0.0, 1.0], 40.0, limits(3, lower=0.0), [25.0, 186.0, 186.0])
    assert weak.unresisted == pytest.approx(15.0)
    assert weak.motors[0] + weak.brakes[0] == pytest.approx(25.0)
    # No brake there, nothing to lock.
    none = choose_locks(U, [0.0, 1.0], 40.0, limits(3, lower=0.0), [0.0, 186.0, 186.0])
    assert not none.available.any()
    assert none.unresisted == pytest.approx(34.0)


def test_nothing_new_is_locked_where_the_user_does_not_push():
    found = chosen_for(FOUR, 50.0, pushing=False)
    assert not found.locked.any()
    assert not found.brakes.any()
    motors = choose_locks(FOUR.structure_matrix(FOUR.home), WALLS, 50.0, FOUR.limits, np.zeros(4))
    np.testing.assert_array_equal(found.motors, motors.motors)
    np.testing.assert_array_equal(found.unresisted, motors.unresisted)
    # What is locked may stay.
    held = chosen_for(FOUR, 50.0).locked
    still = chosen_for(FOUR, 50.0, pushing=False, held=held)
    assert np.all(still.locked <= held)
    assert still.locked.any(axis=1).mean() > 0.9


@given(st.integers(0, 2**32 - 1), st.integers(3, 8), st.sampled_from([0.0, 10.0, 50.0]))
def test_brakes_hold_pushes_alone(seed, m, force):
    """Brakes only oppose the user: they never pull without a push."""
    rng = np.random.default_rng(seed)
    U, n = unit(rng, m, 3).T, unit(rng, 3)
    found = choose_locks(U, n, force, limits(m), np.full(m, 186.0))
    user = rng.normal(size=3) * 30.0
    load = user + U @ found.motors
    tensions, _ = brake_reaction(U, found.locked, load)
    assert (U @ tensions) @ load <= 1e-9
    away = U[:, found.locked].T @ load >= 0.0
    if away.all():
        assert not tensions.any()
    # Withdrawing straight meets no brake at all.
    assert not brake_reaction(U, found.locked, 30.0 * n)[0].any()


def test_a_cable_along_the_wall_is_never_locked():
    U = np.stack([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], axis=1)
    for tilt in (-0.1, 0.0, 0.019):
        tilted = U + tilt * np.array([[0.0], [1.0], [0.0]])
        found = choose_locks(
            tilted / np.linalg.norm(tilted, axis=0), [0.0, 1.0, 0.0], 50.0, limits(3), [186.0] * 3
        )
        assert not found.locked.any()
    # Locked already, it may stay until it would keep the hand.
    for tilt, stays in ((0.015, True), (-1e-6, False)):
        tilted = U + tilt * np.array([[0.0], [1.0], [0.0]])
        tilted /= np.linalg.norm(tilted, axis=0)
        found = choose_locks(tilted, [0.0, 1.0, 0.0], 50.0, limits(3), [9e9] * 3, held=[True, True, False])
        assert found.locked.any() == stays


def test_hysteresis_keeps_the_set_that_is_locked():
    # Two cables at equal angles to the normal, turned a little: which is better changes sign at 0.
    angles = np.radians([70.0, 110.0])
    U = np.stack([[np.cos(a), np.sin(a)] for a in angles], axis=1)
    rule = replace(LOCK_RULE, max_locked=1)

    def best(turn, held=None):
        n = [np.sin(turn), np.cos(turn)]
        found = choose_locks(U, n, 50.0, limits(2), [186.0] * 2, held=held, rule=rule)
        return np.flatnonzero(found.locked).tolist()

    assert best(0.01) == [0]
    assert best(-0.01) == [1]
    assert best(-0.01, held=[True, False]) == [0]
    assert best(0.01, held=[False, True]) == [1]
    assert best(-0.1, held=[True, False]) == [1]
    # But where the motors do, nothing stays locked.
    weak = choose_locks(U, [0.0, 1.0], 1.0, limits(2, lower=0.0), [186.0] * 2, held=[True, False], rule=rule)
    assert not weak.locked.any()


def test_the_stiffness_ratio_limits_how_stiff_a_set_may_be():
    n = np.array([0.0, 1.0, 0.0])
    side = np.array([[np.cos(a), 0.0, np.sin(a)] for a in np.radians([0.0, 120.0, 240.0])])
    U = (n + 0.3 * side).T
    U = U / np.linalg.norm(U, axis=0)
    sizes = []
    for stiffness_ratio in (0.99, 1.0, 1.9, 3.0):
        found = choose_locks(U, n, 100.0, limits(3), [186.0] * 3, stiffness_ratio=stiffness_ratio, rule=FREE)
        own = U[:, found.locked]
        assert np.linalg.eigvalsh(own @ own.T).max(initial=0.0) <= stiffness_ratio + 1e-12
        sizes.append(int(found.locked.sum()))
    assert sizes == [0, 1, 2, 3]


def test_any_leading_axes():
    rng = np.random.default_rng(5)
    U, n, F = np.swapaxes(unit(rng, 4, 1, 5, 3), -1, -2), unit(rng, 3, 3), rng.uniform(1, 60, (4, 3))
    held = rng.random((3, 5)) < 0.4
    found = choose_locks(U, n, F, limits(5), np.full(5, 186.0), held=held)
    assert found.locked.shape == (4, 3, 5)
    assert found.unresisted.shape == (4, 3)
    for i, j in np.ndindex(4, 3):
        one = choose_locks(U[i, 0], n[j], F[i, j], limits(5), np.full(5, 186.0), held=held[j])
        np.testing.assert_array_equal(one.locked, found.locked[i, j])
        np.testing.assert_allclose(one.motors, found.motors[i, j], atol=1e-9)
    assert choose_locks(np.empty((0, 3, 5)), n[0], 5.0, limits(5), np.full(5, 186.0)).motors.shape == (0, 5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"structure": np.full((3, 4), np.nan)}, r"structure\[0, 0\] is nan"),
        ({"normal": [0.0, 1.0]}, "do not fit"),
        ({"structure": np.ones((6, 4)), "normal": np.ones(6) / np.sqrt(6.0)}, "d = 2 or 3"),
        ({"normal": [0.0, 1.00001, 0.0]}, "not a unit vector"),
        ({"force": -1.0}, "must be 0 N or more"),
        ({"strengths": [186.0] * 3}, "strengths has shape"),
        ({"held": [True] * 3}, "held has shape"),
        ({"force": np.ones((2,)), "pushing": np.ones(3, bool)}, "do not broadcast"),
    ],
)
def test_bad_input_is_refused(change, message):
    given = {
        "structure": FOUR.structure_matrix(FOUR.home),
        "normal": [0.0, 1.0, 0.0],
        "force": 10.0,
        "limits": FOUR.limits,
        "strengths": brake_strengths(FOUR),
    }
    with pytest.raises(ShapeError, match=message):
        choose_locks(**{**given, **change})


MAP_WALLS = fibonacci(3000)
BOX3 = tl.TensionLimits(np.full(3, 0.5), np.full(3, 6.0))


def ceiling(radius):
    angles = np.radians([90.0, 210.0, 330.0])
    return np.stack([radius * np.cos(angles), np.ones(3), radius * np.sin(angles)]) / np.hypot(radius, 1.0)


def test_three_modules_on_the_ceiling_hold_about_half_of_the_walls():
    found = brake_map(ceiling(1.0), MAP_WALLS, 50.0, BOX3, np.full(3, 186.0))
    assert 0.35 < found.share() < 0.6
    # All they can do is pull up.
    down = MAP_WALLS[:, 1] < -np.sqrt(0.5)
    assert np.all(found.angles[down] > np.pi / 4)
    assert not found.chosen.available[MAP_WALLS[:, 1] < -0.9].any()


def test_brakes_add_nothing_where_the_motors_do_and_much_where_they_do_not():
    rig = tl.load_rig("datasets/rigs/cube-8.toml")
    U = rig.structure_matrix(np.array([rig.home, [0.2, 0.1, 0.0]]))
    for force, least in ((3.0, 0.99), (50.0, 0.99)):
        brakes = brake_map(U, MAP_WALLS, force, rig.limits, np.full(8, 186.0))
        motors = brake_map(U, MAP_WALLS, force, rig.limits, np.zeros(8))
        assert brakes.angles.shape == (2, 3000)
        assert np.all(brakes.share() >= least)
        assert np.all(brakes.chosen.unresisted <= motors.chosen.unresisted + 1e-6)
        assert (
            np.mean(motors.chosen.unresisted) < 1e-6 if force < 5.0 else np.mean(motors.chosen.unresisted) > 35.0
        )
