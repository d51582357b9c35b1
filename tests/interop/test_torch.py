"""Gradients through the allocation in PyTorch, where it is installed."""

import numpy as np
import pytest

import tensionlab as tl
from tests.helpers.problems import random_cases

torch = pytest.importorskip("torch")
from tensionlab.torch import allocate  # noqa: E402 - after the library that it needs


def tensors(count=20):
    cases = random_cases(5, 3, 6, count)
    given = (cases.structure, cases.wrench, cases.lower, cases.upper, cases.reference)
    return cases, [torch.tensor(each, requires_grad=True) for each in given]


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_tensions_and_gradients_are_those_of_the_jacobian(policy):
    cases, (W, w, lower, upper, reference) = tensors()
    options = {"policy": policy, "wrench_weights": cases.weights}
    found = allocate(W, w, (lower, upper), reference, **options)
    jacobian = tl.allocation_jacobian(*(each.detach().numpy() for each in (W, w)), cases.limits,
                                      reference=cases.reference, **options)  # fmt: skip
    np.testing.assert_array_equal(found.detach(), jacobian.allocation.tensions)
    cotangent = np.random.default_rng(0).normal(size=found.shape)
    found.backward(torch.tensor(cotangent))
    for tensor, expected in zip((W, w, lower, upper, reference), jacobian.pull_back(cotangent), strict=True):
        np.testing.assert_array_equal(tensor.grad, expected)


def test_gradients_are_those_of_differences():
    _, given = tensors(4)
    assert torch.autograd.gradcheck(lambda W, w, low, up, near: allocate(W, w, (low, up), near), given, eps=1e-6)


def test_arguments_that_are_shared_collect_the_gradients_of_all_rows():
    W = torch.tensor([[1.0, -1.0]], requires_grad=True)
    limits = torch.tensor(1.0, requires_grad=True), torch.tensor([5.0, 5.0], requires_grad=True)
    found = allocate(W, torch.tensor([[2.0], [3.0], [7.0]]), limits)
    assert found.dtype == torch.float32
    found.sum().backward()
    assert (limits[0].grad.shape, limits[1].grad.shape, W.grad.shape) == ((), (2,), (1, 2))
    # Both cables move with the lower limit where the wrench is rendered, the second alone where it is not.
    assert limits[0].grad == pytest.approx(2 + 2 + 1)
    assert limits[1].grad.tolist() == [1.0, 0.0]


def test_a_rig_and_a_word_do():
    rig = tl.load_rig("bartels2026-validation")
    wrench = torch.tensor([1.0, 0.5, 1.0], requires_grad=True)
    found = allocate(torch.tensor(rig.structure_matrix(rig.home)), wrench, rig.limits, "middle")
    found.sum().backward()
    expected = tl.allocation_jacobian(
        rig.structure_matrix(rig.home), [1.0, 0.5, 1.0], rig.limits, reference="middle"
    )
    np.testing.assert_allclose(wrench.grad, expected.wrench.sum(axis=0), rtol=1e-6)
    with pytest.raises(tl.errors.InputError, match="'centre' is unknown"):
        allocate(torch.ones(1, 2), torch.ones(1), (0.0, 1.0), "centre")


def test_second_derivatives_are_refused():
    wrench = torch.tensor([2.0], requires_grad=True)
    found = allocate(torch.tensor([[1.0, -1.0]]), wrench, (1.0, 5.0))
    (gradient,) = torch.autograd.grad(found.square().sum(), wrench, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.backward()
