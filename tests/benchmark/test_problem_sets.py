"""Every set keeps its promise, as SciPy's linear programming sees it."""

import functools

import numpy as np
import pytest
from scipy.optimize import linprog

import tensionlab as tl
from tensionlab.benchmark import problem_sets
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, Group, largest_scale, problem_set
from tensionlab.benchmark.rigs import structures
from tensionlab.errors import InputError

COUNT = 240
SAMPLE = 8  # problems of each group that are checked one by one
every_set = pytest.mark.parametrize("name", PROBLEM_SETS)


@functools.cache
def generated(name, count=COUNT, seed=0):
    return problem_set(name, count, seed)


def sample(group, size=SAMPLE):
    """Some problems of a group, each as (W, w, lower, upper)."""
    limits = (np.broadcast_to(each, (len(group.wrench), each.shape[-1])) for each in (group.lower, group.upper))
    every = list(zip(group.structure, group.wrench, *limits, strict=True))
    return [every[i] for i in np.unique(np.linspace(0, len(every) - 1, size).astype(int))]


def least_error(W, w, lower, upper):
    """How closely, in the largest component, can the wrench be rendered? By linear programming."""
    n, m = W.shape
    rows = np.block([[W, -np.ones((n, 1))], [-W, -np.ones((n, 1))]])
    limits = [*zip(lower, upper, strict=True), (0.0, None)]
    found = linprog(np.append(np.zeros(m), 1.0), A_ub=rows, b_ub=np.concatenate([w, -w]), bounds=limits)
    assert found.success, found.message
    return found.x[-1]


def largest_factor(W, w, lower, upper):
    """The largest s with ``W t = s w`` inside the limits, by linear programming."""
    n, m = W.shape
    limits = [*zip(lower, upper, strict=True), (0.0, None)]
    matrix = np.column_stack([W, -w])
    found = linprog(np.append(np.zeros(m), -1.0), A_eq=matrix, b_eq=np.zeros(n), bounds=limits)
    assert found.success, found.message
    return found.x[-1]


@every_set
def test_a_set_holds_about_as_many_well_formed_problems_as_asked_for(name):
    found = generated(name)
    assert found.name == name
    assert len({group.label for group in found.groups}) == len(found.groups)
    for group in found.groups:
        size, n, m = group.structure.shape
        assert group.wrench.shape == (size, n)
        for limit in (group.lower, group.upper):
            assert limit.shape in ((m,), (size, m))
        assert np.all((group.lower >= 0.0) & (group.lower < group.upper))
        assert all(np.isfinite(each).all() for each in (group.structure, group.wrench, group.upper))
    total = sum(len(group.wrench) for group in found.groups)
    assert total == (364 if name == "published" else COUNT)


@every_set
def test_what_can_be_reached_is_what_the_set_promises(name):
    found = generated(name)
    for group in found.groups:
        errors = np.array([least_error(*each) for each in sample(group)])
        size = np.linalg.norm(group.wrench, axis=1).max()
        reached, missed = errors <= 1e-9 * size, errors >= 1e-4
        assert np.all(reached | missed)
        if found.reachable != "mixed":
            assert np.all(reached == (found.reachable == "all")), group.label


@every_set
def test_the_exact_solver_keeps_every_promise(name):
    found = generated(name)
    statuses = np.concatenate(
        [tl.allocate(g.structure, g.wrench, (g.lower, g.upper)).status for g in found.groups]
    )
    expected = {
        "all": {tl.Status.EXACT},
        "none": {tl.Status.NEAREST},
        "mixed": {tl.Status.EXACT, tl.Status.NEAREST},
    }
    assert set(statuses.tolist()) == expected[found.reachable]


@every_set
def test_the_seed_alone_decides(name):
    first, again, other = generated(name), problem_set(name, COUNT, 0), generated(name, seed=1)
    for a, b, c in zip(first.groups, again.groups, other.groups, strict=True):
        for field in ("structure", "wrench", "lower", "upper"):
            np.testing.assert_array_equal(getattr(a, field), getattr(b, field))
        assert np.array_equal(a.wrench, c.wrench) == (name == "published")


def test_edge_wrenches_are_within_one_per_cent_of_the_edge():
    margins = [1.0 - 1.0 / largest_factor(*each) for group in generated("edge").groups for each in sample(group)]
    assert min(margins) > 0.0
    assert max(margins) <= 0.01 + 1e-9
    assert np.quantile(margins, 0.5) < 2e-3


def test_unreachable_wrenches_are_a_little_to_far_too_large():
    for group in generated("unreachable").groups:
        factors = np.array([1.0 / largest_factor(*each) for each in sample(group, len(group.wrench))])
        far = np.arange(len(factors)) % 10 == 9
        assert np.all((factors[~far] >= 1.01 - 1e-9) & (factors[~far] <= 2.0 + 1e-9))
        assert np.all((factors[far] >= 10.0 - 1e-6) & (factors[far] <= 100.0 + 1e-6))


def test_conditions_are_spread_over_five_orders_of_magnitude():
    found = problem_set("near-singular", 2000)
    for group in found.groups:
        orders = np.log10(np.linalg.cond(group.structure))
        np.testing.assert_allclose(np.quantile(orders, [0, 0.25, 0.5, 0.75, 1]), [2, 3.25, 4.5, 5.75, 7], atol=0.3)
        assert orders.max() <= 7.01


def border_crossings(group: Group):
    errors = np.array([least_error(*each) for each in sample(group, 60)])
    return int(np.count_nonzero(np.diff(errors > 1e-9)))


def test_every_path_crosses_the_border():
    groups = generated("trajectory").groups
    assert {group.structure.shape[1:] for group in groups} == {(3, 4), (3, 7), (3, 8), (6, 8)}
    assert all(border_crossings(group) >= 1 for group in groups)


def test_more_samples_are_more_paths_not_longer_ones():
    groups = problem_set("trajectory", 9000).groups
    assert len(groups) == 12
    assert max(len(group.wrench) for group in groups) == 750


def test_one_cable_of_each_rig_is_strong():
    for group in generated("mixed-limits").groups:
        strong = group.upper == 20.0
        assert np.all(strong.sum(axis=1) == 1)
        assert np.all(strong.any(axis=0))
        np.testing.assert_array_equal(group.lower, np.where(strong, 0.3, 0.5))
        np.testing.assert_array_equal(group.upper, np.where(strong, 20.0, 6.0))


@pytest.mark.parametrize(
    ("name", "count", "seed", "message"),
    [
        ("edges", 10, 0, "'edges'; choose one of published, point, edge"),
        ("edge", 0, 0, "count 0"),
        ("edge", 10, -1, "seed -1"),
    ],
)
def test_what_is_no_set_is_refused(name, count, seed, message):
    with pytest.raises(InputError, match=message):
        problem_sets.problem_set(name, count, seed)


@pytest.mark.parametrize(("n", "m"), [(3, 3), (3, 5), (3, 12), (6, 8)])
def test_furthest_agrees_with_linear_programming(n, m):
    rng = np.random.default_rng(m)
    W = structures(rng, n, m, 20)
    lower, upper = rng.uniform(0.0, 1.0, (20, m)), rng.uniform(2.0, 9.0, (20, m))
    w = np.einsum("bnm,bm->bn", W, rng.uniform(lower, upper))
    expected = [largest_factor(*each) for each in zip(W, w, lower, upper, strict=True)]
    np.testing.assert_allclose(largest_scale(Group("", W, w, lower, upper)), expected, rtol=1e-9)
