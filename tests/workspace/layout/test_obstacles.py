"""Layouts that keep clear of bodies, held against plain geometry at many positions of the hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.model.module import Module
from tensionlab.workspace import Objective, PoseList, Space, Surface, box, room, search_layout
from tensionlab.workspace.interference import body_distances
from tensionlab.workspace.layout.objective import as_targets
from tensionlab.workspace.layout.obstacles import GAP_M, Obstacles
from tests.helpers.plain_clearance import search

CHEST = box((-0.2, 0.2), (1.1, 1.4), (-0.1, 0.2), step=0.1)
PERSON, STANDS = tl.person("standing", "y", at=[0.0, 0.0, -0.5], facing=[0.0, 0.0, 1.0])
USER_ROOM = Space(room([3.5, 2.7, 4.0]), (5,), bodies=PERSON, rest=(STANDS,), up="y")
QUICK = {"generations": 4, "starts": 2}


def positions(target, count, rng):
    """Positions of the hand in the box of a grid or along a path, its corners among them."""
    points = target.arrays()[0]
    if isinstance(target, PoseList):
        part = rng.uniform(0.0, len(points) - 1.0, size=count)
        left = np.minimum(part.astype(int), len(points) - 2)
        return points[left] + (part - left)[:, None] * (points[left + 1] - points[left])
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, len(low))
    return np.concatenate([rng.uniform(low, high, size=(count, len(low))), corners])


def test_a_layout_around_a_person_is_as_clear_as_it_says_and_the_user_loses_little():
    found = search_layout(USER_ROOM, CHEST, Objective(), certify=True, **QUICK).best
    assert found.clear
    assert found.worst > 2.0
    assert 0.97 * found.worst < found.proved <= found.worst
    hand = positions(CHEST, 100_000, np.random.default_rng(0))
    distances = body_distances(found.rig, hand)
    assert 0.0 <= distances.min() - found.nearest.distance < 0.02
    assert distances.min() >= 0.05
    axes = Rotation.from_rotvec(np.array(STANDS.rotation)).as_matrix()[None]
    for anchor in found.rig.anchors:  # by another way than that of the package
        starts = np.broadcast_to(anchor, hand[::10].shape)
        for each in PERSON:
            assert search(starts, hand[::10], each, STANDS.position, axes)[0].min() >= 0.05
    module, body = np.unravel_index(distances.min(axis=0).argmin(), distances.shape[1:])
    assert found.rig.modules[module].name == found.nearest.module
    assert found.rig.bodies[body].name == found.nearest.body
    # Without the person, the best layout of the same search passes through.
    free = search_layout(replace(USER_ROOM, bodies=(), rest=()), CHEST, Objective(), **QUICK).best
    through = body_distances(replace(free.rig, bodies=PERSON, rest=(STANDS,)), hand[::100])
    assert through.min() < 0.05


BODIES = (
    tl.Body("head", [0.1, 1.6, -0.6], radius=0.12, sway=0.03),
    tl.Body("pole", [0.7, 0.0, 0.3], end=[0.6, 2.0, 0.5], radius=0.05, margin=0.1),
    tl.Body("table", [0.0, 0.6, 0.6], size=[0.8, 0.05, 0.5], frame="desk"),
    tl.Body("tool", [0.0, 0.25, 0.0], end=[0.0, 0.45, 0.1], radius=0.04, frame="hand"),
)
DESK = tl.RestPose("desk", [0.1, 0.1, 0.2], [0.0, 0.4, 0.0])
PATH = PoseList(
    np.stack([0.3 * np.cos(t := np.linspace(0, 5, 60)), 1.2 + 0.1 * np.sin(2 * t), 0.3 * np.sin(t)], -1)
)


@pytest.mark.parametrize("target", [CHEST, PATH, PoseList(PATH.position[::30])], ids=["box", "path", "lines"])
def test_distances_over_a_target_are_the_least_of_all_positions(target):
    """No position of the hand is closer than the bound, and the closest are about as close."""
    rng = np.random.default_rng(5)
    anchors = rng.uniform([-1.7, 0.0, -2.0], [1.7, 2.7, 2.0], size=(40, 3))
    modules = tuple(Module(f"m{i}", anchor, 0.0, 1.0) for i, anchor in enumerate(anchors))
    rig = tl.Rig("all", kind="point", modules=modules, home=[0, 1, 0], bodies=BODIES, rest=(DESK,))
    bound = Obstacles.of(BODIES, as_targets(target, 3), rig.at_rest).slopes(anchors)[0]
    least = body_distances(rig, positions(target, 4000, rng)).min(axis=0)
    apart = bound > 0.0
    assert (bound[apart] <= least[apart] + 1e-9).all()
    assert (least[bound < -GAP_M] < 0.02).all()  # nearly entered by a sample, where the bound says so
    loose = 0.05 if target is CHEST else 0.12  # sampling; and boxes around the pieces of a path
    assert (least[apart] - bound[apart]).max() < loose


def test_slopes_of_distances_are_finite_differences():
    obstacles = Obstacles.of(BODIES, (CHEST,), {"desk": DESK.frame})
    rng, step = np.random.default_rng(1), 1e-3
    anchors = rng.uniform([-1.7, 2.0, -2.0], [1.7, 2.7, 2.0], size=(30, 3))
    distance, slopes = obstacles.slopes(anchors)
    apart = distance > 0.0
    for axis, move in enumerate(step * np.eye(3)):
        ends = [obstacles.slopes(anchors + sign * move)[0] for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / (2 * step)
        wrong = abs(slopes[..., axis] - expected)[apart] > 0.03
        assert wrong.mean() < 0.1  # where two points of a hull are equally near, the slope is one-sided


def test_an_anchor_in_a_body_is_never_used_even_if_no_other_is_left():
    """The only surface is a shelf in a cupboard."""
    cupboard = tl.Body("cupboard", [0.0, 1.0, 2.0], size=[2.0, 2.0, 1.0])
    space = Space((Surface("shelf", [-0.5, 1.0, 2.0], [[1.0, 0.0, 0.0]]),), (3,), bodies=(cupboard,))
    found = search_layout(space, [[0.0, 1.0, 0.0]], Objective(), generations=1, starts=1).best
    assert not found.clear
    assert found.nearest.body == "cupboard"


def test_a_hand_and_fixed_modules_that_no_layout_can_clear_are_refused():
    head = tl.Body("head", [0.0, 1.3, 0.25], radius=0.1)
    with pytest.raises(
        RigError, match=r'target: the hand is as close as -0.050 m to body "head", whose margin is'
    ):
        search_layout(replace(USER_ROOM, bodies=(head,), rest=()), CHEST, Objective())
    behind = Module("behind", [0.0, 1.3, -1.9], 0.5, 6.0)
    with pytest.raises(RigError, match='module "behind": its cable is as close as'):
        search_layout(replace(USER_ROOM, fixed=(behind,)), CHEST, Objective())
