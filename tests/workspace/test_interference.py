"""Distances known by hand, from another optimiser, and from sampling; and what counts as touching."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from tensionlab.errors import RigError
from tensionlab.model.bodies import Body, place_bodies
from tensionlab.model.files import load_rig
from tensionlab.model.module import KINDS, Module
from tensionlab.model.pose import RestPose
from tensionlab.model.rig import Rig
from tensionlab.workspace.interference import (
    body_distance,
    body_distances,
    cable_distance,
    cable_pairs,
    closest_pair,
    distances_to_placed,
)
from tests.helpers.examples import many
from tests.helpers.plain_clearance import matrices, search, within_ball

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"


def segment_distance(*ends):
    return closest_pair(np.reshape(ends, (2, 2, -1)), np.array([[0, 1]])).distance


def box_distance(ends, half):
    """Distance of a segment from a box about the origin with half edges."""
    box = Body("box", np.zeros(len(half)), size=2 * half)
    return distances_to_placed(
        np.array([ends], float), [box], place_bodies([box], np.zeros(len(half)), None, {})
    ).item()


KNOWN = {
    "crossing": ([-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], 0.0),
    "passing over": ([-1, 0, 0], [1, 0, 0], [0, -1, 0.3], [0, 1, 0.3], 0.3),
    "parallel, side by side": ([0, 0, 0], [2, 0, 0], [1, 0.5, 0], [3, 0.5, 0], 0.5),
    "parallel, one after the other": ([0, 0, 0], [1, 0, 0], [4, 4, 0], [5, 4, 0], 5.0),
    "antiparallel": ([0, 0, 0], [2, 0, 0], [3, 1, 0], [1, 1, 0], 1.0),
    "one line, overlapping": ([0, 0, 0], [2, 0, 0], [1, 0, 0], [3, 0, 0], 0.0),
    "one line, apart": ([0, 0, 0], [1, 0, 0], [3, 0, 0], [2, 0, 0], 1.0),
    "end to middle": ([-1, 0, 0], [1, 0, 0], [0, 0.7, 0], [0, 3, 0], 0.7),
    "end to end": ([0, 0, 0], [1, 0, 0], [4, 4, 0], [9, 4, 0], 5.0),
    "shared end": ([0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 1], 0.0),
    "point and segment": ([0, 0, 2], [0, 0, 2], [-1, 0, 0], [1, 0, 0], 2.0),
    "two points": ([0, 0, 0], [0, 0, 0], [0, 3, 4], [0, 3, 4], 5.0),
    "in the plane": ([0, 0], [2, 2], [0, 2], [0.5, 1.5], np.sqrt(0.5)),
}


@pytest.mark.parametrize("case", KNOWN.values(), ids=KNOWN)
def test_known_distances(case):
    *ends, expected = case
    a, b, c, d = ends
    for swapped in ((a, b, c, d), (b, a, c, d), (c, d, a, b), (d, c, b, a)):
        assert segment_distance(*swapped) == pytest.approx(expected, abs=1e-12)


def by_least_squares(a, b, c, d):
    """The least value of |a + s (b - a) - c - t (d - c)| over 0 <= s, t <= 1."""
    u, v = b - a, d - c
    return np.linalg.norm(
        lsq_linear(np.stack([u, -v], axis=1), c - a, bounds=(0, 1), method="bvls").x @ [u, -v] + a - c
    )


@settings(max_examples=many(200))
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-3, 1e-7, 0.0]))
def test_agrees_with_bounded_least_squares_also_when_nearly_parallel(seed, turn):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, 3))
    d = c + rng.choice([-2.0, -1.0, 0.5, 1.0]) * (b - a) + turn * rng.normal(size=3)
    assert segment_distance(a, b, c, d) == pytest.approx(by_least_squares(a, b, c, d), abs=1e-7)


def statement(segments, pairs, radii):
    """What the kernel computes, by dense sampling: never less than the truth, and at most half a step more."""
    along = np.linspace(0, 1, 201)
    best = np.inf
    for i, j in pairs:
        first, second = (segments[k][0] + along[:, None] * (segments[k][1] - segments[k][0]) for k in (i, j))
        gaps = np.linalg.norm(first[:, None] - second[None], axis=-1)
        best = min(best, gaps.min() - radii[i] - radii[j])
    return best


def rig_of(anchors, attachments, frames=None, kind="platform"):
    frames = ["world"] * len(anchors) if frames is None else frames
    modules = tuple(
        Module(f"m{i}", anchor, 0.0, 1.0, attachment=attachment, frame=frame)
        for i, (anchor, attachment, frame) in enumerate(zip(anchors, attachments, frames, strict=True))
    )
    return Rig(name="r", kind=kind, modules=modules, home=np.zeros(len(anchors[0])))


@pytest.mark.parametrize("name", ["ipanema-2", "cogiro", "spidar-g6x4", "kntu-planar"])
def test_cables_of_real_rigs_agree_with_sampling(name):
    rig = load_rig(RIGS / f"{name}.toml")
    rng = np.random.default_rng(3)
    size = np.ptp(rig.anchors, axis=0).max()
    positions = rig.home + 0.05 * size * rng.uniform(-1, 1, size=(5, rig.dimension))
    found = cable_distance(rig, positions)
    assert found.distance.shape == (5,)
    assert found.pair.shape == (5, 2)
    for position, distance, pair in zip(positions, *found, strict=True):
        segments = [(anchor, position + b) for anchor, b in zip(rig.anchors, rig.attachments, strict=True)]
        longest = max(np.linalg.norm(end - start) for start, end in segments)
        sampled = statement(segments, cable_pairs(rig), np.zeros(rig.m))
        assert sampled - longest / 200 <= distance <= sampled + 1e-12
        assert segment_distance(*segments[pair[0]], *segments[pair[1]]) == pytest.approx(distance, abs=1e-12)


def test_a_turned_platform_and_a_moved_frame_are_taken_into_account():
    rig = rig_of([[2, 0, 0], [0, 0, 0]], [[1, 0, 0], [-1, 0, 0]], frames=["world", "hip"])
    half_turn = np.diag([-1.0, -1.0, 1.0])
    # Straight: x from 1 to 2 and from -2 to -1. Turned about: from -1 to 2 and from -2 to 1, on one line.
    frames = {"hip": [-2.0, 0.0, 0.0]}
    assert cable_distance(rig, [0, 0, 0], frames=frames).distance == pytest.approx(2.0, abs=1e-12)
    assert cable_distance(rig, [0, 0, 0], half_turn, frames).distance == pytest.approx(0.0, abs=1e-12)
    many = cable_distance(rig, [0, 0, 0], frames={"hip": np.array([[-2.0, 0, 0], [-2, 3, 0]])})
    assert many.distance.shape == (2,)


def test_cables_that_share_an_end_are_left_out():
    rig = load_rig(RIGS / "spidar-g6x4.toml")
    shared = {
        (i, j)
        for i in range(rig.m)
        for j in range(i + 1, rig.m)
        if np.array_equal(rig.attachments[i], rig.attachments[j])
    }
    assert shared
    assert {tuple(pair) for pair in cable_pairs(rig).tolist()} | shared == {
        (i, j) for i in range(rig.m) for j in range(i + 1, rig.m)
    }
    assert cable_distance(rig, rig.home).distance > 0
    # The same place in two frames is no shared anchor.
    apart = rig_of([[1, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0.1, 0]], frames=["world", "hip"])
    assert cable_pairs(apart).tolist() == [[0, 1]]
    together = rig_of([[1, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0.1, 0]])
    assert cable_pairs(together).shape == (0, 2)


def test_a_head_beside_one_cable():
    """The cable of module 1 runs along X at a height of 1 m; the head, of 0.1 m, is centred 0.25 m above it."""
    modules = (Module("up", [0, 5, 0], 0.5, 6), Module("side", [3, 1, 0], 0.5, 6))
    rig = Rig(name="r", kind="point", modules=modules, home=[0, 1, 0])
    head = Body("head", [1.5, 1.25, 0], radius=0.1)
    torso = Body("torso", [-1, 0, 0], [-1, 1.5, 0], radius=0.2)
    found = body_distance(rig, [0, 1, 0], bodies=[torso, head])
    assert found.distance == pytest.approx(0.15, abs=1e-12)
    assert found.pair.tolist() == [1, 1]
    assert body_distance(rig, [0, 1, 0], bodies=[torso]).distance == pytest.approx(0.8, abs=1e-12)
    assert body_distances(rig, [0, 1, 0], bodies=[torso, head])[1] == pytest.approx([0.8, 0.15], abs=1e-12)
    # Entered: the cable of module 1 passes 0.05 m from the centre of the ball.
    entered = body_distance(rig, [-1, 1, 0], bodies=[Body("ball", [0, 1.05, 0], radius=0.1)])
    assert entered.distance == pytest.approx(-0.05, abs=0.01)
    swaying = body_distance(rig, [0, 1, 0], bodies=[torso, Body("head", [1.5, 1.25, 0], radius=0.1, sway=0.07)])
    assert swaying.distance == pytest.approx(0.08, abs=1e-12)
    assert body_distance(rig, [0, 1, 0]).distance == np.inf
    assert body_distance(rig, [0, 1, 0]).pair.tolist() == [-1, -1]


BOXES = {
    "beside a face": ([2, 0, 0], [2, 0.5, 0], 1.0),
    "over an edge": ([3, 3, 0], [3, 3, 0.1], np.sqrt(8)),
    "across a corner": ([2, 1.5, 1], [1.5, 2, 1], np.sqrt(2) * 0.75),
    "through it": ([-3, 0.2, 0.3], [3, 0.2, 0.3], 0.0),
    "within it": ([-0.1, 0.2, 0.3], [0.1, 0.2, 0.3], 0.0),
    "along a face": ([-3, 1, 0], [3, 1, 0], 0.0),
    "a point": ([0, 4, 5], [0, 4, 5], 5.0),
}


@pytest.mark.parametrize("case", BOXES.values(), ids=BOXES)
def test_known_distances_from_a_cube_of_two_metres(case):
    start, end, expected = case
    for ends in ([start, end], [end, start]):
        assert box_distance(ends, np.ones(3)) == pytest.approx(expected, abs=1e-12)


@settings(max_examples=many(200))
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.sampled_from([1.0, 1e-9, 0.0]))
def test_distances_from_boxes_agree_with_bounded_least_squares(seed, d, along):
    """The nearest points minimise |a + s u - q| over shares 0 <= s <= 1 and the points q of the box."""
    rng = np.random.default_rng(seed)
    a, half = rng.normal(size=d), rng.uniform(0.1, 1.0, d)
    u = rng.normal(size=d) * np.where(rng.random(d) < 0.5, along, 1.0)
    found = box_distance([a, a + u], half)
    bounds = (np.array([0.0, *-half]), np.array([1.0, *half]))
    best = lsq_linear(np.column_stack([u, -np.eye(d)]), -a, bounds=bounds, method="bvls")
    assert found == pytest.approx(np.sqrt(2 * best.cost), abs=1e-7)
    assert (found == 0.0) <= (best.cost < 1e-14)


def test_bodies_follow_the_hand_and_their_frames():
    """A box held in front of the hand turns with it; a ball on a frame without modules is at rest unless moved."""
    cable = Module("m", [0, 3, 0], 0.0, 1.0, attachment=[0, 0.5, 0])
    rig = Rig("r", "platform", (cable,), home=[0, 0, 0])
    box = Body("box", [1, 0, 0], size=[0.2, 1.0, 0.4], frame="hand")
    assert body_distance(rig, [0, 0, 0], bodies=[box]).distance == pytest.approx(0.9)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x becomes y: the cable starts at x = -0.5
    turned = body_distance(rig, [0, 0, 0], quarter, bodies=[box]).distance
    along = np.linspace([-0.5, 0, 0], [0, 3, 0], 100_001)
    expected = np.linalg.norm(np.maximum(np.abs(along - [0, 1, 0]) - [0.5, 0.1, 0.2], 0.0), axis=1).min()
    assert turned == pytest.approx(expected, abs=1e-4)

    ball = Body("ball", [1.0, 0, 0], radius=0.1, frame="head")
    rig = Rig("r", "platform", (cable,), home=[0, 0, 0], bodies=(ball,), rest=(RestPose("head", [0.0, 1.0, 0.0]),))
    assert body_distance(rig, [0, 0, 0]).distance == pytest.approx(0.9)
    moved = body_distance(rig, [0, 0, 0], frames={"head": np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])})
    assert moved.distance == pytest.approx([0.9, 1.9])
    assert body_distance(rig, [0, 0, 0], frames={"head": ([2.0, 1, 0], quarter)}).distance == pytest.approx(1.9)
    with pytest.raises(RigError, match="no module or body is attached to the frame"):
        body_distance(rig, [0, 0, 0], frames={"hip": [0.0, 0.0, 0.0]})


MOVING = [kind for kind, each in KINDS.items() if each.has_position]


def furnished(kind, seed):
    """A rig of a kind with modules in the world and on a frame, and bodies of all shapes in all frames."""
    rng = np.random.default_rng(seed)
    d = KINDS[kind].dimension
    modules = tuple(
        Module(f"m{i}", rng.uniform(-2, 2, d), 0.0, 1.0, frame="hip" if i == 0 else "world",
               attachment=rng.uniform(-0.3, 0.3, d) if KINDS[kind].has_orientation else None)
        for i in range(4)
    )  # fmt: skip
    shapes = [{"radius": 0.15}, {"radius": 0.1, "end": rng.uniform(-1, 1, d)}, {"size": rng.uniform(0.1, 0.8, d)}]
    bodies = tuple(
        Body(f"{frame} {i}", rng.uniform(-1, 1, d), frame=frame, sway=sway, **shape)
        for i, (frame, sway) in enumerate([("world", 0.2), ("hand", 0.0), ("hip", 0.05), ("head", 0.1)])
        for shape in shapes[i % 2 :]
    )
    bodies = tuple(replace(body, name=str(number)) for number, body in enumerate(bodies))
    return Rig("r", kind, modules, home=np.zeros(d), bodies=bodies)


@pytest.mark.parametrize("kind", MOVING)
def test_no_body_comes_closer_than_is_said_within_its_sway(kind):
    """Many poses, with bodies that sway at random, and towards a cable: then they are as close as is said."""
    rng, count = np.random.default_rng(len(kind)), many(100_000) // len(MOVING)
    rig = furnished(kind, len(kind))
    d = rig.dimension
    position = rng.uniform(-1, 1, (count, d))
    nowhere, upright = np.zeros((count, d)), np.tile(np.eye(d), (count, 1, 1))
    turn = matrices(rng, count, d) if rig.n > d else upright
    frames = {name: (rng.uniform(-1, 1, (count, d)), matrices(rng, count, d)) for name in ("hip", "head")}

    def orientation(axes):
        return axes if d == 3 else np.arctan2(axes[:, 1, 0], axes[:, 0, 0])

    given = {name: (origin, orientation(axes)) for name, (origin, axes) in frames.items()}
    found = body_distances(rig, position, orientation(turn) if rig.n > d else None, given)
    everywhere = frames | {"hand": (position, turn), "world": (nowhere, upright)}
    swaying = rng.integers(found[0].size, size=count)  # pair of cable and body whose sway is tried
    for number, (i, j) in enumerate(np.ndindex(*found[0].shape)):
        module, body, said = rig.modules[i], rig.bodies[j], found[:, i, j]
        origin, axes = everywhere[module.frame]
        starts = origin + np.einsum("nij,j->ni", axes, module.anchor)
        ends = position + np.einsum("nij,j->ni", turn, module.attachment)
        origin, axes = everywhere[body.frame]
        still, direction = search(starts, ends, body, origin, axes)
        np.testing.assert_allclose(said, still - body.sway, atol=1e-6)
        own = swaying == number
        starts, ends, axes, origin = starts[own], ends[own], axes[own], origin[own]
        shift = within_ball(rng, own.sum(), d, body.sway)
        assert (search(starts, ends, body, origin + shift, axes)[0] >= said[own] - 1e-6).all()
        nearest = search(starts, ends, body, origin + body.sway * direction[own], axes)[0]
        apart = still[own] + body.radius > body.sway
        np.testing.assert_allclose(nearest[apart], said[own][apart], atol=1e-6)
