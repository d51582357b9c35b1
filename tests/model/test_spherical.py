"""Rigs whose platform turns about a fixed point, against moments computed by hand."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.errors import RigError, ShapeError, SweepError
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model.module import KINDS

ANCHORS = np.array(
    [[0.08, -0.24, 0.29], [0.21, 0.16, 0.08], [0.03, -0.12, 0.25],
     [-0.15, -0.11, 0.24], [0.06, -0.22, 0.03], [0.25, -0.02, 0.18]]
)  # fmt: skip
ATTACHMENTS = np.array(
    [[0.03, 0.02, 0.07], [0.09, -0.07, 0.27], [0.07, -0.02, 0.10],
     [0.06, -0.03, 0.18], [0.08, 0.11, 0.16], [-0.06, 0.09, 0.24]]
)  # fmt: skip
CENTRE = np.array([0.0, 0.0, 0.05])
BODY = tl.Platform(2.0, com=[0.0, 0.02, 0.15], inertia=np.diag([0.02, 0.02, 0.01]))


def rig_of(**changes):
    modules = tuple(
        tl.Module(f"m{i}", anchor, 1.0, 50.0, attachment=arm)
        for i, (anchor, arm) in enumerate(zip(ANCHORS, ATTACHMENTS, strict=True))
    )
    return tl.Rig("wrist", "spherical", modules, home=CENTRE, platform=BODY, up="z", **changes)


RIG = rig_of()
TURNS = Rotation.from_rotvec(np.random.default_rng(0).uniform(-0.5, 0.5, (300, 3))).as_matrix()


def moments(R, anchors=ANCHORS):
    """Return the moment of each cable under a tension of 1 N, (3, m), about the centre."""
    columns = []
    for anchor, attachment in zip(anchors, ATTACHMENTS, strict=True):
        arm = R @ attachment
        pull = anchor - (CENTRE + arm)
        columns.append(np.cross(arm, pull / np.linalg.norm(pull)))
    return np.array(columns).T


def test_a_spherical_rig_exerts_moments_alone():
    assert (RIG.n, RIG.m, RIG.dimension) == (3, 6, 3)
    for R in TURNS[:20]:
        np.testing.assert_allclose(RIG.structure_matrix(CENTRE, R), moments(R), atol=1e-15)
        weight = np.cross(R @ BODY.com, [0.0, 0.0, -2.0 * 9.81])
        np.testing.assert_allclose(RIG.gravity(R), weight, atol=1e-14)
    turned = rig_of(home_rotation=[0.1, 0.2, -0.3])
    R = Rotation.from_rotvec([0.1, 0.2, -0.3]).as_matrix()
    np.testing.assert_allclose(turned.structure_matrix(turned.home), moments(R), atol=1e-15)


def test_moments_are_minus_the_derivatives_of_the_lengths():
    step = 1e-6
    for R in TURNS[:5]:
        turned = Rotation.from_rotvec(step * np.concatenate([np.eye(3), -np.eye(3)])).as_matrix() @ R
        lengths = RIG.lengths(CENTRE, turned)
        slope = (lengths[:3] - lengths[3:]) / (2 * step)
        np.testing.assert_allclose(RIG.structure_matrix(CENTRE, R), -slope, atol=1e-8)


def test_tensions_render_moments_where_a_linear_program_has_some():
    rng, seen = np.random.default_rng(1), set()
    for R in TURNS[:60]:
        moment = rng.normal(scale=2.0, size=3)
        answer = RIG.allocate(moment, rotation=R)
        program = linprog(np.zeros(6), A_eq=moments(R), b_eq=moment, bounds=[(1.0, 50.0)] * 6, method="highs")
        assert (answer.status == tl.Status.EXACT) == program.success
        if program.success:
            np.testing.assert_allclose(moments(R) @ answer.tensions, moment, atol=1e-9)
        seen.add(program.success)
    assert seen == {True, False}


def test_sweeps_over_orientations_have_the_metrics_of_each():
    required = tl.Requirement(gravity=True, box=[0.2, 0.2, 0.05])
    turns = TURNS[:120]
    poses = tl.workspace.PoseList(np.tile(CENTRE, (len(turns), 1)), turns)
    names = ["wrench-feasible", "capacity-margin", "wrench-closure"]
    found = tl.sweep(RIG, poses, names, required=required)
    feasible = []
    for R in turns:
        corners = required.at(RIG, R)
        programs = (linprog(np.zeros(6), A_eq=moments(R), b_eq=each, bounds=[(1.0, 50.0)] * 6) for each in corners)
        feasible.append(all(program.success for program in programs))
    np.testing.assert_array_equal(found["wrench-feasible"].values[0] > 0, feasible)
    margin = tl.workspace.capacity_margin(np.stack(list(map(moments, turns))), RIG.limits, required.at(RIG, turns))
    np.testing.assert_allclose(found["capacity-margin"].values[0], margin, atol=1e-9)
    assert 0.05 < np.mean(feasible) < 0.95


def test_a_file_keeps_a_spherical_rig(tmp_path):
    tl.save_rig(RIG, tmp_path / "wrist.toml")
    assert tl.load_rig(tmp_path / "wrist.toml") == RIG


def test_pulleys_lead_the_cables_of_a_spherical_rig():
    modules = [dataclasses.replace(each, pulley_radius=1e-7, pulley_axis=[0.3, 0.2, 1.0]) for each in RIG.modules]
    led = dataclasses.replace(RIG, modules=tuple(modules))
    np.testing.assert_allclose(led.structure_matrix(CENTRE, TURNS[0]), moments(TURNS[0]), atol=1e-6)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: RIG.structure_matrix([0.0, 0.0, 0.1]), ShapeError, "turns about its home"),
        (lambda: tl.sweep(RIG, [[0.0, 0.0, 0.1]], "wrench-closure"), SweepError, "turns about its home"),
        (
            lambda: tl.workspace.certify(RIG, [(-1, 1)] * 3, None, 0.1),
            RigError,
            "proofs of a workspace need another",
        ),
        (lambda: RIG.forward_kinematics(np.ones(6)), RigError, "forward kinematics need another kind"),
        (lambda: tl.workspace.rig_margin_gradient(RIG, CENTRE), RigError, "gradients of margins"),
        (lambda: rig_to_mjcf(RIG), RigError, "MuJoCo models"),
        (lambda: tl.Requirement(acceleration=1.0).at(RIG), RigError, "give its torques as a box"),
    ],
)
def test_what_needs_a_platform_that_moves_is_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()
    assert KINDS["spherical"].turns == 3
