"""The structure matrix is a derivative, and equals numbers found by others."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from tensionlab.model import kinematics
from tensionlab.model.files import load_rig
from tensionlab.model.module import KINDS, Module
from tensionlab.model.rig import Rig
from tests.helpers.examples import many

ROOT = Path(__file__).parents[2]
RIGS = ROOT / "datasets" / "rigs"
KNOWN = json.loads((ROOT / "tests/data/known_answers.json").read_text(encoding="utf-8"))["cases"]
GEOMETRIES = json.loads((ROOT / "tests/data/geometries.json").read_text(encoding="utf-8"))["robots"]
FREEDOMS = {"planar-point": 2, "point": 3, "planar": 3, "platform": 6}


@st.composite
def scenes(draw):
    """A rig of any kind with modules in the world and on a body, a pose of both, and a batch shape."""
    kind = draw(st.sampled_from(list(FREEDOMS)))
    m = draw(st.integers(1, 9))
    batch = draw(st.sampled_from([(), (3,), (2, 2)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    d, turns = KINDS[kind].dimension, KINDS[kind].has_orientation
    frames = ["world", *rng.choice(["world", "hip", "hand"], size=m - 1)]
    modules = [
        Module(
            name=f"m{i}",
            anchor=rng.normal(size=d) * 2,
            lower=0.5,
            upper=6.0,
            attachment=rng.normal(size=d) * 0.3 if turns else None,
            frame=str(frame),
        )
        for i, frame in enumerate(frames)
    ]
    rig = Rig(name="drawn", kind=kind, modules=modules, home=np.zeros(d))

    def orientations():
        if d == 2:
            return rng.uniform(-4, 4, size=batch)
        return Rotation.random(int(np.prod(batch)), rng=rng).as_matrix().reshape(*batch, 3, 3)

    poses = {name: (rng.normal(size=(*batch, d)), orientations()) for name in rig.frames}
    return rig, rng.normal(size=(*batch, d)), orientations() if turns else None, poses


def move(rig, position, rotation, twist):
    """A pose after a small twist, by matrix exponentials."""
    d = rig.dimension
    position = position + twist[:d]
    if rotation is None:
        return position, None
    if d == 2:
        return position, rotation + twist[2]
    x, y, z = twist[3:]
    return position, expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])) @ rotation


@settings(max_examples=many(150))
@given(scenes())
def test_structure_matrix_is_minus_the_derivative_of_the_lengths(scene):
    rig, position, rotation, frames = scene
    W = rig.structure_matrix(position, rotation, frames)
    assert W.shape == (*position.shape[:-1], FREEDOMS[rig.kind], rig.m)
    step = 1e-5
    for row in range(rig.n):
        twist = np.zeros(rig.n)
        twist[row] = step
        ahead = rig.lengths(*move(rig, position, rotation, twist), frames)
        behind = rig.lengths(*move(rig, position, rotation, -twist), frames)
        # The error of a central difference is of the order step² / length², plus rounding / step.
        shortest = rig.lengths(position, rotation, frames).min()
        tolerance = 1e-9 + 10 * (step / shortest) ** 2
        np.testing.assert_allclose(W[..., row, :], -(ahead - behind) / (2 * step), atol=tolerance)


@pytest.mark.parametrize(("d", "turns"), [(2, False), (2, True), (3, False), (3, True)])
def test_the_gradient_by_the_anchors_is_that_of_the_structure_matrix(d, turns):
    rng = np.random.default_rng(d)
    vectors, arms = rng.normal(size=(2, 4, 5, d))
    arms = arms if turns else None

    def matrix(vectors):
        return kinematics.structure_matrix(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), arms)

    gradient = rng.normal(size=matrix(vectors).shape)
    found, step = kinematics.anchor_gradient(gradient, vectors, arms), 1e-6
    for cable, axis in np.ndindex(5, d):
        moved = np.zeros_like(vectors)
        moved[:, cable, axis] = step
        change = (gradient * (matrix(vectors + moved) - matrix(vectors - moved))).sum(axis=(1, 2))
        np.testing.assert_allclose(found[:, cable, axis], change / (2 * step), atol=1e-6)


@settings(max_examples=many(50))
@given(scenes())
def test_directions_are_unit_vectors_that_lead_from_attachment_to_anchor(scene):
    rig, position, rotation, frames = scene
    u = rig.cables(position, rotation, frames).directions
    np.testing.assert_allclose(np.linalg.norm(u, axis=-1), 1.0, atol=1e-12)
    # The first module of every scene stands in the world.
    arm = rig.attachments[0]
    if rotation is not None and rig.dimension == 2:
        c, s = np.cos(rotation), np.sin(rotation)
        arm = np.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]], axis=-1)
    elif rotation is not None:
        arm = np.einsum("...ij,j->...i", rotation, arm)
    end = position + arm + u[..., 0, :] * rig.lengths(position, rotation, frames)[..., 0, None]
    np.testing.assert_allclose(end, np.broadcast_to(rig.anchors[0], end.shape), atol=1e-12)


@settings(max_examples=many(50))
@given(scenes())
def test_a_rigid_motion_of_everything_turns_forces_and_keeps_lengths(scene):
    """Move the world: a rig all of whose modules ride on one body, and the platform with them."""
    rig, position, rotation, _ = scene
    riders = tuple(
        Module(f"r{i}", module.anchor, 0.5, 6.0, attachment=module.attachment, frame="room")
        for i, module in enumerate(rig.modules)
    )
    room = Rig(name="room", kind=rig.kind, modules=riders, home=rig.home)
    d = rig.dimension
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7] if d == 2 else [0.3, -0.5, 0.7]).as_matrix()[:d, :d]
    shift = np.array([0.4, -1.0, 2.0])[:d]
    still = room.structure_matrix(position, rotation, {"room": (np.zeros(d), None)})
    moved = room.structure_matrix(
        position @ turn.T + shift,
        None if rotation is None else rotation + 0.7 if d == 2 else turn @ rotation,
        {"room": (shift, 0.7 if d == 2 else turn)},
    )
    np.testing.assert_allclose(moved[..., :d, :], turn @ still[..., :d, :], atol=1e-12)
    torque = still[..., d:, :]
    np.testing.assert_allclose(moved[..., d:, :], turn @ torque if d == 3 and torque.size else torque, atol=1e-12)


@pytest.mark.parametrize("case", KNOWN, ids=lambda case: case["name"])
def test_known_structure_matrices(case):
    attachments = case["platform"]
    modules = tuple(
        Module(
            name=f"cable-{i}",
            anchor=anchor,
            lower=case["fmin"][i],
            upper=case["fmax"][i],
            attachment=None if attachments is None else attachments[i],
        )
        for i, anchor in enumerate(case["anchors"])
    )
    kind = "point" if attachments is None else "platform"
    rig = Rig(name=case["name"], kind=kind, modules=modules, home=case["p"])
    W = rig.structure_matrix(case["p"], None if attachments is None else case["R"])
    np.testing.assert_allclose(W, case["W"], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "case"),
    [("cube-8", "cube8_center_fz2"), ("tetra-4", "tetra4_center_fx1")],
    ids=["cube-8", "tetra-4"],
)
def test_the_files_give_the_known_structure_matrices(name, case):
    rig = load_rig(RIGS / f"{name}.toml")
    known = next(entry for entry in KNOWN if entry["name"] == case)
    columns = {tuple(column) for column in np.round(np.transpose(known["W"]), 12)}
    assert {tuple(column) for column in np.round(rig.structure_matrix(rig.home).T, 12)} == columns
    assert rig.limits.lower.tolist() == known["fmin"]
    assert rig.limits.upper.tolist() == known["fmax"]


def test_ipanema_2_gives_the_known_structure_matrix():
    rig = load_rig(RIGS / "ipanema-2.toml")
    known = next(entry for entry in KNOWN if entry["name"] == "IPAnema2_static_10kg")
    np.testing.assert_allclose(rig.structure_matrix(known["p"], known["R"]), known["W"], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "robot"),
    [
        ("ipanema-1", "IPAnema_1"),
        ("ipanema-2", "IPAnema_2"),
        ("cogiro", "CoGiRo"),
        ("kntu-planar", "KNTU_planar"),
    ],
)
def test_published_geometries_cable_by_cable(name, robot):
    """Wrench of each cable built on its own, in space, with SciPy's rotation and numpy's cross product."""
    rig = load_rig(RIGS / f"{name}.toml")
    planar = rig.kind == "planar"
    yaw = 0.2
    R = Rotation.from_euler("xyz", [0.0, 0.0, yaw] if planar else [0.1, -0.15, yaw]).as_matrix()
    p = np.array([*rig.home, 0.0])[:3] + np.array([0.1, -0.2, 0.0 if planar else 0.15])
    wrenches = []
    for cable in GEOMETRIES[robot]["cable_sets"]["original"]:
        (_, anchor), (_, attachment) = cable["att"]
        r = R @ attachment
        v = np.array(anchor) - p - r
        u = v / np.linalg.norm(v)
        wrenches.append([*u, *np.cross(r, u)])
    expected = np.transpose(wrenches)
    W = rig.structure_matrix(p[:2], yaw) if planar else rig.structure_matrix(p, R)
    np.testing.assert_allclose(W, expected[[0, 1, 5]] if planar else expected, atol=1e-12)
    bodies = GEOMETRIES[robot]["bodies"][0]
    assert rig.platform is not None
    assert rig.platform.mass == float(bodies["mass"])


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 1.0, 3.0, np.pi, 7.0])
def test_exponential_is_the_matrix_exponential(angle):
    vector = angle * np.array([2.0, -1.0, 2.0]) / 3
    x, y, z = vector
    expected = expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
    np.testing.assert_allclose(kinematics.exponential(vector), expected, atol=1e-14)
    np.testing.assert_array_equal(
        kinematics.exponential(np.stack([vector, vector]))[1], kinematics.exponential(vector)
    )
