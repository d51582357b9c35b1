"""Cables over pulleys: known lengths, forces that are derivatives, and the same in all that knows them."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.errors import RigError
from tensionlab.hardware import Runner, RunSettings, World, WorldClock
from tensionlab.hardware.calibration.anchors import Poses, calibrate_anchors
from tensionlab.hardware.log.scene import SceneEncoder
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tensionlab.hardware.runner.state_estimation import PoseTracker
from tensionlab.model.kinematics import exponential
from tensionlab.model.pose import place_anchors, place_axes, to_module_frames
from tensionlab.model.pulleys import arcs, ways
from tensionlab.viewer import run_scene
from tensionlab.viewer.design_scene import draw
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.state import begin
from tensionlab.workspace import Grid, body_distance, rig_margin_gradient
from tests.helpers.examples import many
from tests.helpers.runs import cycles

RADIUS = 0.05
RIGS = ("bartels2026-validation", "kntu-planar", "ipanema-1", "body-mounted")


def over_pulleys(rig, radius=RADIUS, seed=0):
    """The same rig with a pulley at every second module, swivelling about some axis."""
    rng = np.random.default_rng(seed)
    keys = {"pulley_radius": radius}
    modules = [
        replace(module, pulley_axis=rng.normal(size=rig.dimension), **keys) if number % 2 == 0 else module
        for number, module in enumerate(rig.modules)
    ]
    return replace(rig, modules=tuple(modules))


def around(rig):
    """The same with axes at right angles to the cables at home, which go about a quarter round."""
    ends, frames = rig.home + rig.attachments, rig.at_rest
    away = ends - place_anchors(rig.modules, rig.anchors, frames)
    side = np.random.default_rng(2).normal(size=away.shape)
    across = side - np.sum(side * away, axis=1, keepdims=True) / np.sum(away**2, axis=1, keepdims=True) * away
    axes = to_module_frames(rig.modules, across, frames)
    modules = [
        m if m.pulley_radius is None else replace(m, pulley_axis=a) for m, a in zip(rig.modules, axes, strict=True)
    ]
    return replace(rig, modules=tuple(modules))


def poses(rig, count, seed=1):
    """Positions about home, rotations, and frames, for each of which there are as many."""
    rng, d = np.random.default_rng(seed), rig.dimension
    position = rig.home + 0.2 * rng.uniform(-1, 1, (count, d)) * np.ptp(rig.anchors, axis=0)
    frames = {name: (0.1 * rng.normal(size=(count, d)), turns(rng, d, count)) for name in rig.frames}
    return position, turns(rng, d, count) if rig.n > d else None, frames


def turns(rng, dimension, count):
    return rng.normal(size=count) * 0.4 if dimension == 2 else exponential(0.4 * rng.normal(size=(count, 3)))


def one_pulley(attachment, radius=0.5):
    """A cable that comes along y to a pulley at the origin, in the plane."""
    module = tl.Module("one", [0.0, 0.0], 0.0, 1.0, pulley_radius=radius, pulley_axis=[0.0, 2.0])
    rig = tl.Rig("one", "planar-point", (module,), home=attachment)
    return rig.cables(attachment)


@pytest.mark.parametrize(
    ("attachment", "arc", "straight", "direction"),
    [
        ([1.0, -2.0], np.pi, 2.0, [0.0, 1.0]),  # half round, and down beside
        ([-1.0, -2.0], np.pi, 2.0, [0.0, 1.0]),  # the pulley swivels to the other side
        ([3.0, 0.5], np.pi / 2, 2.5, [-1.0, 0.0]),  # over the top, level
        ([0.0, 2.0], 0.0, 2.0, [0.0, -1.0]),  # straight on
        ([0.0, -2.0], np.pi + 2 * np.arctan2(0.5, 2.0), 2.0, None),  # back past the cable that comes
    ],
)
def test_lengths_and_directions_that_a_ruler_gives(attachment, arc, straight, direction):
    found = one_pulley(attachment)
    np.testing.assert_allclose(found.lengths, 0.5 * arc + straight, rtol=1e-14)
    np.testing.assert_allclose(found.straight, straight, rtol=1e-14)
    if direction is not None:
        np.testing.assert_allclose(found.directions[0], direction, atol=1e-15)


def test_the_straight_part_is_a_tangent_of_the_rim_that_goes_on_in_its_sense():
    rng = np.random.default_rng(3)
    for _ in range(many(50)):
        attachment = np.array([rng.uniform(1.1, 3.0), rng.uniform(-3.0, 3.0)])
        found = one_pulley(attachment)
        out = (
            attachment + found.straight[0] * found.directions[0] - [0.5, 0.0]
        )  # from the centre to where it leaves
        assert np.linalg.norm(out) == pytest.approx(0.5, rel=1e-12)
        clockwise = np.array([out[1], -out[0]]) / 0.5
        np.testing.assert_allclose(-found.directions[0], clockwise, atol=1e-12)
        arc = (found.lengths[0] - found.straight[0]) / 0.5
        np.testing.assert_allclose(out / 0.5, [-np.cos(arc), np.sin(arc)], atol=1e-12)


@pytest.mark.parametrize("name", RIGS)
def test_arcs_go_from_the_anchors_to_the_straight_parts(name):
    rig = over_pulleys(tl.load_rig(name))
    own = replace(rig, modules=tuple(replace(module, frame="world") for module in rig.modules), rest=())
    cables, ends = own.cables(own.home), own.home + own.attachments
    points = own.anchors + arcs(own.anchors - ends, own.pulleys, 2001)
    np.testing.assert_allclose(points[0], own.anchors, atol=1e-15)
    np.testing.assert_allclose(points[-1], ends + cables.straight[:, None] * cables.directions, atol=1e-12)
    length = np.linalg.norm(np.diff(points, axis=0), axis=2).sum(axis=0)
    np.testing.assert_allclose(length, cables.lengths - cables.straight, atol=1e-6)


@pytest.mark.parametrize("name", RIGS)
def test_the_structure_matrix_is_minus_the_derivative_of_the_lengths(name):
    rig = over_pulleys(tl.load_rig(name))
    position, rotation, frames = poses(rig, 50)
    W = rig.structure_matrix(position, rotation, frames)
    step = 1e-5
    for row, axis in enumerate(np.eye(rig.n)):
        ends = []
        for sign in (1.0, -1.0):
            twist, turned = sign * step * axis, rotation
            if rig.n == 6:
                turned = exponential(twist[3:]) @ rotation
            elif rig.n > rig.dimension:
                turned = rotation + twist[2]
            ends.append(rig.lengths(position + twist[: rig.dimension], turned, frames))
        np.testing.assert_allclose(W[:, row], (ends[1] - ends[0]) / (2 * step), atol=1e-9)


@pytest.mark.parametrize("name", RIGS)
def test_a_tiny_pulley_is_a_fixed_anchor(name):
    rig = tl.load_rig(name)
    here = poses(rig, 20)
    small = over_pulleys(rig, 1e-13)
    np.testing.assert_allclose(small.lengths(*here), rig.lengths(*here), atol=1e-12)
    np.testing.assert_allclose(small.structure_matrix(*here), rig.structure_matrix(*here), atol=1e-10)


@pytest.mark.parametrize("name", RIGS)
def test_a_pose_is_found_by_its_lengths(name):
    rig = over_pulleys(tl.load_rig(name))
    if rig.m < rig.n:
        return
    position, rotation, frames = poses(rig, 20)
    found = rig.forward_kinematics(
        rig.lengths(position, rotation, frames), position + 0.01, None if rotation is None else rotation, frames
    )
    np.testing.assert_allclose(found.position, position, atol=1e-9)
    assert (found.residual < 1e-10).all()


@pytest.mark.parametrize("name", ["bartels2026-validation", "kntu-planar", "ipanema-1"])
def test_the_tracker_of_a_run_finds_the_same_pose(name):
    rig = over_pulleys(tl.load_rig(name))
    position, rotation, _ = (each if each is None or isinstance(each, dict) else each[0] for each in poses(rig, 1))
    lengths = rig.lengths(position, rotation)
    pose, structure = PoseTracker(rig).search(lengths, np.ones(rig.m, dtype=bool))
    np.testing.assert_allclose(rig.lengths(pose.position, pose.rotation), lengths, atol=1e-9)
    np.testing.assert_allclose(structure, rig.structure_matrix(pose.position, pose.rotation), atol=1e-9)


@pytest.mark.parametrize("name", RIGS)
def test_a_sweep_has_the_same_structure_matrices(name):
    rig = over_pulleys(tl.load_rig(name))
    axes = [here + np.linspace(-0.1, 0.1, 3) for here in rig.home]
    frames = rig.at_rest
    data = tl.sweep(rig, Grid(*axes), ["tension-factor"], frames=frames)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    W = rig.structure_matrix(points, None, frames)
    expected = tl.workspace.tension_factor(W)
    np.testing.assert_allclose(data["tension-factor"].squeeze("rig"), expected, atol=1e-9)


@pytest.mark.parametrize("name", ["bartels2026-validation", "ipanema-1"])
def test_margins_have_the_derivative_that_differences_give(name):
    rig = over_pulleys(tl.load_rig(name))
    position, rotation, _ = poses(rig, 1, seed=5)
    position, rotation = position[0], None if rotation is None else rotation[0]

    def margin(rig, position):
        return float(tl.workspace.capacity_margin(rig.structure_matrix(position, rotation), rig.limits))

    def moved(module, number, vector, end):
        if module is not rig.modules[number]:
            return module
        return replace(module, **{end: getattr(module, end) + vector})

    found, step = rig_margin_gradient(rig, position, rotation), 1e-6
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        slope = (margin(rig, position + shift) - margin(rig, position - shift)) / (2 * step)
        assert found.position[axis] == pytest.approx(slope, abs=1e-5 * max(1.0, abs(slope)))
    gradients = {"anchor": found.anchors, "attachment": found.attachments}
    assert (found.attachments is None) == (rig.n == 3)
    for number, axis, end in product(range(rig.m), range(3), gradients if rig.n == 6 else ["anchor"]):
        shift = step * np.eye(3)[axis]
        ends = [
            margin(
                replace(rig, modules=tuple(moved(each, number, sign * shift, end) for each in rig.modules)),
                position,
            )
            for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * step)
        assert gradients[end][number, axis] == pytest.approx(slope, abs=1e-5 * max(1.0, abs(slope)))


def test_anchors_of_pulleys_are_calibrated():
    """The same rig a few centimetres off: its lengths bring its anchors back."""
    rig = over_pulleys(tl.load_rig("cube-8"))
    rng = np.random.default_rng(0)
    off = [replace(each, anchor=each.anchor + 0.02 * rng.normal(size=3)) for each in rig.modules]
    true = replace(rig, modules=tuple(off))
    position = rng.uniform(-0.4, 0.4, (40, 3))
    found = calibrate_anchors(rig, true.lengths(position), Poses.at(rig, position, None), known=True)
    np.testing.assert_allclose(found.anchors, true.anchors, atol=1e-8)


def test_distances_are_those_of_the_straight_part():
    """A cable that comes up to its pulley, and leaves it level, above the straight line from its anchor."""
    module = tl.Module("one", [-1.0, 0.0, 0.5], 0.0, 1.0, pulley_radius=0.1, pulley_axis=[0.0, 0.0, 1.0])
    rig = tl.Rig("one", "point", (module,), home=[0.0, 0.0, 0.6])
    expected = {(-0.5, 0.0, 0.6): 0.0, (-0.9, 0.0, 0.6): 0.0, (-1.0, 0.0, 0.5): np.hypot(0.1, 0.1)}
    for place, distance in expected.items():
        found = body_distance(rig, rig.home, bodies=[tl.Body("dot", place, radius=1e-13)]).distance
        assert found == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("name", ["kntu-planar", "bartels2026-validation", "ipanema-1", "body-mounted"])
def test_mujoco_has_the_same_lengths_and_structure_matrices(name):
    """Once its pulleys have swivelled to where the cables pull them."""
    mujoco = pytest.importorskip("mujoco")
    from tensionlab.mujoco import RigBody, structure_matrix

    rig = around(over_pulleys(tl.load_rig(name)))
    home = np.array([0.05, 0.35, 0.1]) if name == "body-mounted" else rig.home
    body = RigBody(rig)
    model, data, tendons = body.model, body.data, [module.name for module in rig.modules]
    rng = np.random.default_rng(0)
    for _ in range(20):
        position = home + 0.05 * rng.uniform(-1, 1, rig.dimension)
        turn = 0.2 * rng.normal(size=3)
        rotation = None
        data.qpos[: rig.dimension] = position
        if rig.kind == "platform":
            rotation = Rotation.from_rotvec(turn).as_matrix()
            mujoco.mju_mat2Quat(data.qpos[3:7], rotation.ravel())
        elif rig.kind == "planar":
            rotation = data.qpos[2] = turn[2]
        body.turn_pulleys()
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(
            data.ten_length,
            rig.lengths(position, rotation, rig.at_rest),
            atol=1e-7,  # its anchors are off the rim
        )
        np.testing.assert_allclose(
            structure_matrix(model, data, tendons, "platform"),
            rig.structure_matrix(position, rotation, rig.at_rest),
            atol=1e-13,
        )


def test_a_world_of_mujoco_has_pulleys_that_swivel():
    """While a platform goes round: the run, which knows the pulleys, is where MuJoCo has it."""
    pytest.importorskip("mujoco")
    from tensionlab.mujoco import RigBody

    rig = around(over_pulleys(tl.load_rig("bartels2026-validation"), 0.03))
    rig = replace(rig, platform=tl.Platform(mass=0.1))
    body = RigBody(rig)
    world, off = World(rig, body), []

    def demand(state):
        body.held = False
        around = [0.05 * np.sin(3 * state.time), 0.0, 0.05 * np.cos(3 * state.time) - 0.05]
        off.append(np.linalg.norm(state.pose.position - body.data.qpos[:3]))
        spring = 60.0 * (rig.home + around - state.pose.position)
        return Demand(spring - 4.0 * body.data.qvel[:3] - rig.weight)

    Runner(rig, world.group(), "newton", demand, RunSettings(rate=200.0), clock=WorldClock(world)).run(1.0)
    before = RigBody(rig).model.body_quat
    assert np.abs(body.model.body_quat - before).max() > 0.01, "the pulleys have turned"
    assert max(off) < 1e-3


def test_pulleys_are_read_and_written(tmp_path):
    rig = over_pulleys(tl.load_rig("bartels2026-validation"))
    tl.save_rig(rig, tmp_path / "rig.toml")
    assert tl.load_rig(tmp_path / "rig.toml") == rig
    shared = replace(rig, modules=tuple(replace(m, pulley_radius=0.1, pulley_axis=[0, 1, 0]) for m in rig.modules))
    tl.save_rig(shared, tmp_path / "shared.toml")
    text = (tmp_path / "shared.toml").read_text(encoding="utf-8")
    assert text.count("pulley") == 2
    assert tl.load_rig(tmp_path / "shared.toml") == shared


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"pulley_radius": 0.1}, '"pulley_axis" is missing'),
        ({"pulley_axis": [0, 0, 1]}, '"pulley_radius" is missing'),
        ({"pulley_radius": 0.0, "pulley_axis": [0, 0, 1]}, "above zero"),
        ({"pulley_radius": 0.1, "pulley_axis": [0, 1]}, "3 coordinates"),
        ({"pulley_radius": 0.1, "pulley_axis": [0, 0, 0]}, "not all zero"),
        ({"pulley_radius": 0.1, "pulley_axis": [0, 0, np.nan]}, "finite"),
    ],
)
def test_what_is_no_pulley_is_refused(keys, message):
    with pytest.raises(RigError, match=message):
        tl.Module("one", [0.0, 0.0, 0.0], 0.0, 1.0, **keys)


def test_an_attachment_in_a_pulley_is_refused():
    with pytest.raises(RigError, match=r'"one" \(index 0\): the attachment lies in its pulley'):
        one_pulley([0.6, 0.1])


# As they are drawn


def lengths_of(points):
    """Lengths (m,) of cables with points (k, m, d)."""
    return np.linalg.norm(np.diff(points, axis=0), axis=-1).sum(axis=0)


def lengths_of_lines(lines, rig):
    """The same of lines (k m, 2, 3), which are of one cable after another."""
    return np.linalg.norm(lines[:, 1] - lines[:, 0], axis=-1).reshape(-1, rig.m).sum(axis=0)


@pytest.mark.parametrize("name", RIGS)
def test_drawn_cables_go_over_their_pulleys(name):
    """A drawn arc is shorter than the rim by some hundredths of a per cent: so many corners it has."""
    rig = around(over_pulleys(tl.load_rig(name)))
    ends, frames = rig.home + rig.attachments, rig.at_rest
    anchors = place_anchors(rig.modules, rig.anchors, frames)
    points = ways(ends, anchors, rig.pulleys_in_world(frames))
    np.testing.assert_array_equal(points[0], ends)
    np.testing.assert_allclose(points[-1], anchors, atol=1e-12)
    lengths = rig.lengths(rig.home, frames=frames)
    arc = lengths - rig.cables(rig.home, frames=frames).straight
    drawn = lengths_of(points)
    assert (drawn <= lengths + 1e-12).all()
    assert (drawn >= lengths - 1e-3 * arc - 1e-12).all()
    assert (arc[::2] > 0.5 * RADIUS).all()
    np.testing.assert_array_equal(lengths_of(ways(ends, anchors, None)), np.linalg.norm(ends - anchors, axis=-1))


@pytest.mark.parametrize("name", ["bartels2026-validation", "kntu-planar"])
def test_the_design_page_and_runs_draw_them_so(name):
    rig = around(over_pulleys(tl.load_rig(name)))
    state = begin(rig)
    scene = draw(state, evaluate(state)).rig
    np.testing.assert_allclose(lengths_of_lines(scene.cables.points, rig), rig.lengths(rig.home), rtol=1e-3)
    assert len(scene.cables.colours) == len(scene.cables.points)
    *_, cycle = cycles(rig, 3)
    lengths = rig.lengths(*cycle.state.pose)
    row = {name: np.asarray(column.value(cycle, rig)) for name, column in COLUMNS.items()}
    scene = run_scene.draw_instant(rig, run_scene.Instant.of(rig, row))
    np.testing.assert_allclose(lengths_of_lines(scene.cables.points, rig), lengths, rtol=1e-3)
    (line,) = json.loads(SceneEncoder(rig).encode(cycle, 0))["entities"][0]["lines"]
    points = np.array([[each[axis] for axis in "xyz"] for each in line["points"]]).reshape(-1, 2, 3)
    np.testing.assert_allclose(lengths_of_lines(points, rig), lengths, rtol=1e-3)
    assert len(line["colors"]) == len(line["points"])


def test_vectors_in_the_axes_of_bodies_turn_back_into_the_world():
    rig = tl.load_rig("body-mounted")
    frames = {name: ([0.1, 0.2, 0.3], Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()) for name in rig.frames}
    vectors = np.random.default_rng(3).normal(size=(rig.m, 3))
    own = to_module_frames(rig.modules, vectors, frames)
    riding = np.array([module.frame != "world" for module in rig.modules])
    assert (np.linalg.norm(own - vectors, axis=1) > 0.01).tolist() == riding.tolist()
    np.testing.assert_allclose(place_axes(rig.modules, own, frames), vectors, atol=1e-12)
