"""Stiffest tensions: HiGHS on the same programme, bounds that hold, and springs whose best tensions are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import tensionlab as tl
from tensionlab import Status
from tensionlab.errors import InputError, RigError
from tests.model.test_stiffness import elastic, poses, with_pulleys

CASES = {
    "point": (lambda: tl.load_rig("bartels2026-validation"), "up"),
    "many cables": (lambda: tl.load_rig("seven-modules"), [1.0, 2.0, -1.0]),
    "planar over pulleys": (lambda: with_pulleys(tl.load_rig("kntu-planar"), 0.05), [0.0, 0.0, 1.0]),
    "suspended": (lambda: tl.load_rig("cogiro"), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    "platform over pulleys": (lambda: with_pulleys(tl.load_rig("ipanema-1"), 0.08), [0, 0, 1.0, 1.0, 0, 0]),
}


@pytest.mark.parametrize("name", CASES)
def test_no_tensions_are_stiffer(name):
    make, direction = CASES[name]
    rig, rng, count = elastic(make()), np.random.default_rng(3), 100
    position, rotation = poses(rig, count, rng, 0.2, 0.1)
    lower, upper = rig.limits.lower, rig.limits.upper
    inside = lower + rng.random((count, rig.m)) * (upper - lower)
    wrench = np.einsum("bnm,bm->bn", rig.structure_matrix(position, rotation), inside)
    wrench -= rig.required.middle(rig, rotation)
    wrench[::10] *= 10.0  # infeasible, most of them
    found = tl.stiffest_tensions(rig, direction, wrench, position, rotation)
    tensions, status = found.allocation.tensions, found.allocation.status

    along = np.pad(np.eye(3)["xyz".index(rig.up[-1])] if direction == "up" else direction, (0, 6))[: rig.n]
    length = np.append(np.ones(rig.dimension), np.full(3, rig.characteristic_length))[: rig.n]
    along = along / np.linalg.norm(along * length)

    def stiffness(pulls):
        return np.einsum("i,bij,j->b", along, tl.stiffness_matrix(rig, pulls, position, rotation), along)

    np.testing.assert_allclose(found.stiffness, stiffness(tensions), rtol=1e-12)
    gains = np.stack([stiffness(e) - stiffness(0 * e) for e in np.eye(rig.m)], axis=-1)
    W = rig.structure_matrix(position, rotation)
    for row in range(count):
        scale = np.abs(gains[row]).max()
        best = linprog(
            -gains[row] / scale, None, None, W[row], found.allocation.desired[row], np.c_[lower, upper], "highs-ds"
        )
        assert (status[row] == Status.EXACT) == (best.status == 0)
        if best.status:
            assert status[row] == Status.NEAREST
            assert np.isnan(found.bound[row])
            continue
        reached = found.stiffness[row] - stiffness(0 * tensions)[row]
        span = (np.abs(gains[row]) * (upper - lower)).sum()
        assert reached == pytest.approx(-best.fun * scale, abs=1e-7 * span)
        assert found.stiffness[row] - 1e-9 * span <= found.bound[row] <= found.stiffness[row] + 1e-9 * span
    assert 0.05 * count <= np.count_nonzero(status) <= 0.15 * count


def test_a_pair_of_cables_pulls_as_hard_as_it_may():
    modules = [tl.Module(f"{x}", [x, 0.0], 1.0, 8.0 - x, cable_stiffness=1e3) for x in (-2.0, 2.0)]
    rig = tl.Rig("pair", "planar-point", modules, [0.0, 0.0], up="y")
    found = tl.stiffest_tensions(rig, "up")
    assert found.allocation.modules == ("-2.0", "2.0")
    np.testing.assert_allclose(found.allocation.tensions, [6.0, 6.0])
    assert found.stiffness == pytest.approx(2 * 6.0 / 2.0)  # of two strings across
    assert found.bound == pytest.approx(found.stiffness)


def test_on_the_border_of_what_can_be_rendered_the_bound_holds():
    rig, rng = elastic(tl.load_rig("seven-modules")), np.random.default_rng(1)
    W = rig.structure_matrix(rig.home)
    corners = np.where(rng.normal(size=(50, 3)) @ W > 0.0, rig.limits.upper, rig.limits.lower)
    found = tl.stiffest_tensions(rig, "up", corners @ W.T)  # in each a direction pulls all cables to their limits
    assert found.allocation.exact.all()
    np.testing.assert_allclose(found.allocation.tensions, corners, atol=1e-5)
    assert (found.bound >= found.stiffness - 1e-6).all()


def test_of_equally_stiff_tensions_it_takes_the_least():
    """Cables of one length have one gain, so that only their sum counts."""
    rig = elastic(tl.load_rig("tetra-4"))
    modules = [replace(m, anchor=m.anchor / np.linalg.norm(m.anchor - rig.home)) for m in rig.modules]
    found = tl.stiffest_tensions(replace(rig, modules=tuple(modules)), "x", np.zeros(3))
    np.testing.assert_allclose(found.allocation.tensions, 5.0)


def test_what_is_missing_or_wrong_is_named():
    rig = elastic(tl.load_rig("kntu-planar"))
    with pytest.raises(InputError, match="direction is 'z'; give one of up, x, y, or 2 numbers"):
        tl.stiffest_tensions(rig, "z")
    with pytest.raises(InputError, match="give 2 numbers, or 3 with the rotation, not all zero"):
        tl.stiffest_tensions(rig, [0.0, 0.0])
    with pytest.raises(RigError, match='key "up" is missing'):
        tl.stiffest_tensions(replace(rig, up=None), "up")
