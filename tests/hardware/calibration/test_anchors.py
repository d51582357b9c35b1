"""Anchors from cable lengths: planted ones come back, and the intervals hold what they promise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.anchors import Poses, calibrate_anchors, calibrated_rig, length_errors
from tensionlab.model.files import load_rig
from tests.helpers.examples import many

NAMES = ("bartels2026-validation", "seven-modules", "cube-8", "kntu-planar", "ipanema-1")
POINT, SEVEN, CUBE, PLANAR, PLATFORM = map(load_rig, NAMES)
NOISE = 1e-3


def displaced(rig, rng, size=0.02):
    """The same rig, built with some centimetres of error."""
    moved = rig.anchors + rng.normal(0.0, size, rig.anchors.shape)
    return replace(rig, modules=tuple(replace(m, anchor=a) for m, a in zip(rig.modules, moved, strict=True)))


def sampled(rig, count, rng):
    """Poses all over a box inside the anchors, somewhat turned."""
    low, high = rig.anchors.min(axis=0), rig.anchors.max(axis=0)
    position = (low + high) / 2 + (high - low) * rng.uniform(-0.3, 0.3, (count, rig.dimension))
    turn = rng.uniform(-0.4, 0.4, (count, rig.n - rig.dimension)) if rig.n > rig.dimension else None
    return Poses.at(rig, position, turn)


def lengths_at(rig, poses):
    turn = poses.rotation if rig.n > rig.dimension else None
    if turn is not None and rig.dimension == 2:
        turn = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    return rig.lengths(poses.position, turn)


def onto(anchors, nominal):
    """Moved and turned as one onto the nominal anchors: what unknown poses can tell."""
    padded = [np.pad(each - each.mean(axis=0), ((0, 0), (0, 3 - each.shape[1]))) for each in (nominal, anchors)]
    if anchors.shape[1] == 2:  # two points off the plane keep the rotation in it
        padded = [np.vstack([each, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]) for each in padded]
    turn = Rotation.align_vectors(*padded)[0].as_matrix()[: anchors.shape[1], : anchors.shape[1]]
    return (anchors - anchors.mean(axis=0)) @ turn.T + nominal.mean(axis=0)


@pytest.mark.parametrize("offsets", [False, True])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("rig", [POINT, SEVEN, CUBE, PLANAR, PLATFORM], ids=lambda rig: rig.name)
def test_without_noise_the_anchors_come_back(rig, known, offsets):
    rng = np.random.default_rng(7)
    true = displaced(rig, rng)
    poses = sampled(rig, 30, rng)
    off = rng.normal(0.0, 0.01, rig.m) * offsets
    found = calibrate_anchors(
        rig, lengths_at(true, poses) + off, poses if known else None, known=known, offsets=offsets
    )
    expected = true.anchors if known else onto(true.anchors, rig.anchors)
    np.testing.assert_allclose(found.anchors, expected, atol=1e-9)
    np.testing.assert_allclose(found.offsets, off, atol=1e-9)
    assert found.sigma < 1e-11


def test_rough_poses_lead_the_search_on_a_rig_with_crossed_cables():
    rig = load_rig("cogiro")
    for seed in range(many(5, least=1)):
        rng = np.random.default_rng(seed)
        true, poses = displaced(rig, rng), sampled(rig, 30, rng)
        measured = lengths_at(true, poses) + rng.normal(0.0, NOISE, (30, rig.m))
        shifted = poses.position + rng.normal(0.0, 0.1, poses.position.shape)
        rough = Poses.at(rig, shifted, rng.normal(0.0, 0.1, (30, 3)))
        rough = Poses(shifted, rough.rotation @ poses.rotation)
        found = calibrate_anchors(rig, measured, rough)
        assert found.sigma == pytest.approx(NOISE, rel=0.25)
        assert found.sigma == pytest.approx(calibrate_anchors(rig, measured, poses).sigma, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "known", "offsets"),
    [
        (POINT, True, False),
        (POINT, False, False),
        (POINT, True, True),
        (SEVEN, False, True),
        (PLANAR, False, False),
    ],
)
def test_intervals_hold_the_true_anchors_95_times_in_100(rig, known, offsets):
    rng = np.random.default_rng(3)
    inside, total = 0, 0
    spread, claimed = [], []
    true = displaced(rig, rng)
    expected = true.anchors if known else onto(true.anchors, rig.anchors)
    for _ in range(many(100)):
        poses = sampled(rig, 16, rng)
        measured = lengths_at(true, poses) + rng.normal(0.0, NOISE, (16, rig.m))
        found = calibrate_anchors(rig, measured, poses, known=known, offsets=offsets)
        error = np.abs(found.anchors - expected)
        inside += int((error <= found.intervals).sum())
        total += error.size
        spread.append(found.sigma**2)
        claimed.append(found.freedom)
    assert 0.90 <= inside / total <= 0.98
    assert np.mean(spread) == pytest.approx(NOISE**2, rel=0.1)
    assert claimed[0] == 16 * (rig.m if known else rig.m - rig.n) - (
        rig.m * (rig.dimension + offsets) - (0 if known else rig.dimension * (rig.dimension + 1) // 2)
    )


@pytest.mark.parametrize("known", [True, False])
def test_lengths_at_poses_it_never_saw_fit_better_than_before(known):
    rng = np.random.default_rng(5)
    true, poses = displaced(POINT, rng), sampled(POINT, 30, rng)
    measured = lengths_at(true, poses) + rng.normal(0.0, NOISE, (30, POINT.m))
    for offsets, off in ((False, 0.0), (True, 0.01 * np.arange(POINT.m))):
        found = calibrate_anchors(POINT, measured + off, poses, known=known, offsets=offsets)
        errors = length_errors(POINT, measured + off, found, known=known, offsets=offsets)
        assert errors["held_out"] == pytest.approx(NOISE, rel=0.4)
        assert errors["before"] > 4.0 * errors["held_out"]
    # And the positions that the rig finds from lengths are those it was at.
    rig = calibrated_rig(POINT, calibrate_anchors(POINT, measured, poses, known=True), "here")
    new = sampled(POINT, 50, rng)
    off = [
        np.linalg.norm(each.forward_kinematics(lengths_at(true, new)).position - new.position, axis=1).max()
        for each in (POINT, rig)
    ]
    assert off[1] < 0.005
    assert off[0] > 0.01


def test_the_error_of_all_lengths_by_the_same_share_makes_a_larger_rig():
    rng = np.random.default_rng(2)
    poses = sampled(SEVEN, 40, rng)
    found = calibrate_anchors(SEVEN, 1.02 * lengths_at(SEVEN, poses))
    assert found.sigma < 1e-11
    centre = SEVEN.anchors.mean(axis=0)
    np.testing.assert_allclose(found.anchors - centre, 1.02 * (SEVEN.anchors - centre), atol=1e-9)


# What cannot be told


@pytest.mark.parametrize(
    ("count", "how", "message"),
    [
        (5, {}, "5 poses cannot tell the 6 unknowns of 4 anchors; measure at 6"),
        (5, {"offsets": True}, "10 unknowns of 4 anchors and offsets; measure at 10"),
        (2, {"known": True}, "2 poses cannot tell the 12 unknowns of 4 anchors; measure at 3"),
    ],
)
def test_too_few_poses_say_how_many_it_takes(count, how, message):
    poses = sampled(POINT, count, np.random.default_rng(0))
    with pytest.raises(CalibrationError, match=message):
        calibrate_anchors(POINT, lengths_at(POINT, poses), poses, **how)
    enough = sampled(POINT, int(message.split()[-1]), np.random.default_rng(0))
    calibrate_anchors(POINT, lengths_at(POINT, enough), enough, **how)


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_poses_in_a_plane_do_not_tell_how_far_anchors_are_off_it(noise):
    rng = np.random.default_rng(0)
    poses = sampled(CUBE, 20, rng)
    flat = replace(poses, position=poses.position * [1.0, 1.0, 0.0] + [0.0, 0.0, CUBE.anchors[0, 2]])
    measured = lengths_at(CUBE, flat) + rng.normal(0.0, 1.0, (20, 8)) * noise
    with pytest.raises(CalibrationError, match=r"where the anchors of .*, in no common plane or line$"):
        calibrate_anchors(CUBE, measured, flat, known=True)


def test_poses_of_one_orientation_do_not_tell_the_anchors_of_a_platform():
    far = replace(PLANAR, modules=tuple(replace(m, anchor=np.add(m.anchor, [5.0, -3.0])) for m in PLANAR.modules))
    poses = Poses.at(far, sampled(far, 20, np.random.default_rng(0)).position)
    with pytest.raises(CalibrationError, match=r"Add poses .* and turned differently"):
        calibrate_anchors(far, lengths_at(far, poses))


@pytest.mark.parametrize(
    ("name", "lengths", "known", "message"),
    [
        ("floor-3", np.full((30, 3), 0.5), False, "measure at known poses, or add modules"),
        ("body-mounted", np.ones((30, 4)), False, "only fixed anchors"),
        ("bartels2026-validation", np.ones((30, 3)), False, "finite lengths above 0 m"),
        ("bartels2026-validation", np.full((30, 4), np.nan), False, "finite lengths above 0 m"),
        ("bartels2026-validation", np.zeros((30, 4)), False, "finite lengths above 0 m"),
        ("bartels2026-validation", np.ones((30, 4)), True, "known poses were announced"),
    ],
)
def test_rigs_and_lengths_that_cannot_be_calibrated_are_refused(name, lengths, known, message):
    with pytest.raises(CalibrationError, match=message):
        calibrate_anchors(load_rig(name), lengths, known=known)
