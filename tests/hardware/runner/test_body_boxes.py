"""Distances of cables from bodies at one pose after another, against those of the workspace."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.hardware.runner.body_boxes import BodyBoxes


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
def test_distances_are_those_of_the_workspace_and_of_the_gap(name):
    random, plain = np.random.default_rng(3), tl.load_rig(name)
    d, turns = plain.dimension, plain.n > plain.dimension
    rig = replace(plain, bodies=bodies(random, d, ("world", "hand", "seat", *plain.frames)))
    boxes = BodyBoxes(rig)
    for _ in range(50):
        position, angles = rig.home + random.uniform(-0.2, 0.2, d), random.uniform(-1.0, 1.0, (2, 3))
        matrix, turned = Rotation.from_rotvec(angles).as_matrix()
        rotation = None if not turns else angles[0, 0] if d == 2 else matrix
        turn = angles[1, 0] if d == 2 else turned
        frames = {name: (random.uniform(-0.3, 0.3, d), turn) for name in ("seat", *rig.frames)}
        found, nearest, least = boxes.measure(
            rig.structure_matrix(position, rotation, frames), position, rotation, frames
        )
        # Cables over pulleys end within the pulleys' radius of where they do in the workspace.
        slack = 0.0 if rig.pulleys is None else rig.pulleys[0].max()
        expected = tl.workspace.body_distances(rig, position, rotation, frames)
        np.testing.assert_allclose(found, expected, atol=1e-9 + slack)
        np.testing.assert_array_equal(nearest, found.min(axis=1))
        assert least == (found - [body.margin for body in rig.bodies]).min()
        module, body = np.unravel_index(found.argmax(), found.shape)
        length = np.linalg.norm(np.diff(boxes.gap(module, body)[0], axis=0))
        assert length == pytest.approx(found[module, body] + rig.bodies[body].sway, abs=1e-2)


def test_a_cable_in_a_body_is_as_deep_in_it_as_its_radius():
    rig = tl.load_rig("floor-3")
    middle = (rig.home + rig.anchors[0]) / 2
    inside = tl.Body("ball", middle, radius=0.2), tl.Body("box", middle, size=[0.2, 0.3, 0.4])
    boxes = BodyBoxes(replace(rig, bodies=inside))
    distances = boxes.measure(rig.structure_matrix(rig.home), rig.home).distances
    np.testing.assert_allclose(distances[0], [-0.2, 0.0], atol=1e-12)
