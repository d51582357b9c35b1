"""Forward kinematics inverts the lengths, for every kind of rig."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensionlab.errors import RigError, ShapeError
from tensionlab.model.files import load_rig
from tensionlab.model.module import Module
from tensionlab.model.rig import Rig

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
TABLE = Rig(
    name="table",
    kind="planar-point",
    modules=[
        Module(f"m{i}", corner, 0.5, 6.0)
        for i, corner in enumerate([[0.0, 0.0], [1.0, 0.0], [1.0, 0.8], [0.0, 0.8]])
    ],
    home=[0.5, 0.4],
)


def rig_of(name):
    return TABLE if name == "table" else load_rig(RIGS / f"{name}.toml")


@pytest.mark.parametrize("batch", [(), (0,), (40,), (3, 4)], ids=str)
@pytest.mark.parametrize(
    "name", ["table", "bartels2026-validation", "seven-modules", "kntu-planar", "ipanema-2", "cogiro"]
)
def test_the_pose_comes_back_from_the_lengths(name, batch):
    rig = rig_of(name)
    rng = np.random.default_rng(7)
    size = np.ptp(rig.anchors, axis=0).max() * 0.05
    position = rig.home + rng.uniform(-size, size, size=(*batch, rig.dimension))
    rotation = None
    if rig.kind == "planar":
        rotation = rng.uniform(-0.3, 0.3, size=batch)
    elif rig.kind == "platform":
        vectors = rng.uniform(-0.2, 0.2, size=(int(np.prod(batch)), 3))
        rotation = Rotation.from_rotvec(vectors).as_matrix().reshape(*batch, 3, 3)
    found = rig.forward_kinematics(rig.lengths(position, rotation))
    assert found.position.shape == position.shape
    assert found.residual.shape == found.iterations.shape == batch
    np.testing.assert_allclose(found.position, position, atol=1e-9)
    if rotation is None:
        assert found.rotation is None
    else:
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-9)
    assert np.all(found.residual < 1e-11)
    assert np.all(found.iterations < 20)


@pytest.mark.parametrize("name", ["bartels2026-validation", "kntu-planar", "ipanema-1"])
def test_a_far_guess_is_no_trouble_where_the_pose_is_unique(name):
    """Guesses up to two rig sizes outside the rig; undamped or unchecked steps diverge from many of them."""
    rig = rig_of(name)
    rng = np.random.default_rng(1)
    low, high = rig.anchors.min(axis=0), rig.anchors.max(axis=0)
    size = high - low
    position = rng.uniform(low + 0.2 * size, high - 0.2 * size, size=(300, rig.dimension))
    guess = rng.uniform(low - 2 * size, high + 2 * size, size=(300, rig.dimension))
    found = rig.forward_kinematics(rig.lengths(position), guess)
    np.testing.assert_allclose(found.position, position, atol=1e-7)


def test_anchors_that_move_with_a_body():
    rig = load_rig(RIGS / "body-mounted.toml")
    rng = np.random.default_rng(3)
    turns = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, size=(25, 3))).as_matrix()
    frames = {
        "shoulder": ([-0.2, 1.4, 0.0], turns),
        "hip": (rng.normal([-0.15, 0.95, 0.0], 0.05, size=(25, 3)), None),
    }
    position = rig.home + rng.uniform(-0.15, 0.15, size=(25, 3))
    found = rig.forward_kinematics(rig.lengths(position, frames=frames), frames=frames)
    np.testing.assert_allclose(found.position, position, atol=1e-9)


def test_guess_and_lengths_broadcast():
    rig = rig_of("table")
    position = np.array([[0.2, 0.3], [0.7, 0.5]])
    guesses = np.array([[0.5, 0.5], [0.3, 0.4], [0.6, 0.2]])
    found = rig.forward_kinematics(rig.lengths(position), guesses[:, None])
    np.testing.assert_allclose(found.position, np.broadcast_to(position, (3, 2, 2)), atol=1e-9)


def test_a_batch_is_the_same_as_one_by_one():
    rig = rig_of("ipanema-2")
    rng = np.random.default_rng(5)
    lengths = rig.lengths(rig.home + rng.uniform(-0.5, 0.5, size=(6, 3))) + rng.normal(0, 0.01, size=(6, 8))
    together = rig.forward_kinematics(lengths)
    for i in range(6):
        alone = rig.forward_kinematics(lengths[i])
        np.testing.assert_allclose(together.position[i], alone.position, atol=1e-12)
        np.testing.assert_allclose(together.rotation[i], alone.rotation, atol=1e-12)
        assert together.iterations[i] == alone.iterations


def test_noisy_lengths_give_the_least_squares_pose():
    """At the answer the gradient W (measured - modelled) vanishes, and the residual is what is left over."""
    rig = rig_of("ipanema-2")
    rng = np.random.default_rng(5)
    measured = rig.lengths(rig.home) + rng.normal(0, 0.01, size=8)
    found = rig.forward_kinematics(measured)
    error = measured - rig.lengths(found.position, found.rotation)
    np.testing.assert_allclose(rig.structure_matrix(found.position, found.rotation) @ error, 0.0, atol=1e-8)
    assert found.residual == pytest.approx(np.sqrt(np.mean(error**2)))
    assert 1e-4 < found.residual < 0.01


def test_impossible_lengths_show_in_the_residual():
    rig = rig_of("bartels2026-validation")
    assert rig.forward_kinematics([0.1, 0.1, 0.1, 1e-4]).residual > 0.1


def test_the_guess_chooses_between_mirror_images():
    """Anchors in one plane cannot tell the two sides of it apart."""
    rig = load_rig(RIGS / "floor-3.toml")
    above = np.array([0.05, 0.4, -0.1])
    below = above * [1, -1, 1]
    lengths = rig.lengths(above)
    np.testing.assert_allclose(lengths, rig.lengths(below))
    np.testing.assert_allclose(rig.forward_kinematics(lengths).position, above, atol=1e-9)
    np.testing.assert_allclose(rig.forward_kinematics(lengths, [0.0, -0.3, 0.0]).position, below, atol=1e-9)


def test_a_guess_on_an_anchor_is_no_trouble():
    rig = rig_of("table")
    position = np.array([0.3, 0.6])
    found = rig.forward_kinematics(rig.lengths(position), rig.anchors[0])
    np.testing.assert_allclose(found.position, position, atol=1e-9)


@pytest.mark.parametrize(
    ("lengths", "error", "words"),
    [
        ([1.0, 1.0, 1.0], ShapeError, "must hold 4 entries"),
        ([1.0, -1.0, 1.0, 1.0], ShapeError, r"lengths\[1\] is not positive"),
        ([1.0, 1.0, np.nan, 1.0], ShapeError, r"lengths\[2\] is nan"),
    ],
)
def test_bad_lengths_are_refused(lengths, error, words):
    with pytest.raises(error, match=words):
        TABLE.forward_kinematics(lengths)


def test_fewer_cables_than_unknowns_are_refused():
    rig = Rig(name="swing", kind="point", modules=[Module("a", [0.0, 2.0, 0.0], 0.5, 6.0)], home=[0.0, 0.0, 0.0])
    with pytest.raises(RigError, match='rig "swing": 1 cable lengths cannot fix 3 unknowns'):
        rig.forward_kinematics([1.0])


def test_shapes_that_do_not_broadcast_are_named():
    with pytest.raises(ShapeError, match=r"lengths \(3,\), position \(2,\)"):
        TABLE.forward_kinematics(np.ones((3, 4)), np.zeros((2, 2)))
