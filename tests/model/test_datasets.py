"""What the rigs in datasets/rigs can do, as the sources and the design say."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from tensionlab.model.files import load_rig, rig_from_toml

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
STANCE = {"shoulder": ([-0.2, 1.4, 0.0], None), "hip": ([-0.15, 0.95, 0.0], None)}
CLOSED = {
    "bartels2026-validation": 4,
    "bartels2026-validation-0.3m": 4,
    "body-mounted": 5,
    "cube-8": 8,
    "ipanema-1": 8,
    "ipanema-2": 8,
    "kntu-planar": 4,
    "seven-modules": 7,
    "spidar-4wire": 4,
    "spidar-big": 4,
    "spidar-g6x4": 8,
    "tetra-4": 4,
}
OPEN = {"floor-3": 3, "cogiro": 8, "caroca": 8, "fast": 6}


def home_matrix(name):
    rig = load_rig(RIGS / f"{name}.toml")
    return rig, rig.structure_matrix(rig.home, frames=STANCE if rig.frames else None)


def closes(W):
    """Whether some tensions, all of 1 N or more, cancel out."""
    return linprog(
        np.zeros(W.shape[1]), A_eq=W, b_eq=np.zeros(W.shape[0]), bounds=[(1, None)] * W.shape[1]
    ).success


def test_every_file_is_judged_here():
    assert {path.stem for path in RIGS.glob("*.toml")} == {*CLOSED, *OPEN}


def test_the_example_of_the_format_is_a_rig():
    text = (RIGS.parent / "README.md").read_text(encoding="utf-8")
    rig = rig_from_toml(text.split("```toml\n")[1].split("```")[0], source="README.md")
    assert rig.limits.upper.tolist() == [3.0]


@pytest.mark.parametrize(("name", "m"), CLOSED.items())
def test_wrench_closure_at_home(name, m):
    rig, W = home_matrix(name)
    assert rig.m == m
    assert np.linalg.matrix_rank(W) == rig.n
    assert closes(W)


@pytest.mark.parametrize(("name", "m"), OPEN.items())
def test_rigs_that_need_gravity_or_cannot_pull_up(name, m):
    rig, W = home_matrix(name)
    assert rig.m == m
    assert not closes(W)


def test_cogiro_carries_its_own_weight_at_home():
    rig, W = home_matrix("cogiro")
    weight = rig.platform.mass * 9.81
    x, y, _ = rig.platform.com
    carry = np.array([0.0, 0.0, weight, y * weight, -x * weight, 0.0])
    assert lsq_linear(W, carry, (rig.limits.lower, rig.limits.upper)).cost < 1e-12 * weight


def grid18():
    """182 directions: rings every 18 degrees about the Y axis, and its two poles."""
    theta, phi = np.meshgrid(np.deg2rad(np.arange(18, 180, 18)), np.deg2rad(np.arange(0, 360, 18)))
    rings = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    return np.concatenate([rings.reshape(-1, 3), [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])


@pytest.mark.parametrize(
    ("name", "exact", "largest"),
    [("bartels2026-validation", 182, 0.0), ("bartels2026-validation-0.3m", 153, 0.20), ("floor-3", 22, None)],
)
def test_forces_in_reach_of_the_published_rig(name, exact, largest):
    """How many of 182 forces of 1.5 N are exact, and how far off the worst is: bounded least squares."""
    rig, W = home_matrix(name)
    limits = rig.limits.lower, rig.limits.upper
    residual = np.array(
        [np.linalg.norm(lsq_linear(W, 1.5 * u, limits, method="bvls", tol=1e-14).fun) for u in grid18()]
    )
    assert residual.size == 182
    assert np.count_nonzero(residual < 1e-9) == exact
    if largest is not None:
        assert residual.max() == pytest.approx(largest, abs=0.005)


def test_the_top_module_is_two_metres_above_the_sensor():
    rig, _ = home_matrix("bartels2026-validation")
    np.testing.assert_allclose(rig.lengths(rig.home)[3], 2.0)
    np.testing.assert_allclose(rig.home[1] - rig.anchors[:3, 1], 0.3)
    assert {(m.lower, m.upper, m.brake, m.newton_per_ampere, m.spool_radius) for m in rig.modules} == {
        (0.5, 6.0, 186.0, 3.0, 0.0195)
    }


@pytest.mark.parametrize(
    ("name", "box"),
    [
        ("spidar-g6x4", [0.138, 0.190, 0.138]),
        ("spidar-4wire", [0.12, 0.14, 0.12]),
        ("spidar-big", [0.625, 0.54, 0.55]),
        ("cube-8", [1.0, 1.0, 1.0]),
        ("tetra-4", [1.0, 1.0, 1.0]),
    ],
)
def test_anchors_stand_at_corners_of_the_published_box(name, box):
    rig, _ = home_matrix(name)
    np.testing.assert_allclose(np.abs(rig.anchors), np.broadcast_to(np.array(box) / 2, rig.anchors.shape))
    assert len(np.unique(rig.anchors, axis=0)) == rig.m


def test_the_wires_of_the_grip_end_on_the_tips_of_a_cross():
    rig, _ = home_matrix("spidar-g6x4")
    tips, count = np.unique(rig.attachments, axis=0, return_counts=True)
    expected = [[-0.0225, 0, 0], [0, -0.0225, 0], [0, 0.0225, 0], [0.0225, 0, 0]]
    np.testing.assert_allclose(tips, expected)
    assert count.tolist() == [2, 2, 2, 2]


def test_worn_anchors_move_with_the_body():
    """When the person turns, the worn anchors go along and the others stay."""
    rig, before = home_matrix("body-mounted")
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    moved = {name: (turn @ position, turn) for name, (position, _) in STANCE.items()}
    after = rig.structure_matrix(rig.home, frames=moved)
    np.testing.assert_array_equal(after[:, :3], before[:, :3])
    # Seen from the body, the hand has moved the other way instead.
    seen = rig.cables(turn.T @ rig.home, frames=STANCE).directions[3:] @ turn.T
    np.testing.assert_allclose(after[:, 3:], seen.T, atol=1e-12)
