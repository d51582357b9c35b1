import numpy as np
import pytest

import tensionlab as tl
from tensionlab.workspace.certification import ClearanceProblem
from tests.helpers.examples import many
from tests.helpers.plain_clearance import matrices, search, within_ball

REGION = [(-0.5, 0.5), (-0.6, 0.6), (0.6, 1.4)]
EVERYTHING = tl.Requirement(wrench=np.zeros(6))


def distances(rig, positions, bodies=()):
    found = tl.workspace.cable_distance(rig, positions).distance
    return np.minimum(found, tl.workspace.body_distance(rig, positions, bodies=bodies).distance)


@pytest.mark.parametrize(
    "bodies", [(), (tl.Body("post", [0.8, 0.6, 0.2], [0.8, 0.6, 1.2], 0.1),)], ids=["cables", "body"]
)
def test_cables_keep_their_distance_in_all_of_a_cell_or_nowhere(bodies):
    rig = tl.load_rig("ipanema-1")
    least = 0.05
    far = tl.workspace.certify(rig, REGION, EVERYTHING, 0.05)
    proved = tl.workspace.certify(rig, REGION, EVERYTHING, 0.05, clearance=least, bodies=bodies)
    rng = np.random.default_rng(0)
    positions = rng.uniform(*np.array(REGION).T, (20_000, 3))
    verdict, wrenches, distance = proved.at(positions), far.at(positions), distances(rig, positions, bodies)
    assert (distance[verdict == 1] >= least).all()
    assert ((distance < least) | (wrenches == -1))[verdict == -1].all()
    assert (wrenches[verdict == 1] >= 0).all()
    assert (verdict == 1).any()
    assert ((verdict == -1) & (wrenches == 1)).any() == bool(bodies)


def test_a_clearance_holds_within_an_angle():
    rig = tl.load_rig("ipanema-1")
    angle, least = 0.05, 0.03
    proved = tl.workspace.certify(rig, REGION, EVERYTHING, 0.05, clearance=least, angle=angle)
    rng = np.random.default_rng(1)
    positions = rng.uniform(*np.array(REGION).T, (5_000, 3))
    axis = rng.normal(size=(len(positions), 3))
    turns = tl.model.kinematics.exponential(angle * axis / np.linalg.norm(axis, axis=1, keepdims=True))
    distance = tl.workspace.cable_distance(rig, positions, turns).distance
    assert (distance[proved.at(positions) == 1] >= least).all()


@pytest.mark.parametrize(("gap", "verdict"), [(0.9, -1), (1.0 - 1e-9, 0), (1.0, 0), (1.0 + 1e-9, 0), (1.1, 1)])
def test_cables_at_just_the_required_distance_are_left_undecided(gap, verdict):
    """Two parallel cables and a cell of one position: only rounding is in doubt."""
    anchors, arms = np.array([[[0.0, 0.0, 2.0], [gap, 0.0, 2.0]]]), np.array([[[0.0, 0.0, 0.0], [gap, 0.0, 0.0]]])
    problem = ClearanceProblem(1.0, np.array([[0, 1]]), (), np.eye(3)[None], {})
    assert problem.decide(anchors, arms, 0.0, np.zeros((1, 3)), np.zeros(3)).tolist() == [verdict]


@pytest.mark.parametrize(("gap", "verdict"), [(0.7, -1), (0.9, 0), (1.1, 0), (1.3, 1)])
def test_what_may_turn_or_move_by_some_centimetres_is_in_doubt_by_as_much(gap, verdict):
    anchors, arms = np.array([[[0.0, 0.0, 2.0], [gap, 0.0, 2.0]]]), np.array([[[0.0, 0.0, 0.5], [gap, 0.0, 0.5]]])
    problem = ClearanceProblem(1.0, np.array([[0, 1]]), (), np.eye(3)[None], {})
    assert problem.decide(anchors, arms, 0.07, np.zeros((1, 3)), np.full(3, 0.02)).tolist() == [verdict]
    assert problem.decide(anchors, arms, 0.0, np.zeros((1, 3)), np.full(3, 0.11)).tolist() == [verdict]


def bodies_of(d):
    """Bodies of all shapes in the world, on the hand, and on a frame: those of the head sway."""
    up = np.eye(d)[-1]
    return (
        tl.Body("post", 0.8 * np.eye(d)[0], 0.8 * np.eye(d)[0] + up / 2, 0.08, margin=0.03),
        tl.Body("head", 0.1 * up, radius=0.1, frame="head", margin=0.08, sway=0.06),
        tl.Body("visor", np.full(d, 0.1), size=np.full(d, 0.2), frame="head", margin=0.02, sway=0.06),
        tl.Body("tool", -0.25 * up, -0.4 * up, radius=0.02, frame="hand", margin=0.01),
    )


@pytest.mark.parametrize(
    ("name", "region", "place", "angle"),
    [
        ("ipanema-1", REGION, [-0.9, 0.7, 1.5], 0.02),
        ("bartels2026-validation", [(-0.3, 0.3), (0.2, 1.2), (-0.3, 0.3)], [-0.25, 0.5, 0.1], 0.0),
        ("kntu-planar", [(-0.4, 0.4), (-0.4, 0.4)], [0.6, 0.5], 0.01),
    ],
)
def test_what_is_proved_of_bodies_holds_between_the_grid_points(name, region, place, angle):
    """Many poses: orientations within the angle, bodies within their sways, by another computation."""
    rig, rng, count = tl.load_rig(name), np.random.default_rng(3), many(40_000)
    d, zero = rig.dimension, np.zeros(rig.n)
    rig = tl.Rig(rig.name, rig.kind, rig.modules, rig.home, bodies=bodies_of(d))
    head = (np.array(place), matrices(rng, 1, d)[0])
    given = {"head": head if d == 3 else (head[0], np.arctan2(head[1][1, 0], head[1][0, 0]))}
    statement = (region, ([*zero], 0.0), 0.05)
    proved = tl.workspace.certify(rig, *statement, angle=angle, frames=given)
    far = tl.workspace.certify(rig, *statement, angle=angle, bodies=())
    position, turn = rng.uniform(*np.array(region).T, (count, d)), matrices(rng, count, d, angle)
    everywhere = {"hand": (position, turn), "head": head, "world": (np.zeros(d), np.eye(d))}
    slack, tried = np.full(count, np.inf), np.full(count, np.inf)
    for body in rig.bodies:
        origin, axes = (np.broadcast_to(part, (count, *np.shape(part)[-k:])) for k, part in
                        zip((1, 2), everywhere[body.frame], strict=True))  # fmt: skip
        shift = within_ball(rng, count, d, body.sway)
        for module in rig.modules:
            starts = np.broadcast_to(module.anchor, (count, d))
            ends = position + np.einsum("nij,j->ni", turn, module.attachment)
            slack = np.minimum(slack, search(starts, ends, body, origin, axes)[0] - body.sway - body.margin)
            tried = np.minimum(tried, search(starts, ends, body, origin + shift, axes)[0] - body.margin)
    verdict, wrenches = proved.at(position), far.at(position)
    assert (slack[verdict == 1] >= 0.0).all()
    assert (tried[verdict == 1] >= 0.0).all()
    assert (slack[(verdict == -1) & (wrenches == 1)] < 0.0).all()
    assert (verdict[wrenches == -1] == -1).all()
    assert all(((verdict == each) & (wrenches == 1)).sum() > count // 120 for each in (1, -1))
    undecided = slack[verdict == 0]
    assert (undecided > 0.0).any()
    assert (undecided < 0.0).any()
    assert "cables clear of post, head, visor, tool" in proved.required
