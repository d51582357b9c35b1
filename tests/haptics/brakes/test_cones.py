import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from tensionlab.errors import ShapeError
from tests.helpers.brake_cones import (
    allows,
    blocks_free_motion,
    blocks_withdrawal,
    brake_reaction,
    holds,
    traps,
)

UP, SIDE = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
# Three cables, 45 degrees above the horizon.
TRIPOD = np.array([[np.cos(a), 1.0, np.sin(a)] for a in np.radians([0.0, 120.0, 240.0])]).T / np.sqrt(2.0)
ALL3 = np.ones(3, dtype=bool)


def random_cables(rng, *shape):
    vectors = rng.normal(size=shape)
    return vectors / np.linalg.norm(vectors, axis=-2, keepdims=True)


@st.composite
def situations(draw):
    """Cables, some of them locked, and a load."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d, m = draw(st.sampled_from([2, 3])), draw(st.integers(1, 7))
    U = random_cables(rng, d, m)
    if draw(st.booleans()) and m > 1:
        U[:, 1] = draw(st.sampled_from([1.0, -1.0])) * U[:, 0]  # parallel, or opposite
    return U, rng.random(m) < 0.6, rng.normal(size=d) * draw(st.sampled_from([0.0, 1.0, 50.0]))


def test_one_brake_holds_what_pulls_on_its_cable_and_nothing_else():
    U = np.stack([UP, SIDE], axis=1)
    tensions, net = brake_reaction(U, [True, False], [3.0, -7.0, 1.0])
    np.testing.assert_allclose(tensions, [7.0, 0.0])
    np.testing.assert_allclose(net, [3.0, 0.0, 1.0], atol=1e-15)
    # It lets the cable reel in, and an unlocked one holds nothing.
    for locked, load in ([[True, False], [0.0, 7.0, 0.0]], [[False, False], [-1.0, -7.0, 0.0]]):
        tensions, net = brake_reaction(U, locked, load)
        np.testing.assert_array_equal(tensions, [0.0, 0.0])
        np.testing.assert_array_equal(net, load)


def test_a_tripod_shares_a_weight():
    tensions, net = brake_reaction(TRIPOD, ALL3, [0.0, -30.0, 0.0])
    np.testing.assert_allclose(tensions, 3 * [10.0 * np.sqrt(2.0)])
    np.testing.assert_allclose(net, 0.0, atol=1e-13)


def test_known_walls():
    # A ceiling's normal points down, a floor's up: cables from above hold the floor.
    assert holds(TRIPOD, ALL3, UP)
    assert not holds(TRIPOD, ALL3, -UP)
    assert not holds(TRIPOD, [True, True, False], UP)
    assert not blocks_withdrawal(TRIPOD, ALL3, UP)
    assert not traps(TRIPOD, ALL3, UP)
    # The tripod also keeps the hand from sliding along the floor; a cable along the normal does not.
    assert blocks_free_motion(TRIPOD, ALL3, UP)
    above = np.stack([UP, SIDE], axis=1)
    assert holds(above, [True, False], UP)
    assert not blocks_free_motion(above, [True, False], UP)
    assert not blocks_free_motion(above, [False, False], UP)
    # Cables on both sides trap the hand; one aslant blocks the straight way out, but not all ways.
    between = np.stack([UP, -UP, (SIDE - UP) / np.sqrt(2.0)], axis=1)
    assert traps(between, [True, True, False], UP)
    assert blocks_withdrawal(between, [True, False, True], UP)
    assert not traps(between, [True, False, True], UP)


def test_the_edges_of_the_cones():
    edge = TRIPOD[:, 0] + TRIPOD[:, 1]
    assert holds(TRIPOD, ALL3, edge)
    assert not holds(TRIPOD, ALL3, edge - 1e-6 * TRIPOD[:, 2])
    assert allows(np.stack([UP], axis=1), [True], SIDE)
    assert not allows(np.stack([UP], axis=1), [True], SIDE - 1e-6 * UP)


@given(situations())
def test_the_reaction_is_a_projection_onto_the_cone(situation):
    U, locked, load = situation
    tensions, net = brake_reaction(U, locked, load)
    assert np.all(tensions >= 0.0)
    assert np.all(tensions[~locked] == 0.0)
    np.testing.assert_allclose(net, load + U @ tensions, atol=1e-12)
    # What is left moves the point as the brakes allow, and each reacts only where its cable stays taut.
    rates = U[:, locked].T @ net
    strength = max(1.0, tensions.max(initial=0.0))  # cables that nearly oppose each other pull hard
    assert np.all(rates >= -1e-9)
    assert np.abs(tensions[locked] * rates).max(initial=0.0) <= 1e-9 * strength
    if locked.any():
        assert np.linalg.norm(net) == pytest.approx(nnls(U[:, locked], -load)[1], abs=1e-9)


@given(situations())
def test_a_brake_never_acts(situation):
    U, locked, load = situation
    tensions, net = brake_reaction(U, locked, load)
    force = U @ tensions
    assert force @ load <= 1e-9  # it opposes what pulls
    assert abs(force @ net) <= 1e-9  # and does no work on what moves
    if np.all(U[:, locked].T @ load >= 0.0):
        np.testing.assert_array_equal(tensions, 0.0)


@given(situations(), st.integers(0, 2**32 - 1))
def test_the_cones_are_dual(situation, seed):
    U, locked, _ = situation
    rng = np.random.default_rng(seed)
    force, velocity = U @ np.where(locked, rng.random(locked.size), 0.0), rng.normal(size=len(U))
    if np.linalg.norm(force) > 1e-6:
        assert holds(U, locked, force)
    if allows(U, locked, velocity):
        assert force @ velocity >= -1e-9
    else:  # Farkas: then a force of the other cone separates it.
        assert np.min(U[:, locked].T @ velocity) < 0.0
    # What is left of a load is in the motion cone, whatever the load.
    net = brake_reaction(U, locked, velocity).net
    if np.linalg.norm(net) > 1e-6:
        assert allows(U, locked, net)


@given(situations())
def test_a_linear_program_agrees_on_walls(situation):
    U, locked, load = situation
    n = load if load.any() else np.eye(len(U))[0]
    n = n / np.linalg.norm(n)
    cone = U[:, locked]

    def feasible(target):
        if not cone.size:
            return False
        error = linprog(
            np.append(np.zeros(cone.shape[1]), 1.0),
            A_ub=np.block([[cone, -np.ones((len(U), 1))], [-cone, -np.ones((len(U), 1))]]),
            b_ub=np.concatenate([target, -target]),
        ).fun
        return error < 1e-7

    assert holds(U, locked, n) == feasible(n)
    assert traps(U, locked, n) == feasible(-n)
    # Trapped if and only if no velocity of the motion cone leaves the wall.
    away = linprog(
        -n,
        A_ub=-cone.T if cone.size else None,
        b_ub=np.zeros(cone.shape[1]) if cone.size else None,
        bounds=(-1.0, 1.0),
    )
    assert traps(U, locked, n) == (-away.fun < 1e-7)


def test_any_leading_axes():
    rng = np.random.default_rng(0)
    U, locked, load = random_cables(rng, 4, 1, 3, 6), rng.random((5, 6)) < 0.5, rng.normal(size=(4, 5, 3))
    found = brake_reaction(U, locked, load)
    assert found.tensions.shape == (4, 5, 6)
    for i, j in np.ndindex(4, 5):
        single = brake_reaction(U[i, 0], locked[j], load[i, j])
        np.testing.assert_allclose(found.tensions[i, j], single.tensions, atol=1e-12)
        assert holds(U, locked, load)[i, j] == holds(U[i, 0], locked[j], load[i, j])
    assert brake_reaction(np.empty((0, 3, 6)), np.zeros(6, bool), np.empty((0, 3))).tensions.shape == (0, 6)


@pytest.mark.parametrize(
    ("structure", "locked", "load", "message"),
    [
        (np.eye(4), [True] * 4, np.zeros(4), "give that of a point"),
        (TRIPOD, [True, False], UP, "locked has shape"),
        (TRIPOD, [1.0, 0.0, 0.0], UP, "type float64"),
        (TRIPOD, ALL3, [0.0, 1.0], "load has shape"),
        (TRIPOD, ALL3, [0.0, np.nan, 0.0], r"load\[1\] is nan"),
        (np.stack([TRIPOD] * 2), np.ones((3, 3), bool), UP, "do not broadcast"),
    ],
)
def test_bad_input_is_refused(structure, locked, load, message):
    with pytest.raises(ShapeError, match=message):
        brake_reaction(structure, locked, load)


def test_a_wall_needs_a_normal():
    with pytest.raises(ShapeError, match="length zero"):
        holds(TRIPOD, ALL3, [0.0, 0.0, 0.0])
