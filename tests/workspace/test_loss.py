"""What is left after the loss of a cable: against linear programs of HiGHS over all losses."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.highs import feasibility_checker, model
from tensionlab.model.kinematics import exponential
from tests.helpers.examples import many

margins_of = tl.workspace.loss_margins
METRICS = ["loss-margin", "worst-loss", "capacity-margin"]


def over_pulleys(rig, radius):
    axes = [rig.upward * np.copysign(1.0, rig.upward @ (rig.home - module.anchor)) for module in rig.modules]
    modules = [
        replace(module, pulley_radius=radius, pulley_axis=axis)
        for module, axis in zip(rig.modules, axes, strict=True)
    ]
    return replace(rig, modules=tuple(modules), bodies=())


def drawn(kind, m, mass=None, seed=0):
    """Rig of random anchors around a platform, or above it where that has a mass."""
    rng, d = np.random.default_rng(seed), 2 if kind == "planar" else 3
    anchors = rng.normal(size=(m, d))
    anchors /= np.linalg.norm(anchors, axis=1, keepdims=True)
    anchors[:, -1] = np.abs(anchors[:, -1]) + 0.3 if mass else anchors[:, -1]
    modules = [
        tl.Module(str(i), anchor, 0.5, 40.0, attachment=arm)
        for i, (anchor, arm) in enumerate(zip(anchors, rng.uniform(-0.2, 0.2, (m, d)), strict=True))
    ]
    heavy = {} if mass is None else {"platform": tl.Platform(mass), "required": tl.Requirement(gravity=True)}
    return tl.Rig(f"{kind}-{m}", kind, tuple(modules), np.zeros(d), up="y" if d == 2 else "z", **heavy)


POINT, HEAVY = tl.load_rig("seven-modules"), drawn("platform", 12, 2.0)
BOX = tl.Requirement(gravity=True, box=[0.0, 0.0, 1.0, 0.0, 0.0, 0.1])
# Rig, half the edges of the box of poses as a share of the way to the anchors, push in N, and whether poses of it
# bear a loss.
CASES = {
    "point": (POINT, 0.3, 1.0, True),
    "cube": (tl.load_rig("cube-8"), 0.5, 2.0, True),
    "too few cables": (tl.load_rig("floor-3"), 0.5, 1.0, False),
    "body-mounted": (tl.load_rig("body-mounted"), 0.3, 0.5, False),
    "planar platform": (drawn("planar", 6, seed=5), 0.2, 3.0, True),
    "platform": (drawn("platform", 12, seed=12), 0.15, 2.0, True),
    "suspended, eight cables": (tl.load_rig("cogiro"), 0.5, 300.0, False),
    "suspended": (HEAVY, 0.15, 2.0, True),
    "suspended, required box": (replace(HEAVY, required=BOX), 0.1, 0.0, True),
    "suspended, pulleys": (over_pulleys(HEAVY, 0.02), 0.15, 2.0, True),
    "point, pulleys": (over_pulleys(POINT, 0.02), 0.3, 1.0, True),
}


def scattered(rig, share, push, count):
    """Poses about home, turned by 0.1 rad where the rig can, each with a push of its own."""
    rng = np.random.default_rng(rig.m)
    half = share * np.abs(rig.anchors - rig.home).max(axis=0)
    position = rig.home + rng.uniform(-half, half, (count, rig.dimension))
    turned = rng.normal(scale=0.1, size=(count, 3) if rig.dimension == 3 else count)
    rotation = None if rig.n == rig.dimension else exponential(turned) if rig.dimension == 3 else turned
    wrench = np.zeros((count, rig.n))
    wrench[:, : rig.dimension] = push * rng.uniform(0.0, 1.0, (count, 1)) * rng.normal(size=(count, rig.dimension))
    return tl.workspace.PoseList(position, rotation, wrench)


@pytest.mark.parametrize("name", CASES)
def test_linear_programs_agree_over_all_losses(name):
    """10^5 poses with HYPOTHESIS_PROFILE=nightly; each takes a program for every loss and required wrench."""
    rig, share, push, bears = CASES[name]
    poses = scattered(rig, share, push, many(1000, 60))
    data = tl.sweep(rig, poses, METRICS, frames=rig.at_rest)
    margin, worst = (data[key].values[0] for key in METRICS[:2])
    structure = rig.structure_matrix(poses.position, poses.rotation, rig.at_rest)
    wrenches = rig.required.at(rig, poses.rotation) + poses.wrench[:, None]
    feasible, clear = feasibility_checker(), 1e-6 * rig.limits.upper.max()
    renders = np.empty((len(margin), rig.m), bool)
    for lost in range(rig.m):
        kept = np.arange(rig.m) != lost
        limits = rig.limits.lower * kept, rig.limits.upper * kept  # the column stays
        found = feasible(
            model(W, wrench, *limits) for W, corners in zip(structure, wrenches, strict=True) for wrench in corners
        )
        renders[:, lost] = np.reshape(found, wrenches.shape[:2]).all(axis=1)
    assert renders[margin > clear].all()
    below = margin < -clear
    assert not renders[below, worst[below].astype(int)].any()
    assert (margin > clear).any() == bears


def test_after_the_loss_of_one_of_eight_corners():
    """The margin is that of the rig without the column; of equal cables the first is the worst."""
    rig = tl.load_rig("cube-8")
    structure = rig.structure_matrix(rig.home)
    found = margins_of(structure, rig.limits)
    assert found.shape == (8,)
    for lost in range(8):
        kept = np.arange(8) != lost
        limits = rig.limits.lower[kept], rig.limits.upper[kept]
        assert found[lost] == tl.workspace.capacity_margin(structure[:, kept], limits)
    assert np.ptp(found) < 1e-9
    data = tl.sweep(rig, [rig.home], METRICS)
    assert data["worst-loss"].item() == 0


def test_leading_axes_required_wrenches_and_balls_broadcast():
    rng = np.random.default_rng(3)
    W, upper = rng.normal(size=(4, 1, 3, 6)), np.linspace(1.0, 3.0, 5)[:, None]
    ball = (rng.normal(size=(5, 3)), np.linspace(0.0, 1.0, 4)[:, None])
    found = margins_of(W, (0.0, upper), ball)
    assert found.shape == (4, 5, 6)
    one = margins_of(W[2, 0], (0.0, upper[3]), (ball[0][3], ball[1][2, 0]))
    np.testing.assert_allclose(found[2, 3], one)
    with pytest.raises(tl.errors.ShapeError, match="one cable, and nothing is left after its loss"):
        margins_of(W[..., :1], (0.0, 1.0))


def test_a_minimum_tension_that_lifts_the_platform_is_gone_with_its_cable():
    """Two cables straight up with 3 N at least lift a weight of 5 N; one alone holds it."""
    W, weight = [[0.0, 0.0, 1.0, -1.0], [1.0, 1.0, 0.0, 0.0]], [0.0, 5.0]
    limits = ([3.0, 3.0, 0.0, 0.0], [8.0, 8.0, 1.0, 1.0])
    assert tl.workspace.capacity_margin(W, limits, weight) == pytest.approx(-1.0)
    np.testing.assert_allclose(margins_of(W, limits, weight), [1.0, 1.0, -1.0, -1.0])
