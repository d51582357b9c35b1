"""Cables that near bodies of the rig in a run: events, limits that fall, and what is told of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.demand import Demand, Impedance, Pose
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.runner.body_clearance import HYSTERESIS_M, BodyClearance
from tensionlab.solvers.base import Status
from tensionlab.workspace.interference import body_distances
from tests.helpers.rehearsal import Rehearsal
from tests.helpers.runs import new_log

MARGIN, TOP = 0.1, 3
HEAD = tl.Body("head", [0.0, 0.7, -0.3], radius=0.12, margin=MARGIN)
PLAIN = tl.load_rig("bartels2026-validation")
RIG = replace(PLAIN, bodies=(HEAD,))


def place(time):
    """Hand that goes to and fro twice, so that the cable of the top module passes through the head."""
    return Pose(RIG.home + np.array([0.0, 0.0, -0.35 * np.sin(np.pi * time) ** 2]))


@pytest.fixture(scope="module")
def passed(tmp_path_factory):
    """Run in which the top module is to pull with 4 N while its cable twice passes through a head."""
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    rehearsal = Rehearsal(RIG, motion=place)
    rehearsal.trouble_at = 1e9
    demand = rehearsal.demand(np.array([0.0, 4.0, 0.0]))
    runner = rehearsal.runner(demand, sinks=[new_log(file, RIG, rate=100.0)], tracker=place, rate=100.0)
    return runner.run(2.0), read_run(file)


def test_a_cable_that_nears_a_head_is_an_event_for_each_approach(passed):
    statistics, run = passed
    distance = run.clearance[:, TOP]
    assert distance.min() < 0.0 < MARGIN < distance.max()
    assert np.count_nonzero(np.diff((distance < MARGIN).astype(int)) == 1) == 2
    events = [event for event in run.events if event.kind == "near"]
    assert [event.module for event in events] == ["top", "top"]
    assert all('from "head", closer than its margin of 0.1 m' in event.text for event in events)
    assert list(statistics.near) == ["top"]
    how = '0.00 m from "head", closer than its margin of 0.1 m: its upper limit fell to 0.50 N'
    assert run.summary["near"] == {"top": how}
    assert ("near a body: top", how) in statistics.rows()


def test_its_limit_falls_in_proportion_to_the_distance_without_a_jump_and_never_below_the_lower(passed):
    _, run = passed
    lower, upper = RIG.limits.lower[TOP], RIG.limits.upper[TOP]
    share = np.clip(run.clearance[:, TOP] / MARGIN, 0.0, 1.0)
    expected = lower + share * (upper - lower)
    assert (run.upper_now[:, TOP] <= expected + 1e-9).all()
    np.testing.assert_allclose(run.upper_now[:, TOP], expected, atol=0.05 + 1e-9)
    assert run.upper_now[:, TOP].min() == lower
    speed = np.abs(np.diff(run.clearance[:, TOP])).max()
    assert np.abs(np.diff(run.upper_now[:, TOP])).max() <= speed / MARGIN * (upper - lower) + 0.05 + 1e-9
    np.testing.assert_array_equal(run.upper_now[:, :TOP], np.tile(RIG.limits.upper[:TOP], (len(run), 1)))
    settled = run.commanded[:, TOP] <= run.upper_now[:, TOP] + 1e-9
    assert settled[1:].mean() > 0.9, "but for the slew of the set-points"
    assert run.commanded[run.clearance[:, TOP] < -0.05, TOP] == pytest.approx(lower)


def test_what_is_lost_is_reported_by_the_allocation(passed):
    _, run = passed
    far, close = run.clearance[:, TOP] > MARGIN, run.clearance[:, TOP] < MARGIN / 4
    assert (run.status[far] == Status.EXACT).all()
    assert (run.status[close] == Status.NEAREST).all()
    assert run.residual[close].min() > 1.0


def test_a_distance_about_the_margin_is_one_approach():
    """All three cables go down from the hand, so that it is nearest to a head above it."""
    plain, events = tl.load_rig("floor-3"), []
    upwards = -plain.structure_matrix(plain.home).mean(axis=1)
    upwards /= np.linalg.norm(upwards)
    rig = replace(plain, bodies=(tl.Body("head", plain.home + 0.3 * upwards, radius=0.1, margin=MARGIN),))
    monitor = BodyClearance(rig, lambda *event: events.append(event))

    def go(distance):
        """Put the hand, which is where all cables end, at a distance from the head."""
        position = rig.home + (0.2 - distance) * upwards
        monitor.update(Pose(position), rig.structure_matrix(position))
        return monitor.distances

    for step in (0.5, -0.1, 0.5, -0.1, 0.9, -0.5):  # of the hysteresis
        go(MARGIN + step * HYSTERESIS_M)
    assert len(events) == rig.m
    go(MARGIN + 1.1 * HYSTERESIS_M)
    assert monitor.limited(rig.limits) is rig.limits
    np.testing.assert_allclose(go(MARGIN / 2), MARGIN / 2, atol=1e-9)
    assert len(events) == 2 * rig.m
    halves = (rig.limits.lower + rig.limits.upper) / 2
    np.testing.assert_allclose(monitor.limited(rig.limits).upper, halves, atol=0.05)
    hot = tl.TensionLimits(rig.limits.lower, rig.limits.lower + 0.5)
    np.testing.assert_array_equal(monitor.limited(hot).upper, hot.upper)


def test_the_impedance_of_a_cable_near_a_body_is_softened():
    head = tl.Body("head", RIG.home - np.array([0.0, 0.0, 0.15]), radius=0.1, margin=MARGIN)
    monitor = BodyClearance(replace(PLAIN, bodies=(head,)), lambda *event: None)
    monitor.update(Pose(RIG.home), RIG.structure_matrix(RIG.home))
    spring, states = Impedance(1.0, 100.0, 2.0, 0.5, 0.4, 40.0), [(1.1, 0.3), (0.9, -0.1)]
    for length, speed in states:
        softer = monitor.soften(spring, TOP)
        assert softer.tension(length, speed) == pytest.approx(0.5 * spring.tension(length, speed))
        assert (softer.rest, softer.frequency, softer.amplitude) == (1.0, 40.0, pytest.approx(0.2))


def test_bodies_on_frames_move_with_them_and_a_rig_without_has_no_clearance():
    rig = replace(PLAIN, bodies=(replace_frame(HEAD, "head"),))
    monitor = BodyClearance(rig, lambda *event: None)
    structure = rig.structure_matrix(rig.home)
    found = []
    for offset in (0.0, 0.4):
        frames = {"head": (np.array([0.0, 0.0, -offset]), None)}
        monitor.update(Pose(rig.home, None, frames), structure)
        found.append(monitor.distances.copy())
    assert (found[1] > found[0]).all()
    bare = BodyClearance(PLAIN, lambda *event: None)
    bare.update(Pose(rig.home), structure)
    assert np.isnan(bare.distances).all()


def replace_frame(body, frame):
    return tl.Body(body.name, body.start, radius=body.radius, frame=frame, margin=body.margin)


def test_a_force_that_other_cables_can_render_is_rendered():
    rig = tl.load_rig("cube-8")
    near = tl.Body("post", (rig.home + rig.anchors[0]) / 2, radius=0.05, margin=MARGIN)
    rehearsal = Rehearsal(replace(rig, bodies=(near,)))
    runner = rehearsal.runner(lambda state: Demand(np.array([0.5, 0.0, 0.0])))
    runner.run(0.5)
    last = runner.latest
    assert last.state.upper_now[0] == rig.limits.lower[0]
    assert last.allocation.status == Status.EXACT


def bodies(random, d, frames):
    """Bodies of all shapes, on each frame."""
    found = []
    for frame in frames:
        ends, size = random.uniform(-1.0, 1.0, (3, 2, d)), random.uniform(0.05, 0.6, d)
        found += [
            tl.Body(f"ball of {frame}", ends[0, 0], radius=0.1, frame=frame, sway=0.03),
            tl.Body(f"limb of {frame}", *ends[1], radius=0.05, frame=frame),
            tl.Body(f"box of {frame}", ends[2, 0], size=size, frame=frame, sway=0.02),
        ]
    return tuple(found)


@pytest.mark.parametrize("name", ["bartels2026-validation", "cube-8", "kntu-planar", "body-mounted", "ipanema-1"])
def test_distances_are_those_of_the_workspace(name):
    random, plain = np.random.default_rng(3), tl.load_rig(name)
    d, turns = plain.dimension, plain.n > plain.dimension
    rig = replace(plain, bodies=bodies(random, d, ("world", "hand", "seat", *plain.frames)))
    monitor = BodyClearance(rig, lambda *event: None)
    for _ in range(50):
        position, angles = rig.home + random.uniform(-0.2, 0.2, d), random.uniform(-1.0, 1.0, (2, 3))
        matrix, turned = Rotation.from_rotvec(angles).as_matrix()
        rotation = None if not turns else angles[0, 0] if d == 2 else matrix
        turn = angles[1, 0] if d == 2 else turned
        frames = {name: (random.uniform(-0.3, 0.3, d), turn) for name in ("seat", *rig.frames)}
        monitor.update(Pose(position, rotation, frames), rig.structure_matrix(position, rotation, frames))
        expected = body_distances(rig, position, rotation, frames).min(axis=1)
        # Cables over pulleys end within the pulleys' radius of where they do in the workspace.
        slack = 0.0 if rig.pulleys is None else rig.pulleys[0].max()
        np.testing.assert_allclose(monitor.distances, expected, atol=1e-9 + slack)
