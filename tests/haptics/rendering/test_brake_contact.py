import numpy as np
import pytest

import tensionlab as tl
from tensionlab.haptics.rendering.brakes import BrakeWall, ImpactCap, LockRule, Timing, decide

UP = np.array([0.0, 1.0])
FLOOR_M = 2.0
ABOVE = np.stack([[0.0, 1.0], [0.6, 0.8], [-0.6, 0.8]], axis=1)
BOX = tl.TensionLimits(np.full(3, 0.5), np.full(3, 6.0))
STRONG = np.full(3, 186.0)


def at(height, speed, contact=None, *, force=40.0, structure=ABOVE, strengths=STRONG, sideways=0.0, cap=None):
    """Decide for a hand at this height over a floor, moving up with this speed."""
    wall = BrakeWall(UP, height, force)
    return decide(structure, [0.0, FLOOR_M + height], [sideways, speed], wall, BOX, strengths, contact, cap=cap)


def test_brakes_are_locked_in_time():
    # 80 ms of the way at the speed of approach, and 3 mm to the next tooth.
    np.testing.assert_array_equal(
        Timing().near([0.042, 0.044, 0.003, 0.004, -0.1], [0.5, 0.5, -1.0, 0.0, -1.0]),
        [True, False, True, False, True],
    )
    assert at(0.044, -0.5).reason == "not near"
    assert at(0.042, -0.5).reason == "locked"
    assert at(0.042, -0.2).reason == "not near"


def test_motors_pull_for_the_wall_only_inside_it():
    inside = at(-0.001, -0.5)
    for early in (at(0.01, -0.5), at(0.0005, -0.5)):
        assert early.locked.any()
        np.testing.assert_array_equal(early.motors, BOX.lower)
    np.testing.assert_array_equal(inside.motors, inside.chosen.motors)
    assert inside.motors.max() == pytest.approx(6.0)


def test_a_hand_at_rest_in_the_wall_is_held_until_it_leaves():
    first = at(-0.002, -0.1)
    assert first.reason == "locked"
    deeper = at(-0.004, 0.0, first.contact)
    assert deeper.contact.position[1] == FLOOR_M - 0.004
    # 5 mm from where it was deepest, going in or out.
    for height, speed in ((0.0009, -0.01), (0.0009, 0.3), (-0.0035, 0.0)):
        still = at(height, speed, deeper.contact)
        assert still.reason == "locked"
        assert still.contact.position[1] == deeper.contact.position[1]
    assert at(0.0011, 0.3, deeper.contact).reason == "leaving"
    assert at(0.0041, 0.0, deeper.contact).reason == "not near"
    assert at(0.0011, 0.3, deeper.contact).contact is None


def test_nothing_is_locked_while_the_hand_leaves():
    assert at(-0.002, 0.1).reason == "leaving"
    assert at(-0.002, 0.0).reason == "locked"


def test_it_says_why_there_is_no_brake():
    assert at(-0.001, -0.1, force=5.0).reason == "motors"
    below = at(-0.001, -0.1, structure=-ABOVE)
    assert below.reason == "no cable"
    assert below.chosen.unresisted > 40.0
    assert at(-0.001, -0.1, strengths=np.zeros(3)).reason == "no cable"
    assert at(-0.001, -0.1, force=0.0).reason != "locked"
    # A brake aslant that would take too little of the push to be worth its price.
    weak = at(-0.001, -0.1, strengths=[6.01, 6.01, 6.01])
    assert weak.reason == "motors"
    assert weak.chosen.unresisted > 1.0


def test_the_published_numbers_of_a_head():
    cap = ImpactCap()
    assert cap.peak(0.5) == pytest.approx(79.06, abs=0.01)
    limit = 60.0 / np.sqrt(5000.0 * 5.0)
    assert cap.stiffness_ratio(limit) == pytest.approx(1.0)
    assert cap.peak(limit) == pytest.approx(60.0)
    assert cap.stiffness_ratio(0.0) == np.inf
    # Two cables side by side are twice as stiff.
    assert cap.peak(limit, 2.0) == pytest.approx(60.0 * np.sqrt(2.0))


def test_a_fast_head_is_not_stopped():
    assert at(0.02, -0.37, cap=ImpactCap()).locked.sum() == 1
    assert at(0.02, -0.39, cap=ImpactCap()).reason == "too fast"
    assert at(0.01, -0.2, sideways=0.35, cap=ImpactCap()).reason == "too fast"
    assert at(0.02, -0.37).locked.sum() == 1
    # A single brake may be loaded with the cap, not with all that it holds.
    assert at(0.0, -0.1, force=500.0, cap=ImpactCap()).chosen.brakes.max() <= 60.0 - 6.0 + 1e-9
    assert at(0.0, -0.1, force=500.0).chosen.brakes.max() == pytest.approx(180.0)


def test_the_impact_of_what_is_locked_stays_below_the_cap():
    """A mass that runs into the cables that were chosen at its speed, step by step."""
    rng = np.random.default_rng(1)
    cap, peaks = ImpactCap(), []
    for _ in range(60):
        U = rng.normal(size=(3, 5)) + np.array([[0.0], [1.5], [0.0]])
        U /= np.linalg.norm(U, axis=0)
        box = tl.TensionLimits(np.full(5, 0.5), np.full(5, 6.0))
        v = np.append(rng.normal(size=2) * 0.1, 0.0)[[0, 2, 1]] - [0.0, rng.uniform(0.02, 0.5), 0.0]
        wall = BrakeWall([0.0, 1.0, 0.0], 0.0, 60.0)
        own = U[:, decide(U, np.zeros(3), v, wall, box, np.full(5, 186.0), cap=cap).locked]
        if own.size == 0:
            continue
        x, step, peak = np.zeros(3), 1e-4, 0.0
        for _ in range(2500):
            force = own @ (cap.stiffness * np.maximum(0.0, -own.T @ x))
            v = v + step * force / cap.mass
            x = x + step * v
            peak = max(peak, float(np.linalg.norm(force)))
        peaks.append(peak)
    assert len(peaks) > 25
    assert max(peaks) <= cap.force * 1.01
    assert max(peaks) > 0.7 * cap.force


def test_a_hand_that_pushes_and_leaves():
    """A hand on a floor of brakes: it stops where it is held, and leaves without meeting them."""
    timing, mass, step = Timing(), 0.5, 1e-3
    p, v, contact, since = np.array([0.0, 0.02]), np.array([0.0, -0.2]), None, None
    lowest, engaged, slowest_exit, changes, last = (
        0.02,
        np.zeros(3, dtype=bool),
        np.inf,
        0,
        np.zeros(3, dtype=bool),
    )
    for k in range(2000):
        time = k * step
        # An arm that wants to move at 0.2 m/s, down and later up, and pushes with up to 30 N for it.
        user = np.array([0.0, np.clip(100.0 * ((-0.2 if time < 1.0 else 0.2) - v[1]), -30.0, 30.0)])
        anchors = np.array([[0.0, 1.0], [0.6, 0.8], [-0.6, 0.8]])
        U = (anchors - p).T / np.linalg.norm(anchors - p, axis=1)
        found = decide(U, p, v, BrakeWall(UP, float(p[1]), 60.0), BOX, STRONG, contact, timing)
        contact = found.contact
        changes += int(np.any(found.locked != last))
        last = found.locked
        since = None if not found.locked.any() else since if since is not None else time
        if since is None:
            engaged = np.zeros(3, dtype=bool)
        elif time - since >= timing.latency:
            engaged = found.locked
        v = v + step * (user + U @ found.motors) / mass
        for i in np.flatnonzero(engaged):  # the pawl: no paying out
            v = v + U[:, i] * max(0.0, -U[:, i] @ v)
        p = p + step * v
        lowest = min(lowest, p[1])
        if time > 1.0 + timing.latency:
            slowest_exit = min(slowest_exit, v[1])
    assert 0.0 <= lowest <= timing.slack  # the slack that this pawl has not
    assert changes <= 4
    assert slowest_exit > 0.19
    assert p[1] > 0.1


def test_numbers_that_make_no_sense_are_refused():
    for make in (lambda: LockRule(margin=0.0), lambda: Timing(latency=-1.0), lambda: ImpactCap(mass=0.0)):
        with pytest.raises(ValueError, match=r"(margin|latency|mass) is -?[01]"):
            make()
    with pytest.raises(tl.errors.ShapeError, match="position has shape"):
        decide(ABOVE, [0.0], [0.0, 0.0], BrakeWall(UP, 0.0, 1.0), BOX, STRONG)
