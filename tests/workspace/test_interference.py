"""Distances known by hand, from another optimiser, and from sampling; and what counts as touching."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from tensionlab.errors import InputError, ShapeError
from tensionlab.model.files import load_rig
from tensionlab.model.layouts import box_corners
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig
from tensionlab.workspace.interference import Capsule, body_distance, cable_distance, cable_pairs, closest
from tests.helpers.examples import many

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"


def segment_distance(*ends):
    return closest(np.reshape(ends, (2, 2, -1)), np.array([[0, 1]]), np.zeros(2)).distance


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
    head = Capsule([1.5, 1.25, 0], radius=0.1)
    torso = Capsule([-1, 0, 0], [-1, 1.5, 0], radius=0.2)
    found = body_distance(rig, [torso, head], [0, 1, 0])
    assert found.distance == pytest.approx(0.15, abs=1e-12)
    assert found.pair.tolist() == [1, 1]
    assert body_distance(rig, [torso], [0, 1, 0]).distance == pytest.approx(0.8, abs=1e-12)
    # Below the head's lowest point it is entered: at 1.2 m the cable passes 5 cm from the centre.
    entered = body_distance(rig, [Capsule([0, 1.05, 0], radius=0.1)], [-1, 1, 0])
    assert entered.distance == pytest.approx(-0.05, abs=0.01)
    assert body_distance(rig, [], [0, 1, 0]).distance == np.inf
    assert body_distance(rig, [], [0, 1, 0]).pair.tolist() == [-1, -1]


def test_a_body_that_is_none_is_refused():
    rig = box_corners([1, 1, 1])
    with pytest.raises(InputError, match="radius of body 1 is -1"):
        body_distance(rig, [Capsule([1, 1, 1]), Capsule([1, 1, 1], radius=-1)], [0, 0, 0])
    with pytest.raises(ShapeError, match="start of body 0"):
        body_distance(rig, [Capsule([1, 1])], [0, 0, 0])
    with pytest.raises(InputError, match="at most 64"):
        body_distance(rig, [Capsule([1, 1, 1])] * 60, [0, 0, 0])
