import numpy as np
import pytest

import tensionlab as tl
from tensionlab.workspace.certification import ClearanceProblem

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
