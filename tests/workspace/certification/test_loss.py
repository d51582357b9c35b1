"""What is proved to survive the loss of any one cable holds at sampled poses without each of them."""

import numpy as np
import pytest

import tensionlab as tl
from benchmarks.certify import random_positions
from tensionlab.errors import InputError
from tensionlab.workspace.wrench_set import loss_margins, required_margin
from tests.helpers.examples import many
from tests.workspace.test_loss import drawn, over_pulleys

certify = tl.workspace.certify
SEVEN = tl.load_rig("seven-modules")
ROOM = [(-1.0, 1.0), (0.6, 2.2), (-1.0, 1.0)]
HALF_A_NEWTON = tl.Requirement(ball=0.5)
PLANAR, SUSPENDED = drawn("planar", 6, seed=5), drawn("platform", 9, 2.0)
SHEET = [(-0.1, 0.1), (-0.1, 0.1), (0.0, 0.0)]
CASES = {  # rig, region, what is required, resolution, and orientations in which it is
    "point": (SEVEN, ROOM, HALF_A_NEWTON, 0.1, None),
    "point, pulleys": (over_pulleys(SEVEN, 0.02), ROOM, tl.Requirement(wrench=[0.0, 0.5, 0.0]), 0.1, None),
    "planar platform": (PLANAR, [(-0.5, 0.5)] * 2, tl.Requirement(ball=1.0), 0.02, [-0.1, 0.1]),
    "suspended": (SUSPENDED, SHEET, tl.Requirement(gravity=True), 0.02, None),
}


@pytest.mark.parametrize("name", CASES)
def test_no_pose_contradicts_what_is_proved_after_losses(name):
    rig, region, required, resolution, rotations = CASES[name]
    proved = certify(rig, region, required, resolution, rotations=rotations, losses=1)
    assert proved.cell_volumes.sum() == pytest.approx(proved.region_volume)  # every place is in one cell
    assert list(proved.losses) == [module.name for module in rig.modules]
    assert (proved.verdict == 1).any() == (name != "suspended")

    def margins(positions):
        every = [None] if rotations is None else [np.full(len(positions), angle) for angle in rotations]
        structures = [(rig.structure_matrix(positions, turned), turned) for turned in every]
        return np.min([required_margin(rig, W, required, turn, margin=loss_margins) for W, turn in structures], 0)

    for number, proof in enumerate([*proved.losses.values(), proved]):
        for verdict in {1, -1} & set(proof.verdict):
            positions = random_positions(proof, verdict, many(20_000, 1000), np.random.default_rng(2))
            left = margins(positions)
            left = left[:, number] if number < rig.m else left.min(axis=-1)
            assert (left * verdict > 0).all()


def test_bounds_hold_the_share_of_positions_that_survive_a_loss():
    coarse, fine = (certify(SEVEN, ROOM, HALF_A_NEWTON, step, losses=1) for step in (0.2, 0.1))
    positions = np.random.default_rng(0).uniform(*np.array(ROOM).T, (many(1_000_000, 100_000), 3))
    margins = loss_margins(SEVEN.structure_matrix(positions), SEVEN.limits) - 0.5
    noise = 5 / np.sqrt(len(positions))
    every = [(fine, margins.min(axis=-1)), *zip(fine.losses.values(), margins.T, strict=True)]
    for proved, margin in every:
        assert proved.share.lower - noise < (margin > 0).mean() < proved.share.upper + noise
    assert fine.volume.upper <= min(proof.volume.upper for proof in fine.losses.values())
    assert np.diff(fine.volume) < np.diff(coarse.volume) / 2
    worst = np.argmin((margins > 0).mean(axis=0))
    assert fine.worst_loss == SEVEN.modules[worst].name


def test_wrench_closure_after_losses():
    proved = certify(SEVEN, ROOM, "wrench-closure", 0.2, losses=1)
    for verdict in (1, -1):
        structure = SEVEN.structure_matrix(random_positions(proved, verdict, 500, np.random.default_rng(4)))
        closes = [tl.workspace.wrench_closure(np.delete(structure, lost, axis=-1)) for lost in range(SEVEN.m)]
        assert (np.all(closes, axis=0) == (verdict == 1)).all()


def test_of_a_lost_cable_no_clearance_is_required():
    """A ball on one cable: only the loss of that cable clears it."""
    touched = SEVEN.modules[3]
    ball = tl.Body("ball", (touched.anchor + SEVEN.home) / 2, radius=0.05)
    region = [(x - 0.02, x + 0.02) for x in SEVEN.home]
    proved = certify(SEVEN, region, tl.Requirement(), 0.02, bodies=[ball], losses=1)
    assert {name for name, proof in proved.losses.items() if proof.proved} == {touched.name}
    assert (proved.verdict == -1).all()


@pytest.mark.parametrize(
    ("rig", "losses", "words"),
    [("floor-3", 1, "nothing survives the loss of one; give it 4"), ("cube-8", 2, "losses is 2; give 0, or 1")],
)
def test_losses_that_nothing_survives_are_refused(rig, losses, words):
    with pytest.raises(InputError, match=words):
        certify(tl.load_rig(rig), [(-0.1, 0.1)] * 3, HALF_A_NEWTON, 0.1, losses=losses)
