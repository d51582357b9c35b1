"""Gradients through the allocation in JAX, where it is installed."""

import numpy as np
import pytest

import tensionlab as tl
from tests.helpers.problems import random_cases

jax = pytest.importorskip("jax")
from tensionlab.jax import allocate  # noqa: E402 - after the library that it needs


@pytest.fixture(autouse=True)
def _in_float64():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_tensions_and_gradients_are_those_of_the_jacobian(policy):
    cases = random_cases(5, 3, 6, 20)
    options = {"policy": policy, "wrench_weights": cases.weights}

    @jax.jit
    def chosen(W, w, lower, upper, reference):
        return allocate(W, w, (lower, upper), reference, **options)

    given = (cases.structure, cases.wrench, cases.lower, cases.upper, cases.reference)
    found, pull_back = jax.vjp(chosen, *given)
    jacobian = tl.allocation_jacobian(
        cases.structure, cases.wrench, cases.limits, reference=cases.reference, **options
    )
    np.testing.assert_array_equal(found, jacobian.allocation.tensions)
    cotangent = np.random.default_rng(0).normal(size=found.shape)
    for gradient, expected in zip(pull_back(cotangent), jacobian.pull_back(cotangent), strict=True):
        np.testing.assert_array_equal(gradient, expected)


def test_what_is_mapped_over_problems_is_the_batch():
    cases = random_cases(6, 3, 5, 30)

    def effort(W, w):
        return (allocate(W, w, (0.5, 6.0)) ** 2).sum()

    single = [jax.grad(effort, (0, 1))(W, w) for W, w in zip(cases.structure, cases.wrench, strict=True)]
    mapped = jax.jit(jax.vmap(jax.grad(effort, (0, 1))))(cases.structure, cases.wrench)
    whole = jax.grad(effort, (0, 1))(cases.structure, cases.wrench)
    for k in range(2):
        np.testing.assert_array_equal(mapped[k], whole[k])
        np.testing.assert_array_equal(mapped[k], [each[k] for each in single])
    shared = jax.vmap(effort, (None, 0))(cases.structure[0], cases.wrench)
    expected = tl.allocate(cases.structure[0], cases.wrench, (0.5, 6.0)).tensions
    np.testing.assert_allclose(shared, (expected**2).sum(axis=1), rtol=1e-12)


def test_arguments_that_are_shared_collect_the_gradients_of_all_rows():
    def total(lower, upper):
        return allocate([[1.0, -1.0]], np.array([[2.0], [3.0], [7.0]]), (lower, upper)).sum()

    lower, upper = jax.grad(total, (0, 1))(1.0, np.array([5.0, 5.0]))
    # Both cables move with the lower limit where the wrench is rendered, the second alone where it is not.
    assert lower == pytest.approx(2 + 2 + 1)
    assert upper.tolist() == [1.0, 0.0]


def test_a_rig_and_a_word_do_and_types_stay():
    rig = tl.load_rig("bartels2026-validation")
    structure = np.asarray(rig.structure_matrix(rig.home), dtype=np.float32)
    expected = tl.allocate(structure, [1.0, 0.5, 1.0], rig.limits, reference="middle").tensions
    np.testing.assert_allclose(allocate(structure, [1.0, 0.5, 1.0], rig.limits, "middle"), expected, rtol=1e-12)
    with pytest.raises(tl.errors.InputError, match="'centre' is unknown"):
        allocate(structure, np.ones(3), rig.limits, "centre")
    jax.config.update("jax_enable_x64", False)
    assert allocate(structure, np.ones(3), rig.limits).dtype == np.float32


def test_large_batches_do_not_wait_for_themselves():
    rng = np.random.default_rng(7)
    structure, wrench = rng.normal(size=(20_000, 3, 8)), rng.normal(size=(20_000, 3))
    found = jax.jit(lambda w: allocate(structure, w, (0.5, 6.0)).sum())
    assert np.isfinite(jax.jit(jax.grad(found))(wrench)).all()
