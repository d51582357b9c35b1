"""Gradients through the allocation in JAX and in PyTorch, each where it is installed."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.benchmark.problem_sets import problem_of, problem_set
from tests.helpers.problems import random_cases

NEARLY_EQUAL_FACES = Path(__file__).parents[1] / "data" / "nearly_equal_faces.json"


@pytest.fixture
def in_jax():
    jax = pytest.importorskip("jax")
    from tensionlab.jax import allocate

    def pulled_back(chosen, given, cotangent=1.0):
        found, pull_back = jax.vjp(jax.jit(chosen), *given)
        return np.asarray(found), pull_back(np.broadcast_to(cotangent, found.shape).astype(found.dtype))

    settings = {"jax_enable_x64": True, "jax_disable_most_optimizations": True}  # half the time of compilation
    before = {name: jax.config.read(name) for name in settings}
    for name, value in settings.items():
        jax.config.update(name, value)
    yield SimpleNamespace(jax=jax, allocate=allocate, array=jax.numpy.asarray, pulled_back=pulled_back)
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.fixture
def in_torch():
    torch = pytest.importorskip("torch")
    from tensionlab.torch import allocate

    def pulled_back(chosen, given, cotangent=1.0):
        given = [torch.tensor(each, requires_grad=True) for each in given]
        found = chosen(*given)
        found.backward(torch.as_tensor(np.broadcast_to(cotangent, found.shape).copy()).to(found.dtype))
        return found.detach().numpy(), [each.grad for each in given]

    return SimpleNamespace(torch=torch, allocate=allocate, array=torch.tensor, pulled_back=pulled_back)


@pytest.fixture(params=["in_jax", "in_torch"])
def library(request):
    """The allocation in a library, what makes its arrays, and values with their gradients to what was given."""
    return request.getfixturevalue(request.param)


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_tensions_and_gradients_are_those_of_the_jacobian(library, policy):
    cases = random_cases(5, 3, 6, 20)
    options = {"policy": policy, "wrench_weights": cases.weights}

    def chosen(W, w, lower, upper, reference):
        return library.allocate(W, w, (lower, upper), reference, **options)

    given = (cases.structure, cases.wrench, cases.lower, cases.upper, cases.reference)
    cotangent = np.random.default_rng(0).normal(size=cases.lower.shape)
    found, gradients = library.pulled_back(chosen, given, cotangent)
    jacobian = tl.allocation_jacobian(*given[:2], cases.limits, reference=cases.reference, **options)
    np.testing.assert_allclose(found, jacobian.allocation.tensions, rtol=1e-9)
    for gradient, expected in zip(gradients, jacobian.pull_back(cotangent), strict=True):
        np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_arguments_that_are_shared_collect_the_gradients_of_all_rows_and_types_stay(library, kind):
    wrench = library.array(np.array([[2.0], [3.0], [7.0]], kind))

    def chosen(W, lower, upper):
        return library.allocate(W, wrench, (lower, upper))

    given = [np.array(each, kind) for each in ([[1.0, -1.0]], 1.0, [5.0, 5.0])]
    found, gradients = library.pulled_back(chosen, given)
    assert found.dtype == kind
    assert [gradient.shape for gradient in gradients] == [(1, 2), (), (2,)]
    # Both cables move with the lower limit where the wrench is rendered, the second alone where it is not.
    assert float(gradients[1]) == pytest.approx(2 + 2 + 1)
    assert gradients[2].tolist() == [1.0, 0.0]


def test_a_rig_and_a_word_do(library):
    rig = tl.load_rig("bartels2026-validation")
    structure, wrench = rig.structure_matrix(rig.home), np.array([1.0, 0.5, 1.0])
    given = library.array(structure)
    found, (gradient,) = library.pulled_back(lambda w: library.allocate(given, w, rig.limits, "middle"), [wrench])
    expected = tl.allocation_jacobian(structure, wrench, rig.limits, reference="middle")
    np.testing.assert_allclose(found, expected.allocation.tensions, rtol=1e-12)
    np.testing.assert_allclose(gradient, expected.wrench.sum(axis=0), rtol=1e-6, atol=1e-12)
    with pytest.raises(tl.errors.InputError, match="'centre' is unknown"):
        library.allocate(given, library.array(wrench), rig.limits, "centre")


def test_what_jax_maps_over_problems_is_the_batch(in_jax):
    jax, cases = in_jax.jax, random_cases(6, 3, 5, 30)

    def effort(W, w):
        return (in_jax.allocate(W, w, (0.5, 6.0)) ** 2).sum()

    mapped = jax.jit(jax.vmap(jax.grad(effort, (0, 1))))(cases.structure, cases.wrench)
    whole = tl.allocation_jacobian(cases.structure, cases.wrench, (0.5, 6.0))
    for found, expected in zip(mapped, whole.pull_back(2.0 * whole.allocation.tensions), strict=False):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11)
    shared = jax.jit(jax.vmap(effort, (None, 0)))(cases.structure[0], cases.wrench)
    expected = tl.allocate(cases.structure[0], cases.wrench, (0.5, 6.0)).tensions
    np.testing.assert_allclose(shared, (expected**2).sum(axis=1), rtol=1e-12)


def test_forward_mode_of_jax_is_the_jacobian_and_second_derivatives_those_of_differences(in_jax):
    jax, cases = in_jax.jax, random_cases(7, 3, 6, 20)
    given = (cases.structure, cases.wrench, cases.lower, cases.upper, cases.reference)

    def chosen(W, w, lower, upper, reference):
        return in_jax.allocate(W, w, (lower, upper), reference)

    rng = np.random.default_rng(1)
    tangents = tuple(rng.normal(size=each.shape) for each in given)
    cotangent = rng.normal(size=cases.lower.shape)
    _, change = jax.jit(lambda *changes: jax.jvp(chosen, given, changes))(*tangents)
    jacobian = tl.allocation_jacobian(*given[:2], cases.limits, reference=cases.reference)
    expected = sum(
        (each * tangent).sum() for each, tangent in zip(jacobian.pull_back(cotangent), tangents, strict=True)
    )
    assert (change * cotangent).sum() == pytest.approx(expected, rel=1e-9)

    exact = jacobian.allocation.exact
    own = [np.stack([each[np.argmax(exact)], each[np.argmin(exact)]]) for each in given]

    def effort(both):
        return (chosen(both[:, :18].reshape(2, 3, 6), both[:, 18:], *own[2:]) ** 2).sum()

    def slope(both):
        found = tl.allocation_jacobian(
            both[:, :18].reshape(2, 3, 6), both[:, 18:], tuple(own[2:4]), reference=own[4]
        )
        structure, wrench, *_ = found.pull_back(2.0 * found.allocation.tensions)
        return np.concatenate([structure.reshape(2, 18), wrench], axis=1)

    place, step = np.concatenate([own[0].reshape(2, 18), own[1]], axis=1), 1e-5 * np.eye(21)
    differences = np.stack([slope(place + each) - slope(place - each) for each in step], axis=1) / 2e-5
    hessian = jax.jit(jax.hessian(effort))(place)  # of problems that know nothing of each other
    for k in range(2):
        np.testing.assert_allclose(hessian[k, :, k], differences[k], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["bartels2026-validation", "cogiro", "kntu-planar"])
def test_structure_matrices_of_jax_are_those_of_the_rig_and_follow_the_pose(in_jax, name):
    from tensionlab.jax import structure_matrix

    jax, rig, rng = in_jax.jax, tl.load_rig(name), np.random.default_rng(2)
    position, rotation = rig.home + 0.05 * rng.normal(size=(4, rig.dimension)), None
    if rig.platform is not None:
        turns = 0.2 * rng.normal(size=(4, 3))
        rotation = turns[:, 0] if rig.dimension == 2 else Rotation.from_rotvec(turns).as_matrix()
    found = jax.jit(lambda p: structure_matrix(rig, p, rotation))(position)
    np.testing.assert_allclose(found, rig.structure_matrix(position, rotation), atol=1e-12)
    moved = structure_matrix(rig, position, rotation, rig.anchors - [0.01] * rig.dimension, rig.attachments)
    np.testing.assert_allclose(moved, rig.structure_matrix(position + 0.01, rotation), atol=1e-12)


def test_jax_takes_no_pulleys(in_jax):
    from tensionlab.jax import structure_matrix

    with pytest.raises(tl.errors.InputError, match="pulleys and body frames are not for JAX"):
        structure_matrix(tl.load_rig("body-mounted"), [0.0, 0.0, 0.0])


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_jax_proves_the_tensions_of_the_exact_solver_on_all_sets_of_this_size(in_jax, policy):
    from tensionlab.jax import solve

    problems = [
        problem_of(group, policy)
        for name in ("edge", "unreachable", "near-singular", "mixed-limits", "trajectory")
        for group in problem_set(name, 500).groups
        if group.structure.shape[1:] == (3, 8)
    ]
    structure, wrench, *limits = (
        np.concatenate([getattr(problem, name) for problem in problems])
        for name in ("structure", "wrench", "lower", "upper")
    )
    found = solve(structure, wrench, tuple(limits), policy=policy)
    expected = tl.allocate(structure, wrench, tuple(limits), policy=policy).tensions
    assert found.optimal.all()
    np.testing.assert_allclose(found.tensions, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
def test_jax_proves_no_face_that_is_nearly_the_right_one(in_jax, policy):
    # Each was once proved on the wrong face, or not at all: 1 to 3 of 100,000 problems of a set.
    from tensionlab.jax import solve

    problems = json.loads(NEARLY_EQUAL_FACES.read_text(encoding="utf-8"))
    structure, wrench = np.zeros((len(problems), 6, 12)), np.zeros((len(problems), 6))
    lower, upper, expected = np.zeros((3, len(problems), 12))
    for k, problem in enumerate(problems):  # in one shape, with further cables whose limits are zero
        n, m = np.shape(problem["structure"])
        structure[k, :n, :m], wrench[k, :n] = problem["structure"], problem["wrench"]
        lower[k, :m], upper[k, :m] = problem["lower"], problem["upper"]
        given = structure[k, :n, :m], wrench[k, :n], (lower[k, :m], upper[k, :m])
        expected[k, :m] = tl.allocate(*given, policy=policy).tensions
    found = solve(structure, wrench, (lower, upper), policy=policy)
    assert found.optimal.all()
    np.testing.assert_allclose(found.tensions, expected, rtol=1e-9, atol=1e-9)


def test_what_has_no_answer_has_no_proof(in_jax):
    from tensionlab.jax import solve

    wrench = np.array([[1.0], [np.nan], [1.0]])
    lower = np.array([[0.0, 0.0], [0.0, 0.0], [2.0, 2.0]])
    assert solve(np.ones((1, 2)), wrench, (lower, 1.0)).optimal.tolist() == [True, False, False]
    with pytest.raises(tl.errors.InputError, match=r"do not fit together: structure \(1, 2\), wrench \(3,\)"):
        in_jax.allocate(np.ones((1, 2)), np.ones(3), (0.0, 1.0))
    with pytest.raises(tl.errors.InputError, match="policy 'forse' is unknown"):
        in_jax.allocate(np.ones((1, 2)), np.ones(1), (0.0, 1.0), policy="forse")


def test_second_derivatives_are_refused(in_torch):
    torch = in_torch.torch
    wrench = torch.tensor([2.0], requires_grad=True)
    found = in_torch.allocate(torch.tensor([[1.0, -1.0]]), wrench, (1.0, 5.0))
    (gradient,) = torch.autograd.grad(found.square().sum(), wrench, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.backward()


def test_gradients_are_those_of_differences(in_torch):
    cases = random_cases(5, 3, 6, 4)
    given = (cases.structure, cases.wrench, cases.lower, cases.upper, cases.reference)
    given = [in_torch.torch.tensor(each, requires_grad=True) for each in given]

    def chosen(W, w, lower, upper, reference):
        return in_torch.allocate(W, w, (lower, upper), reference)

    assert in_torch.torch.autograd.gradcheck(chosen, given, eps=1e-6)


def test_in_float32_nine_in_ten_are_proved_and_those_render_what_the_best_ones_do(in_jax):
    from tensionlab.jax import solve

    in_jax.jax.config.update("jax_enable_x64", False)
    rng = np.random.default_rng(8)
    structure, wrench = rng.normal(size=(500, 3, 6)), 5.0 * rng.normal(size=(500, 3))
    found = solve(structure, wrench, (0.5, 6.0))
    assert found.tensions.dtype == np.float32
    assert found.optimal.mean() > 0.9
    expected = tl.allocate(structure, wrench, (0.5, 6.0)).tensions
    gap = np.einsum("bnm,bm->bn", structure, found.tensions - expected)[np.asarray(found.optimal)]
    assert np.abs(gap).max() < 1e-3
