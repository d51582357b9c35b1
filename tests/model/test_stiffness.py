"""Stiffness: finite differences of equilibria, and springs and pendulums whose numbers are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.errors import InputError, RigError, ShapeError
from tensionlab.model import kinematics

G = 9.81
STIFFNESS = 2e4  # EA of most cables here, in N


def elastic(rig, stiffness=STIFFNESS, **platform):
    """The rig with cables of a stiffness, and with another platform."""
    modules = tuple(replace(module, cable_stiffness=stiffness) for module in rig.modules)
    return replace(rig, modules=modules, **platform)


def with_pulleys(rig, radius, seed=0):
    """The rig with swivelling pulleys at every second module, about axes at 60 to 120 degrees to the cables."""
    rng = np.random.default_rng(seed)
    directions = rig.cables(rig.home, frames=rig.at_rest).directions
    side = rng.normal(size=directions.shape)
    side -= (side * directions).sum(axis=1, keepdims=True) * directions
    axes = side / np.linalg.norm(side, axis=1, keepdims=True) + rng.uniform(-0.5, 0.5, (rig.m, 1)) * directions
    modules = [
        replace(module, pulley_radius=radius, pulley_axis=axis) if number % 2 == 0 else module
        for number, (module, axis) in enumerate(zip(rig.modules, axes, strict=True))
    ]
    return replace(rig, modules=tuple(modules))


def moved(rig, position, rotation, twist):
    """Poses of a rig after small twists (B, n)."""
    moves = rig.dimension if rig.has_position else 0
    return position + twist[:, :moves] if moves else position, turned(rig, rotation, twist[:, moves:])


def turned(rig, rotation, vectors):
    """Orientations of a rig after small turns (B, k) in world axes."""
    if rig.home_orientation is None:
        return None
    return rotation + vectors[:, 0] if rig.dimension == 2 else kinematics.exponential(vectors) @ rotation


def weight(rig, rotation, count):
    """Wrench (B, n) of gravity on the platform, where the rig requires it to be held."""
    return rig.gravity(rotation) if rig.required.gravity else np.zeros((count, rig.n))


def equilibria(rig, position, rotation, tensions, load):
    """The twists (B, n) from poses to those where elastic cables balance an additional load (B, n).

    The unstretched lengths are those that have the tensions at the poses, where a constant wrench balances them.
    Newton's method, by differences of the forces.
    """
    B = len(position)
    unstretched = rig.lengths(position, rotation)
    unstretched = unstretched / (1.0 + tensions / STIFFNESS)

    def exerted(twist):
        at, turn = moved(rig, position, rotation, twist)
        pulls = STIFFNESS * (rig.lengths(at, turn) / unstretched - 1.0)
        return np.einsum("bnm,bm->bn", rig.structure_matrix(at, turn), pulls) + weight(rig, turn, B)

    balance = exerted(np.zeros((B, rig.n)))

    def jacobian(twist, step=1e-6):
        moves = step * np.eye(rig.n)
        return np.stack([(exerted(twist + e) - exerted(twist - e)) / (2 * step) for e in moves], axis=-1)

    twist = np.zeros((B, rig.n))
    for _ in range(20):
        missing = exerted(twist) - balance + load
        change = np.linalg.solve(jacobian(twist), missing[..., None])[..., 0]
        twist = twist - change
        if np.abs(change).max() < 1e-14:
            break
    return twist


def poses(rig, count, rng, reach, turn):
    """Positions and orientations about those at home."""
    position = rig.home + rig.has_position * rng.uniform(-reach, reach, (count, rig.dimension))
    rotation = np.zeros(count) if rig.dimension == 2 else np.broadcast_to(np.eye(3), (count, 3, 3))
    return position, turned(rig, rotation, rng.uniform(-turn, turn, (count, 2 * rig.dimension - 3)))


CASES = {
    "point": (lambda: tl.load_rig("bartels2026-validation"), 0.3),
    "point over pulleys": (lambda: with_pulleys(tl.load_rig("seven-modules"), 0.04), 0.3),
    "planar": (lambda: tl.load_rig("kntu-planar"), 0.3),
    "planar over pulleys": (lambda: with_pulleys(tl.load_rig("kntu-planar"), 0.05), 0.3),
    "suspended": (lambda: tl.load_rig("cogiro"), 1.0),
    "platform over pulleys": (lambda: with_pulleys(tl.load_rig("ipanema-1"), 0.08), 0.4),
    "spherical": (lambda: replace(tl.load_rig("cogiro"), kind="spherical"), 0.0),
}


@pytest.mark.parametrize("name", CASES)
def test_it_is_what_equilibria_show(name):
    make, reach = CASES[name]
    rig, rng, count = elastic(make()), np.random.default_rng(5), 170
    position, rotation = poses(rig, count, rng, reach, 0.3)
    tensions = rng.uniform(0.0, 400.0, (count, rig.m))
    stiffness = tl.stiffness_matrix(rig, tensions, position, rotation)
    lengths = np.where(np.arange(rig.n) < rig.dimension * rig.has_position, 1.0, rig.characteristic_length)
    for component in range(rig.n):
        step = 1e-3 / lengths[component]
        load = step * stiffness[..., component]  # moves the platform along that component, by about the step
        at = [equilibria(rig, position, rotation, tensions, share * load) for share in (-2, -1, 1, 2)]
        found = lengths * (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / 12 / 1e-3
        assert np.abs(found - np.eye(rig.n)[component]).max() < 1e-6


def hung(attachments, anchors, mass, **platform):
    """A body in space on cables, without other loads than its weight; z is up."""
    modules = [
        tl.Module(f"cable-{i}", anchor, 0.0, 1e3, attachment=attachment, cable_stiffness=1e9)
        for i, (anchor, attachment) in enumerate(zip(anchors, attachments, strict=True))
    ]
    held = tl.Platform(mass, **platform)
    return tl.Rig(
        "hung", "platform", modules, [0.0, 0.0, 0.0], held, up="z", required=tl.Requirement(gravity=True)
    )


def test_a_spring_has_its_stiffness_along_it_and_that_of_its_tension_across():
    rig = elastic(tl.Rig("cord", "point", [tl.Module("cord", [0.0, 0.0, 2.0], 0.0, 50.0)], [0.0, 0.0, 0.0]))
    expected = np.diag([30.0 / 2.0, 30.0 / 2.0, (STIFFNESS + 30.0) / 2.0])
    np.testing.assert_allclose(tl.stiffness_matrix(rig, [30.0], rig.home), expected)
    np.testing.assert_allclose(tl.stiffness_eigenvalues(rig, expected), np.diag(expected))
    with_mass = replace(rig, platform=tl.Platform(30.0 / G))
    pendulum, spring = np.sqrt(G / 2.0) / (2 * np.pi), np.sqrt((STIFFNESS + 30.0) / 2.0 * G / 30.0) / (2 * np.pi)
    np.testing.assert_allclose(tl.natural_frequencies(with_mass, expected), [pendulum, pendulum, spring])


def test_a_body_that_hangs_by_a_point_swings_as_a_compound_pendulum():
    anchors = [[1.0, 0.0, 1.0], [-0.5, 0.8, 1.0], [-0.5, -0.8, 1.0]]
    inertia = np.diag([0.02, 0.03, 0.01])
    rig = hung(np.zeros((3, 3)), anchors, 2.0, com=[0.0, 0.0, -0.2], inertia=inertia)
    tensions = rig.allocate(np.zeros(6), solver="least-sum").tensions
    stiffness = tl.stiffness_matrix(rig, tensions, rig.home)
    swings = np.sqrt(2.0 * G * 0.2 / (np.diag(inertia)[:2] + 2.0 * 0.2**2)) / (2 * np.pi)
    found = tl.natural_frequencies(rig, stiffness)
    np.testing.assert_allclose(found[:3], [0.0, *sorted(swings)], rtol=1e-6, atol=1e-6)
    upside_down = Rotation.from_euler("x", np.pi).as_matrix()
    stiffness = tl.stiffness_matrix(rig, tensions, rig.home, upside_down)
    assert tl.stiffness_eigenvalues(rig, stiffness)[0] == pytest.approx(-2.0 * G * 0.2)
    np.testing.assert_allclose(tl.natural_frequencies(rig, stiffness, upside_down)[:3], 0.0, atol=1e-3)


def test_it_is_symmetric_where_cables_hold_the_weight_and_else_by_half_the_missing_torque():
    rig, rng = elastic(tl.load_rig("cogiro")), np.random.default_rng(2)
    position, rotation = poses(rig, 50, rng, 0.5, 0.1)
    tensions = rig.allocate(np.zeros(6), position, rotation).tensions
    stiffness = tl.stiffness_matrix(rig, tensions, position, rotation)
    np.testing.assert_allclose(stiffness, np.swapaxes(stiffness, -1, -2), atol=1e-6)
    tensions = rng.uniform(0.0, 1000.0, (50, rig.m))
    stiffness = tl.stiffness_matrix(rig, tensions, position, rotation)
    W = rig.structure_matrix(position, rotation)
    torque = (np.einsum("bnm,bm->bn", W, tensions) + rig.gravity(rotation))[:, 3:]
    expected = np.zeros((50, 6, 6))
    expected[:, 3:, 3:] = np.cross(np.eye(3), torque[:, None] / 2)  # the columns of [torque]x / 2, as rows
    np.testing.assert_allclose((stiffness - np.swapaxes(stiffness, -1, -2)) / 2, expected, atol=1e-6)


def test_frames_and_leading_axes_broadcast():
    rig = elastic(tl.load_rig("body-mounted"))
    frames = {name: ([0.0, 0.9, 0.1], np.eye(3)) for name in rig.frames}
    tensions = np.linspace(1.0, 5.0, 4 * rig.m).reshape(4, 1, rig.m)
    positions = rig.home + np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
    stiffness = tl.stiffness_matrix(rig, tensions, positions, frames=frames)
    assert stiffness.shape == (4, 3, 3, 3)
    np.testing.assert_allclose(
        stiffness[2, 1], tl.stiffness_matrix(rig, tensions[2, 0], positions[1], frames=frames)
    )


def test_what_is_missing_or_wrong_is_named():
    rig = tl.load_rig("kntu-planar")
    some = replace(rig, modules=(replace(rig.modules[0], cable_stiffness=1e4), *rig.modules[1:]))
    with pytest.raises(RigError, match=f'module "{rig.modules[1].name}": key "cable_stiffness" is missing'):
        tl.stiffness_matrix(some, np.ones(4), rig.home)
    with pytest.raises(InputError, match=r"tensions\[2\] is below zero"):
        tl.stiffness_matrix(elastic(rig), [1.0, 1.0, -1.0, 1.0], rig.home)
    with pytest.raises(ShapeError, match="tensions has shape"):
        tl.stiffness_matrix(elastic(rig), [1.0, 1.0], rig.home)
    with pytest.raises(ShapeError, match=r"needs \(\.\.\., 3, 3\)"):
        tl.stiffness_eigenvalues(rig, np.eye(2))
    with pytest.raises(RigError, match=r"\[platform\] is missing"):
        tl.natural_frequencies(tl.load_rig("spidar-g6x4"), np.eye(6))
    with pytest.raises(RigError, match='"inertia" is missing'):
        tl.natural_frequencies(replace(rig, platform=tl.Platform(5.0)), np.eye(3))
