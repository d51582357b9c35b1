"""Trajectories: their derivatives, their files, and the wrenches that move a platform along them."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.errors import DataError, InputError, RigError, ShapeError

LIFT = [[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.5, 0.2, 2.0]]


def turning(t):
    """Position and orientation of a platform that circles and tumbles, smooth in time."""
    position = np.stack([np.cos(t), np.sin(2 * t), 1.0 + 0.3 * t**2], axis=-1)
    return position, Rotation.from_euler("xyz", np.stack([0.4 * np.sin(t), 0.3 * t, 0.2 * np.cos(2 * t)], axis=-1))


@pytest.mark.parametrize(("timing", "speed", "change"), [("quintic", 1.875, 5.7735), ("trapezoidal", 1.5, 4.5)])
def test_a_trajectory_rests_at_its_points_and_its_derivatives_are_those_of_its_poses(timing, speed, change):
    rotations = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [0.5, 0.4, -0.9]])
    path = tl.Trajectory.through(LIFT, [0.0, 0.5, 2.5], rotations.as_matrix(), timing, step=0.002)
    for time, place, turn in zip([0.0, 0.5, 2.5], LIFT, rotations, strict=True):
        at = int(np.argmin(abs(path.times - time)))
        np.testing.assert_allclose(path.position[at], place, atol=1e-12)
        np.testing.assert_allclose(path.rotation[at], turn.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(path.velocity[at], 0.0, atol=1e-12)
    first = path.times <= 0.5
    assert np.linalg.norm(path.velocity[first, :3], axis=1).max() == pytest.approx(speed * 0.5 / 0.5, rel=1e-3)
    assert np.linalg.norm(path.acceleration[first, :3], axis=1).max() == pytest.approx(change * 2.0, rel=1e-3)
    step = np.diff(path.times)[:, None]
    mean = 0.5 * (path.velocity[1:] + path.velocity[:-1])
    np.testing.assert_allclose(np.diff(path.position, axis=0) / step, mean[:, :3], atol=2e-3)
    turned = Rotation.from_matrix(path.rotation[1:] @ path.rotation[:-1].transpose(0, 2, 1)).as_rotvec()
    np.testing.assert_allclose(turned / step, mean[:, 3:], atol=2e-3)
    sums = np.cumsum(0.5 * (path.acceleration[1:] + path.acceleration[:-1]) * step, axis=0)
    np.testing.assert_allclose(sums, path.velocity[1:], atol=0.04)


def test_derivatives_that_are_not_given_are_those_of_the_motion():
    t, h = np.linspace(0.0, 2.0, 401), 1e-4
    position, rotation = turning(t)
    path = tl.Trajectory(t, position, rotation.as_matrix())
    (before, turned_before), (after, turned_after) = turning(t - h), turning(t + h)
    linear, angular = (after - before) / (2 * h), (turned_after * turned_before.inv()).as_rotvec() / (2 * h)
    inner = slice(20, -20)
    np.testing.assert_allclose(path.velocity[inner], np.hstack([linear, angular])[inner], atol=1e-5)
    rates = [(turning(t + s)[1] * turning(t + s - 2 * h)[1].inv()).as_rotvec() / (2 * h) for s in (0, 2 * h)]
    changes = np.hstack([(after - 2 * position + before) / h**2, (rates[1] - rates[0]) / (2 * h)])
    np.testing.assert_allclose(path.acceleration[inner], changes[inner], atol=2e-3)


def test_the_wrenches_change_momentum_and_angular_momentum_about_the_centre_of_mass():
    """By finite differences of both momenta, without a formula for the acceleration of a body."""
    fine, h = np.linspace(0.0, 2.0, 2001), 1e-4
    chosen = np.arange(200, 1801, 50)
    rig = tl.load_rig("cogiro")
    rig = dataclasses.replace(rig, platform=dataclasses.replace(rig.platform, com=[0.1, -0.2, 0.3]))
    mass, com, inertia = rig.platform.mass, rig.platform.com.copy(), rig.platform.inertia

    def momenta(t):
        (before, turned_before), (after, turned_after), (_, turn) = turning(t - h), turning(t + h), turning(t)
        centres = [place + each.apply(com) for place, each in ((before, turned_before), (after, turned_after))]
        rate = (turned_after * turned_before.inv()).as_rotvec() / (2 * h)
        matrix = turn.as_matrix()
        angular = np.einsum("kij,kj->ki", matrix @ inertia @ matrix.transpose(0, 2, 1), rate)
        return mass * (centres[1] - centres[0]) / (2 * h), angular

    t = fine[chosen]
    place, turn = turning(fine)
    found = tl.inverse_dynamics(rig, tl.Trajectory(fine, place, turn.as_matrix()))[chosen]
    arm = turning(t)[1].apply(com)
    (linear_before, angular_before), (linear_after, angular_after) = momenta(t - 5 * h), momenta(t + 5 * h)
    force = (linear_after - linear_before) / (10 * h) + [0.0, 0.0, mass * 9.81]
    torque = (angular_after - angular_before) / (10 * h) + np.cross(arm, force)
    np.testing.assert_allclose(found, np.hstack([force, torque]), atol=0.05, rtol=1e-4)


def test_a_payload_a_requirement_and_the_trajectorys_wrenches_are_added():
    rig = tl.load_rig("cogiro")
    path = tl.Trajectory.through([rig.home, rig.home + np.eye(3)[2]], [0.0, 1.0])
    empty, up = tl.inverse_dynamics(rig, path), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    loaded = tl.inverse_dynamics(rig, path, payload=10.0)
    np.testing.assert_allclose(loaded - empty, 10.0 * (path.acceleration[:, 2:3] + 9.81) * up, atol=1e-9)
    weightless = dataclasses.replace(rig, required=tl.Requirement(wrench=7.0 * up))
    pushed = dataclasses.replace(path, wrench=np.tile([1.0, 2.0, 3.0], (len(path.times), 1)))
    found = tl.inverse_dynamics(weightless, pushed)
    expected = rig.platform.mass * path.acceleration[:, 2:3] * up[:3] + [1.0, 2.0, 10.0]
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-9)
    with pytest.raises(RigError, match=r"\[platform\] is missing; give its mass"):
        tl.inverse_dynamics(tl.load_rig("cube-8"), tl.Trajectory(path.times, path.position))
    point = dataclasses.replace(rig, platform=tl.Platform(1.0))
    place, turn = turning(path.times)
    tumbling = tl.Trajectory(path.times, place, turn.as_matrix())
    with pytest.raises(RigError, match='key "inertia" is missing'):
        tl.inverse_dynamics(point, tumbling)
    with pytest.raises(InputError, match="give a mass in kg"):
        tl.inverse_dynamics(rig, path, payload=-1.0)


TABLES = {
    "plane.csv": ("t,x,y,angle,Fx,Fy,Mz\n0,0,0.5,0,1,0,2\n1,0.1,0.5,0.2,1,0,2\n", (2,), (2, 3)),
    "space.csv": ("t,x,y,z,rx,ry,rz\n0,0,0,0,0,0,0\n1,0,0,1,0,0,0.2\n", (2, 3, 3), None),
    "forces.csv": ("t,x,y,z,Fx,Fy,Fz\n0,0,0,0,0,0,1\n1,0,0,1,0,0,1\n", None, (2, 3)),
    "program.toml": (
        "step_s = 1.0\npoints = [{time_s = 0, position = [0, 1], rotation = [0.1]}, "
        "{time_s = 1, position = [1, 1], rotation = [0.2]}]",
        (2,),
        None,
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_trajectory_is_read_from_a_file(tmp_path, name):
    text, turns, wrench = TABLES[name]
    (tmp_path / name).write_text(text)
    path = tl.read_trajectory(tmp_path / name)
    assert path.times.tolist() == [0.0, 1.0]
    assert (None if path.rotation is None else path.rotation.shape) == turns
    assert (None if path.wrench is None else path.wrench.shape) == wrench


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.csv", "x,y\n0,0\n", 'column "t" is missing'),
        ("a.csv", "t,x,y\n1,0,0\n0,0,0\n", "ascending"),
        ("a.csv", "t,x,y,Mx\n0,0,0,0\n1,0,0,0\n", "unknown column Mx"),
        ("a.txt", "", "give one that ends in .csv or .parquet"),
        ("a.toml", "points = []", "points"),
        ("a.toml", "points = [{time_s=0, position=[0,0]}, {time_s=1, position=[0,0,1]}]", "different numbers"),
        (
            "a.toml",
            "points = [{time_s=0, position=[0,0], rotation=[1]}, {time_s=1, position=[0,1]}]",
            '"rotation"',
        ),
        ("a.toml", "step_s=0.0\npoints = [{time_s=0, position=[0,0]}, {time_s=1, position=[0,1]}]", "step is 0.0"),
    ],
)
def test_a_file_that_is_no_trajectory_is_refused_by_its_name(tmp_path, name, text, match):
    (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=match) as refused:
        tl.read_trajectory(tmp_path / name)
    assert str(tmp_path / name) in str(refused.value)


def test_arrays_and_rigs_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match="3 positions for 2 times"):
        tl.Trajectory([0.0, 1.0], LIFT)
    with pytest.raises(ShapeError, match=r"velocity has shape \(3, 2\); give \(3, 3\)"):
        tl.Trajectory([0.0, 1.0, 2.0], LIFT, velocity=np.zeros((3, 2)))
    path = tl.Trajectory([0.0, 1.0, 2.0], LIFT, np.tile(np.eye(3), (3, 1, 1)))
    for rig, match in (("kntu-planar", "needs 2"), ("tetra-4", "cannot")):
        with pytest.raises(ShapeError, match=match):
            tl.inverse_dynamics(tl.load_rig(rig), path)
