import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.workspace.orientations import MAX_ORIENTATIONS, parse_rotations, roll_pitch_yaw_of

UP = np.array([0.0, 0.0, 1.0])


def test_a_cone_tilts_its_axis_by_up_to_the_angle_and_turns_nothing_about_it():
    axis = np.array([1.0, 2.0, -1.0])
    turns = tl.workspace.cone(np.radians(20.0), np.radians(5.0), axis)
    unit = axis / np.linalg.norm(axis)
    tilt = np.degrees(np.arccos(np.clip(np.asarray(turns) @ unit @ unit, -1, 1)))
    assert tilt[0] == 0.0
    assert np.unique(tilt.round(6)).tolist() == [0.0, 5.0, 10.0, 15.0, 20.0]
    assert np.abs(Rotation.from_matrix(turns[:]).as_rotvec() @ unit).max() < 1e-12


def test_orientations_have_the_weight_of_what_they_stand_for():
    """Caps of the sphere, and balls in the space of all rotations, whose measure is (angle - sin(angle)) / pi."""
    tilts = tl.workspace.cone(np.radians(120.0), np.radians(1.0))
    within = tilts[:, 2, 2] > np.cos(np.radians(40.5))
    assert tilts.weights @ within == pytest.approx((1 - np.cos(np.radians(40.5))) / 1.5, rel=1e-6)
    turn = np.linspace(-np.pi, np.pi, 49)
    every = tl.workspace.roll_pitch_yaw(turn, turn[12:37], turn)
    angle = Rotation.from_matrix(every[:]).magnitude()
    for limit in (1.0, 2.0, 3.0):
        assert every.weights @ (angle < limit) == pytest.approx((limit - np.sin(limit)) / np.pi, abs=0.003)


def test_a_share_of_orientations_is_weighted_and_everything_is_all():
    """A planar arm: the angle counts as a coordinate does; a list of matrices counts each the same."""
    rig = tl.load_rig("kntu-planar")
    angles = np.radians([-30.0, 0.0, 10.0, 30.0])
    left = tl.workspace.Metric("turned-left", lambda batch: (batch.rotation < 0.1).astype(float))
    swept = tl.sweep(rig, tl.workspace.Grid(*rig.home, rotations=angles), left)
    assert tl.workspace.summary(swept)["above_zero"].item() == pytest.approx(35 / 60)
    spatial, turns = tl.load_rig("cogiro"), tl.workspace.cone(0.1, 0.05)
    tilted = tl.workspace.Metric("tilted", lambda batch: (batch.rotation[:, 2, 2] < 1 - 1e-9).astype(float))
    for rotations, share in ((turns, 1 - turns.weights[0]), (turns[:], 1 - 1 / len(turns))):
        swept = tl.sweep(spatial, tl.workspace.Grid(0.0, 0.0, 2.0, rotations), tilted)
        assert tl.workspace.summary(swept)["above_zero"].item() == pytest.approx(share)
    everything = tl.workspace.Metric("one", lambda batch: np.ones(len(batch.position)))
    swept = tl.sweep(spatial, tl.workspace.box([0, 1], [0, 1], [0, 1], step=0.1, rotations=turns), everything)
    assert tl.workspace.summary(swept)["above_zero"].item() == 1.0


def test_a_cone_may_be_fine_but_not_of_more_orientations_than_fit():
    rings = 4
    assert len(tl.workspace.cone(1e-4 * rings, 1e-4)) == 1 + 3 * rings * (rings + 1)
    with pytest.raises(tl.errors.InputError, match="orientations"):
        tl.workspace.cone(1.0, 1.0 / (1.2 * np.sqrt(MAX_ORIENTATIONS)))


def test_roll_pitch_and_yaw_are_turns_about_fixed_axes_and_read_back():
    angles = np.radians([[10.0, -80.0, 30.0], [-170.0, 45.0, 100.0]])
    for roll, pitch, yaw in angles:
        (turn,) = tl.workspace.roll_pitch_yaw(roll, pitch, yaw)
        np.testing.assert_allclose(turn, Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix(), atol=1e-12)
        np.testing.assert_allclose(roll_pitch_yaw_of(turn[None])[0], [roll, pitch, yaw])
    swept = tl.sweep(tl.load_rig("cogiro"), tl.workspace.Grid(0.0, 0.0, 2.0, turn[None]), "wrench-feasible")
    assert [swept[name].item() for name in ("roll", "pitch", "yaw")] == pytest.approx([roll, pitch, yaw])
    upright = tl.workspace.roll_pitch_yaw(0.3, np.pi / 2, 0.1)
    np.testing.assert_allclose(tl.workspace.roll_pitch_yaw(*roll_pitch_yaw_of(upright)[0]), upright, atol=1e-9)


def test_texts_are_sets_of_orientations(tmp_path):
    assert len(parse_rotations("cone:10", 3, UP)) == 1 + 6 + 12
    assert np.shape(parse_rotations("rpy:-10..10,0,-30..30:10", 3, UP)) == (3 * 7, 3, 3)
    np.testing.assert_allclose(np.degrees(parse_rotations("angle:-10..10", 2, UP)), [-10, -5, 0, 5, 10], atol=1e-9)
    path = tmp_path / "turns.csv"
    path.write_text("rx,ry,rz\n0,0,0\n0.1,0,0\n")
    assert parse_rotations(str(path), 3, UP)[1] == pytest.approx(Rotation.from_rotvec([0.1, 0, 0]).as_matrix())


@pytest.mark.parametrize(
    "text", ["cone", "cone:0", "cone:10:0", "rpy:1,2", "rpy:5..1,0,0", "angle:5", "ball:3", "cone:x"]
)
def test_texts_that_are_none_are_refused(text):
    with pytest.raises(tl.errors.InputError):
        parse_rotations(text, 3, UP)
