"""Tendons of MuJoCo as cables: structure matrices over pulleys against forces that MuJoCo itself
applies, controls against the forces that they lead to, and runs of modules whose platform MuJoCo moves."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.errors import InputError, MissingDependency
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.world import CompliantMotion, World
from tensionlab.model.module import GRAVITY_M_S2
from tensionlab.mujoco import RigBody, TendonAllocator, gravity, structure_matrix
from tensionlab.solvers.base import Status

EXAMPLE = Path(__file__).parents[2] / "examples" / "mujoco"
RIGS = ("bartels2026-validation", "kntu-planar", "ipanema-1", "ipanema-2", "cogiro")


@pytest.fixture
def pulleys():
    """The platform of the example, off home and turned, with its winches on the floor moved."""
    model = mujoco.MjModel.from_xml_path(str(EXAMPLE / "platform.xml"))
    data = mujoco.MjData(model)
    data.qpos[:] = [0.1, -0.05, 1.1, *Rotation.from_rotvec([0.05, -0.03, 0.04]).as_quat()[[3, 0, 1, 2]]]
    data.mocap_pos[0] = [0.1, -0.05, 0.0]
    mujoco.mj_forward(model, data)
    return model, data, [model.tendon(index).name for index in range(model.ntendon)]


def test_cables_around_pulleys_pull_as_their_lengths_change(pulleys):
    model, data, tendons = pulleys
    assert (data.ten_wrapnum[:4] == 4).all()  # both sites, and where the cable meets and leaves the pulley
    found = structure_matrix(model, data, tendons, "platform")
    place, turn = data.qpos[:3].copy(), Rotation.from_matrix(data.body("platform").xmat.reshape(3, 3))
    step = 1e-5

    def lengths(twist):
        quaternion = (Rotation.from_rotvec(twist[3:]) * turn).as_quat()
        data.qpos[:] = [*(place + twist[:3]), *quaternion[[3, 0, 1, 2]]]
        mujoco.mj_forward(model, data)
        return data.ten_length.copy()

    differences = [(lengths(-step * axis) - lengths(step * axis)) / (2.0 * step) for axis in np.eye(6)]
    np.testing.assert_allclose(found, differences, atol=1e-9)


def test_the_layouts_of_the_jacobian_agree(pulleys):
    """Large models store what can be other than zero: this one has five bodies that no cable holds before it."""
    _, data, tendons = pulleys
    found = []
    for layout in ("dense", "sparse"):
        spec = mujoco.MjSpec.from_file(str(EXAMPLE / "platform.xml"))
        spec.option.jacobian = getattr(mujoco.mjtJacobian, f"mjJAC_{layout.upper()}")
        for number in range(5):
            extra = spec.worldbody.add_body(name=f"loose {number}", pos=[3.0, number, 1.0])
            extra.add_freejoint()
            extra.add_geom(size=[0.1, 0.1, 0.1])
        model = spec.compile()
        here = mujoco.MjData(model)
        first = model.joint(model.body("platform").jntadr[0]).qposadr[0]
        here.qpos[first : first + 7], here.mocap_pos[0] = data.qpos, data.mocap_pos[0]
        mujoco.mj_forward(model, here)
        found.append(structure_matrix(model, here, tendons, "platform"))
    np.testing.assert_array_equal(*found)
    np.testing.assert_allclose(found[0], structure_matrix(*pulleys, "platform"), atol=1e-14)


def test_anchors_on_a_body_that_moves_by_joints_of_its_own():
    """The wrench on the load is that of the cables at it, not what the crane feels."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body name="crane" pos="0 0 3"><joint name="swing" type="hinge" axis="0 1 0"/><geom size="0.1"/>
        <site name="a" pos="1 0 0"/><site name="b" pos="-1 0.5 0"/></body>
      <body name="load" pos="0 0 1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
        <joint type="slide" axis="0 0 1"/><geom size="0.1"/><site name="hook"/></body>
      </worldbody><tendon>
      <spatial name="a"><site site="a"/><site site="hook"/></spatial>
      <spatial name="b"><site site="b"/><site site="hook"/></spatial></tendon></mujoco>""")
    data = mujoco.MjData(model)
    data.joint("swing").qpos = 0.4
    mujoco.mj_forward(model, data)
    rays = data.site_xpos[:2] - data.site("hook").xpos
    expected = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).T
    np.testing.assert_allclose(structure_matrix(model, data, ["a", "b"], "load"), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("joints", "names", "message"),
    [
        ("<freejoint/>", ("a", "lode"), "the model has no body 'lode'; it has 'world', 'load'"),
        ("<freejoint/>", ("rope", "load"), "the model has no tendon 'rope'; it has 'a'"),
        ("", ("a", "load"), "body 'load' has no joint"),
        ('<joint type="slide" axis="1 1 0"/>', ("a", "load"), "moves by 1 joint velocities along or about 2 axes"),
    ],
)
def test_names_and_joints_that_do_not_fit_are_told(joints, names, message):
    model = mujoco.MjModel.from_xml_string(hanging(joints=joints))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with pytest.raises(InputError, match=message):
        structure_matrix(model, data, names[:1], names[1])


FORCE_RANGE = 'actuatorfrclimited="true" actuatorfrcrange="-1 5"'


def hanging(joints="<freejoint/>", actuators="", tendon=""):
    """A load on one cable."""
    return f"""<mujoco><worldbody><site name="top" pos="0 0 2"/>
      <body name="load">{joints}<geom size="0.1"/><site name="hook"/></body></worldbody>
      <tendon><spatial name="a" {tendon}><site site="top"/><site site="hook"/></spatial></tendon>
      <actuator>{actuators}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("actuator", "tendon", "limits"),
    [
        ('<motor tendon="a" gear="-1" ctrlrange="1 6"/>', "", (1.0, 6.0)),
        ('<motor tendon="a" gear="-2" ctrlrange="-3 6"/>', "", (0.0, 12.0)),  # it cannot push
        ('<motor tendon="a" ctrlrange="-7 -2"/>', "", (2.0, 7.0)),
        ('<motor tendon="a" gear="-2" ctrlrange="0 6" forcerange="0.5 4"/>', "", (1.0, 8.0)),
        ('<motor tendon="a" gear="-1" ctrlrange="0 9"/>', FORCE_RANGE, (0.0, 5.0)),
        ('<general tendon="a" gear="-0.5" gainprm="10" ctrlrange="0.2 1"/>', "", (1.0, 5.0)),
    ],
)
def test_limits_are_those_of_the_actuators_and_controls_lead_to_the_tensions(actuator, tendon, limits):
    model = mujoco.MjModel.from_xml_string(hanging(actuators=actuator, tendon=tendon))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    allocate = TendonAllocator(model, ["a"], "load")
    assert (float(allocate.lower[0]), float(allocate.upper[0])) == pytest.approx(limits)
    for share in (0.0, 0.3, 1.0):
        tension = limits[0] + share * (limits[1] - limits[0])
        found = allocate(data, [0.0, 0.0, tension, 0.0, 0.0, 0.0])
        mujoco.mj_forward(model, data)
        assert found.status == Status.EXACT
        np.testing.assert_allclose(data.qfrc_actuator, [0.0, 0.0, tension, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        ("", "tendon 'a' has no actuator; give it one"),
        ('<motor name="one" tendon="a"/><motor name="two" tendon="a"/>', "has 2 actuators, 'one', 'two'"),
        ('<position name="servo" tendon="a" kp="3"/>', "'servo' of tendon 'a' does not pull by its control times"),
        ('<motor name="strong" tendon="a" gear="-1"/>', "actuator 'strong' of tendon 'a' has no limit"),
        ('<motor name="pusher" tendon="a" ctrlrange="0 5"/>', "cannot pull: .* tensions from 0 to 0 N"),
    ],
)
def test_actuators_that_cannot_be_given_tensions_are_refused(actuators, message):
    model = mujoco.MjModel.from_xml_string(hanging(actuators=actuators))
    with pytest.raises(InputError, match=message):
        TendonAllocator(model, ["a"], "load")


def test_forces_over_pulleys_balance_gravity_exactly(pulleys):
    model, data, tendons = pulleys
    allocate = TendonAllocator(model, tendons, "platform", reference="middle")
    found = allocate(data, -gravity(model, data, "platform"))
    mujoco.mj_forward(model, data)
    assert found.status == Status.EXACT
    np.testing.assert_allclose(data.qacc, 0.0, atol=1e-9)
    # An infeasible wrench, and actuators of other tendons.
    data.ctrl[:] = 7.0
    found = TendonAllocator(model, tendons[:4], "platform")(data, [0.0, 0.0, 1000.0, 0.0, 0.0, 0.0])
    assert found.status == Status.NEAREST
    np.testing.assert_array_equal(data.ctrl[4:], 7.0)
    np.testing.assert_allclose(data.ctrl[:4], found.tensions)


def test_without_mujoco_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingDependency, match=r'needs mujoco: pip install "tensionlab\[mujoco\]"'):
        RigBody(tl.load_rig("floor-3"))


@pytest.mark.parametrize("name", RIGS)
def test_a_released_body_falls_from_its_own_place(name):
    rig = replace(tl.load_rig(name), up="y")
    body = RigBody(rig, position=rig.home + 0.01)
    assert isinstance(body, CompliantMotion)
    body.apply_tensions(np.zeros(rig.m))
    held = body(1.0)
    np.testing.assert_array_equal(held.position, rig.home + 0.01)
    np.testing.assert_allclose(body.lengths, rig.lengths(*held), atol=1e-12)
    body.held = False
    fallen = body(1.1)
    com = np.zeros(rig.dimension) if rig.platform is None or rig.platform.com is None else rig.platform.com
    if not com.any():  # it turns where it is not held at the centre of its mass
        assert fallen.position[1] - held.position[1] == pytest.approx(-GRAVITY_M_S2 * 0.1**2 / 2.0, rel=0.011)
    np.testing.assert_allclose(body.lengths, rig.lengths(*fallen), atol=1e-12)


def test_tensions_beyond_the_rigs_limits_act_too():
    rig = tl.load_rig("bartels2026-validation")
    body = RigBody(replace(rig, up=None))
    body.held = False
    tensions = np.array([0.0, 0.1, 0.0, 20.0])
    body.apply_tensions(tensions)
    moved = body(1e-3).position - rig.home
    np.testing.assert_allclose(moved, 1e-6 * rig.structure_matrix(rig.home) @ tensions, rtol=1e-9)


@pytest.mark.parametrize("solver", ["newton", "dykstra", "qp"])
def test_a_run_keeps_a_mass_of_mujoco_on_a_circle(solver):
    rig = replace(tl.load_rig("bartels2026-validation"), platform=tl.Platform(0.2))
    body = RigBody(rig)
    world = World(rig, body)
    errors = []

    def demand(state):
        body.held = False
        angle = 2.0 * np.pi * state.time / 4.0
        target = rig.home + 0.05 * np.array([np.cos(angle) - 1.0, 0.0, np.sin(angle) * min(state.time, 1.0)])
        errors.append(np.linalg.norm(world.pose.position - target))
        return Demand(0.2 * (100.0 * (target - state.pose.position) - 12.0 * state.twist[:3]) - rig.weight)

    settings = RunSettings(rate=100.0)
    runner = Runner(rig, world.group(), solver, demand, settings, clock=WorldClock(world))
    runner.run(2.0)
    assert runner.statistics.statuses == {Status.EXACT: 200}
    assert max(errors) < 0.03


@pytest.mark.slow
def test_the_example_holds_follows_and_lands():
    command = [sys.executable, str(EXAMPLE / "controller.py")]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    numbers = [[float(word) for word in line.replace(",", "").split() if word[0].isdigit()] for line in lines]
    (holds,), (follows,), (speed, height), (lower, upper) = numbers
    assert holds < 0.01
    assert follows < 5.0
    assert speed < 0.2
    assert height == pytest.approx(0.05, abs=0.002)  # it lies on the floor
    assert 1.0 <= lower < upper <= 100.0


def test_planned_tensions_alone_carry_a_platform_within_a_millimetre():
    out = subprocess.run(
        [sys.executable, str(EXAMPLE / "carry.py")], capture_output=True, text=True, check=True
    ).stdout
    error, turn = (float(word) for word in re.findall(r"largest \w+ ([0-9.]+)", out))
    assert "EXACT" in out
    assert "6.79 m/s²" in out
    assert error < 1.0
    assert turn < 0.01
