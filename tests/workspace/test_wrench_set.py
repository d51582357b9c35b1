import numpy as np
import pytest
from hypothesis import given

import tensionlab as tl
from tensionlab.workspace import capacity_margin, half_spaces, vertices
from tests.helpers.problems import cases, random_structure
from tests.helpers.reference_metrics import corners

CROSS = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])


def test_a_square():
    found = half_spaces(CROSS, (0.0, 2.0))
    assert found.normals.shape[-1] == 2
    sides = {tuple(np.round(np.append(n, d), 12) + 0.0) for n, d in zip(*found, strict=True)}
    assert sides == {(1, 0, 2), (-1, 0, 2), (0, 1, 2), (0, -1, 2)}
    found = vertices(CROSS, (0.0, 2.0))
    assert {tuple(np.round(each, 12) + 0.0) for each in found} == {(2, 2), (-2, 2), (-2, -2), (2, -2)}
    after = np.roll(found, -1, axis=0)  # they are in order if they enclose the area of the square
    assert (found[:, 0] * after[:, 1] - found[:, 1] * after[:, 0]).sum() / 2 == pytest.approx(16)


@given(cases(largest=7))
def test_planes_and_vertices_are_those_of_the_image_of_the_box(case):
    normals, offsets = half_spaces(case.structure, case.limits)
    images = corners(*case.limits) @ case.structure.T
    size = 1e-7 * max(1.0, np.abs(images).max())
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-12)
    np.testing.assert_allclose((images @ normals.T).max(axis=0), offsets, rtol=0, atol=size)
    found = vertices(case.structure, case.limits)
    assert np.all(found @ normals.T <= offsets + size)
    # Every vertex is an image of a corner, and none is missing: both sets reach as far in every direction.
    assert np.abs(found[:, None] - images).max(axis=-1).min(axis=1).max() < size
    directions = np.random.default_rng(0).normal(size=(50, len(case.wrench)))
    np.testing.assert_allclose(
        (found @ directions.T).max(axis=0), (images @ directions.T).max(axis=0), rtol=0, atol=10 * size
    )


@pytest.mark.parametrize(("n", "m"), [(1, 4), (2, 5), (3, 4), (3, 8), (6, 6), (6, 8)])
def test_nothing_but_the_set_is_inside_all_half_spaces(n, m):
    rng = np.random.default_rng(m)
    W = np.stack([random_structure(rng, max(n, 2), m)[:n] for _ in range(10)])
    limits = (rng.uniform(0.0, 1.0, (10, m)), rng.uniform(2.0, 6.0, (10, m)))
    wrench = 5.0 * rng.normal(size=(10, 1, n))
    normals, offsets = half_spaces(W, limits)
    room = (offsets - (normals @ np.swapaxes(wrench, 1, 2))[..., 0]).min(axis=-1)
    np.testing.assert_allclose(room, capacity_margin(W, limits, wrench), rtol=0, atol=1e-12)


def test_a_flat_set_may_have_more_facets_than_others():
    # All attachments on one axis: no torque about it. 70 choices of 4 of 8 cables, and the plane; else 56 of 5.
    rng = np.random.default_rng(1)
    W = np.stack([random_structure(rng, 6, 8), random_structure(rng, 6, 8)])
    W[1, 5] = 0.0
    normals, offsets = half_spaces(W, (0.5, 6.0))
    assert normals.shape == (2, 2 * (70 + 1), 6)
    wrench = rng.uniform(0.5, 8.0, (20, 8)) @ W.swapaxes(1, 2)
    room = (offsets[:, None] - wrench @ normals.swapaxes(1, 2)).min(axis=-1)
    expected = capacity_margin(W[:, None], (0.5, 6.0), wrench[:, :, None])
    np.testing.assert_allclose(room, expected, rtol=0, atol=1e-9)
    assert np.all(room[1] <= 0)


def test_no_pose_and_several():
    found = half_spaces(np.zeros((0, 3, 5)), (0.0, 1.0))
    assert found.normals.shape[0] == 0
    with pytest.raises(tl.errors.ShapeError, match=r"vertices are those of one pose; .* \(2,\)"):
        vertices(np.zeros((2, 3, 5)), (0.0, 1.0))
