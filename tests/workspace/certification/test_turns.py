"""Proofs for all orientations within an angle, held against orientations sought for the least margin."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.certify import least_margins, random_positions
from tests.helpers.examples import many

certify = tl.workspace.certify
exponential = tl.model.kinematics.exponential
DEGREE = np.pi / 180
COGIRO = [(-5, 5), (-4, 4), (0.5, 4.5)]
IPANEMA = [(-4, 4), (-3, 3), (1, 5)]
PLANAR = [(-1.1, 1.1), (-1.0, 1.0)]


def over_pulleys(name):
    rig = tl.load_rig(name)
    modules = [replace(each, pulley_radius=0.05, pulley_axis=[0.0, 0.0, -1.0]) for each in rig.modules]
    return replace(rig, modules=tuple(modules), bodies=())


def with_mass(rig):
    platform = tl.Platform(4.0, com=[0.05, -0.08], inertia=[[0.1]])
    return replace(rig, platform=platform, up="y")


CASES = {
    "weight": (tl.load_rig("cogiro"), COGIRO, tl.Requirement(gravity=True), 0.5, 5),
    "accelerations": (tl.load_rig("cogiro"), COGIRO, tl.Requirement(gravity=True, acceleration=[1, 1, 1]), 0.7, 3),
    "ball": (tl.load_rig("ipanema-2"), IPANEMA, tl.Requirement(gravity=True, ball=2.0), 0.5, 2),
    "planar": (tl.load_rig("kntu-planar"), PLANAR, tl.Requirement(ball=3.0), 0.05, 8),
    "planar weight": (
        with_mass(tl.load_rig("kntu-planar")), PLANAR, tl.Requirement(gravity=True, box=[1, 1, 0.1]), 0.05, 12
    ),
    "pulleys": (over_pulleys("cogiro"), [(-7, 7), (-5, 5), (0, 5)], tl.Requirement(gravity=True), 0.8, 2),
}  # fmt: skip


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    rig, region, required, resolution, degrees = CASES[request.param]
    return rig, required, degrees * DEGREE, certify(rig, region, required, resolution, angle=degrees * DEGREE)


def test_no_orientation_contradicts_a_cell_that_is_inside(case):
    rig, required, angle, proved = case
    rng = np.random.default_rng(1)
    positions = random_positions(proved, 1, many(5000, 300), rng)
    assert len(positions)
    assert least_margins(rig, required, positions, angle, rng).min() > 0


def test_a_cell_that_is_outside_has_an_orientation_that_is_infeasible(case):
    rig, required, angle, proved = case
    rng = np.random.default_rng(2)
    positions = random_positions(proved, -1, many(5000, 300), rng)
    assert least_margins(rig, required, positions, angle, rng).max() < 0


def test_the_share_of_feasible_positions_is_within_the_bounds(case):
    rig, required, angle, proved = case
    positions = proved.subdivision.low + np.random.default_rng(3).random((many(2000), rig.dimension)) * (
        proved.subdivision.extent
    )
    least = least_margins(rig, required, positions, angle, np.random.default_rng(4))
    share, noise = np.mean(least > 0), 4 / np.sqrt(len(positions)) / 2
    assert proved.share.lower - noise < share < proved.share.upper + noise


def test_bounds_within_five_degrees():
    rig, region = CASES["weight"][:2]
    low, high = certify(rig, region, resolution=0.4, angle=5 * DEGREE).volume
    assert 255 < low < 307 < high < 311  # a search over orientations finds 307


@pytest.mark.parametrize("name", ["weight", "planar weight"])
def test_what_is_proved_shrinks_with_the_angle(name):
    rig, region, required, resolution, degrees = CASES[name]
    angles = np.array([0.0, 1e-7, 0.3, 1.0]) * degrees * DEGREE
    still, hardly, less, all_turns = (certify(rig, region, required, resolution, angle=each) for each in angles)
    at = still.subdivision.low + np.random.default_rng(5).random((5000, rig.dimension)) * still.subdivision.extent
    for small, large in [(still, hardly), (hardly, less), (less, all_turns)]:
        assert not ((small.at(at) == -1) & (large.at(at) == 1)).any()
        assert large.volume.lower <= small.volume.upper
        assert large.volume.upper <= small.volume.upper + 1e-3 * small.region_volume
    assert hardly.volume.lower > still.volume.lower - 1e-3 * still.region_volume


def crossed_rig(away):
    """Return a planar rig with anchors at the corners of a square, and arms that are ``away`` from them, in rad.

    By symmetry opposite cables have the same tension in the centre; turned by an angle, the moments of the two
    pairs are as sin(away - angle) and -sin(away + angle): they balance while the angle is less than ``away``.
    """
    corners = np.pi / 4 + np.pi / 2 * np.arange(4)
    directions = np.stack([corners, corners + away * np.array([-1, 1, -1, 1])])
    anchors, arms = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    modules = tuple(
        tl.Module(str(i), anchor, 0.0, 1.0, attachment=0.3 * arm)
        for i, (anchor, arm) in enumerate(zip(anchors, arms, strict=True))
    )
    return tl.Rig("crossed", "planar", modules, home=np.zeros(2))


@pytest.mark.parametrize("away", [0.1, 0.3])
def test_the_angle_at_which_a_planar_rig_loses_closure(away):
    rig, region = crossed_rig(away), [(-1e-5, 1e-5), (-1e-5, 1e-5)]
    for share, verdict in ((0.8, 1), (1.01, -1)):
        proved = certify(rig, region, "wrench-closure", 2.5e-6, angle=share * away)
        assert (proved.verdict == verdict).all()


def test_a_ball_of_orientations_holds_those_that_it_is_cut_into():
    rig, region, required, _, degrees = CASES["weight"]
    angle, resolution = degrees * DEGREE, 1.0
    axes = np.array([[sign * (i == k) for i in range(3)] for k in range(3) for sign in (-1, 1)], float)
    parts = exponential(np.vstack([np.zeros((1, 3)), axes * angle / 2]))
    whole = certify(rig, region, required, resolution, angle=angle)
    cut = certify(rig, region, required, resolution, rotations=parts, angle=angle / 2)
    at = np.random.default_rng(6).uniform(*np.array(region).T, (5000, 3))
    assert not ((cut.at(at) == -1) & (whole.at(at) == 1)).any()
    assert whole.volume.lower <= cut.volume.upper
