"""The reference of proofs over pulleys: its matrices, its linear programs, and that it finds a wrong verdict."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.certify_pulleys import proofs
from benchmarks.highs import feasibility_checker, model
from benchmarks.pulley_error import over_pulleys
from benchmarks.tangents import least_violation, structure_matrix
from tests.helpers.examples import many


@pytest.mark.parametrize("name", ["bartels2026-validation", "kntu-planar", "cogiro"])
def test_structure_matrices_by_tangents_are_those_of_rigs(name):
    rig = over_pulleys(tl.load_rig(name), 0.05)
    spread = 0.2 * np.ptp(rig.anchors, axis=0)
    at = rig.home + np.random.default_rng(0).uniform(-1, 1, (50, rig.dimension)) * spread
    arms = None if rig.n == rig.dimension else rig.attachments
    found = structure_matrix(rig.anchors, arms, *rig.pulleys_in_world(), at)
    np.testing.assert_allclose(found, rig.structure_matrix(at), atol=1e-12 * np.abs(found).max())


@pytest.mark.parametrize(("n", "m"), [(2, 2), (2, 4), (3, 5), (6, 8)])
def test_vertices_tell_what_simplex_steps_tell(n, m):
    rng, count = np.random.default_rng([n, m]), many(200, 50)
    structure = rng.normal(size=(count, n, m))
    lower, upper = rng.uniform(0, 1, m), rng.uniform(1, 4, m)
    wrenches = structure[0] @ rng.uniform(lower, upper) + np.arange(3)[:, None] * rng.normal(size=n)
    violation = least_violation(structure, wrenches, lower, upper)
    checker = feasibility_checker()
    answers = checker(model(W, wrench, lower, upper) for W in structure for wrench in wrenches)
    clear = np.abs(violation.ravel()) > 1e-6
    np.testing.assert_array_equal((violation.ravel() <= 0)[clear], np.array(answers)[clear])
    assert {True, False} <= set(answers)


@pytest.mark.parametrize("name", ["bartels2026-validation", "kntu-planar"])
def test_no_linear_program_contradicts_a_proof_and_all_a_wrong_one(name):
    _, *led = proofs(tl.load_rig(name))
    for proof in led:
        looked, wrong, _ = proof.contradictions(many(4000, 1000), 0)
        assert (looked > 0, wrong) == (True, 0)
    lie = replace(led[0], proved=replace(led[0].proved, verdict=-led[0].proved.verdict))
    looked, wrong, _ = lie.contradictions(200, 0)
    assert looked == wrong
