"""What a sweep says is what a direct call says, and it is labelled."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import tensionlab as tl
from tensionlab import _native
from tensionlab.errors import InputError, RigError, SweepError
from tensionlab.model.directions import fibonacci
from tensionlab.model.kinematics import exponential, planar_rotation
from tensionlab.workspace.interference import body_distance, cable_distance
from tensionlab.workspace.metrics import METRICS, Metric, metric
from tensionlab.workspace.poses import Grid, PoseList, box
from tensionlab.workspace.structure_metrics import (
    feasible_direction_fraction,
    squared_tension,
    tension_factor,
    wrench_closure,
)
from tensionlab.workspace.sweep.plan import vary
from tensionlab.workspace.wrench_set import capacity_margin

CUBE = tl.box_corners([2.0, 1.0, 3.0])
FORCES = fibonacci(200)


def held(kind, dimension):
    """A point or body held from the corners of a box, in the plane or in space."""
    arm = np.array([0.1, 0.2, -0.1])[:dimension] * (not kind.endswith("point"))
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=dimension)))
    modules = [
        tl.Module(str(i), corner * [2, 3, 1][:dimension], 1.0, 50.0, corner * arm)
        for i, corner in enumerate(corners)
    ]
    return tl.Rig(kind, kind, tuple(modules), np.zeros(dimension))


def test_values_are_those_of_a_direct_call_whatever_the_chunks():
    poses = Grid(np.linspace(-0.8, 0.8, 7), np.linspace(-0.4, 0.4, 5), np.linspace(-1.2, 1.2, 6))
    position = np.stack(np.meshgrid(poses.x, poses.y, poses.z, indexing="ij"), axis=-1)
    structure = CUBE.structure_matrix(position)
    expected = {
        "capacity-margin": capacity_margin(structure, CUBE.limits),
        "wrench-closure": wrench_closure(structure),
        "tension-factor": tension_factor(structure),
        "feasible-direction-fraction:3.0": feasible_direction_fraction(structure, CUBE.limits, FORCES, 3.0),
        "squared-tension:worst": squared_tension(structure, CUBE.limits, FORCES, 1.0)[1],
    }
    data = tl.sweep(CUBE, poses, list(expected), chunk=11)
    for name, values in expected.items():
        assert data[name].dims == ("rig", "x", "y", "z")
        np.testing.assert_allclose(data[name].sel(rig="box-corners"), values, rtol=1e-12, atol=1e-12)
    xr.testing.assert_equal(data, tl.sweep(CUBE, poses, list(expected)))


@pytest.mark.parametrize(
    ("kind", "dimension"), [("planar-point", 2), ("point", 3), ("planar", 2), ("platform", 3)]
)
@pytest.mark.parametrize("count", [1, 8, 13])
def test_structure_matrices_of_a_batch_are_those_of_the_rig(kind, dimension, count):
    rng = np.random.default_rng(count)
    rig = CUBE if kind == "point" else held(kind, dimension)
    position = rng.uniform(-0.4, 0.4, (count, dimension))
    turns, matrices = None, None
    if rig.n > rig.dimension:
        turns = rng.normal(size=count) if dimension == 2 else exponential(rng.normal(size=(count, 3)))
        matrices = planar_rotation(turns) if dimension == 2 else turns
    attachments = rig.attachments if rig.n > rig.dimension else None
    for given, turn in ((turns, matrices), (None, None)):
        found, sound = _native.structure_matrices(rig.anchors, attachments, position, turn, None, None, 1e-12)
        np.testing.assert_allclose(found, rig.structure_matrix(position, given), rtol=0, atol=2e-15)
        assert sound.all()
    position[count // 2] = rig.anchors[0] - (0 if attachments is None else attachments[0])
    found, sound = _native.structure_matrices(rig.anchors, attachments, position, None, None, None, 1e-12)
    assert np.flatnonzero(~sound).tolist() == [count // 2]
    assert np.isfinite(found).all()


def test_platforms_are_swept_over_orientations_too():
    rig, turns = held("platform", 3), exponential(np.array([[0.0, 0.0, 0.0], [0.1, 0.2, -0.1]]))
    data = tl.sweep(rig, Grid([0.0, 0.3], [0.1], [-0.2, 0.2, 0.3], turns), ["tension-factor", "cable-distance"])
    assert data["tension-factor"].dims == ("rig", "x", "y", "z", "orientation")
    one = data.sel(rig="platform", x=0.3, y=0.1, z=-0.2, orientation=1)
    here = ([0.3, 0.1, -0.2], turns[1])
    assert one["tension-factor"] == pytest.approx(tension_factor(rig.structure_matrix(*here)), rel=1e-12)
    assert one["cable-distance"] == cable_distance(rig, *here).distance
    np.testing.assert_array_equal(one.rotation, turns[1])

    rig, grid = held("planar", 2), Grid([0.0, 0.3], [0.1], rotations=[0.0, 0.1])
    flat = tl.sweep(rig, grid, "tension-factor")["tension-factor"]
    assert flat.dims == ("rig", "x", "y", "angle")
    expected = tension_factor(rig.structure_matrix([0.3, 0.1], 0.1))
    assert flat.sel(rig="planar", x=0.3, y=0.1, angle=0.1) == pytest.approx(expected, rel=1e-12)


def test_a_body_keeps_its_distance():
    head = tl.Body("head", [0.0, 0.2, 0.5], radius=0.1)
    data = tl.sweep(CUBE, [[0.1, 0.2, 0.3]], metric("body-distance", bodies=(head,)))
    assert data["body-distance"].item() == body_distance(CUBE, [0.1, 0.2, 0.3], bodies=[head]).distance


def test_layouts_with_other_numbers_of_modules_share_one_dataset():
    rigs = vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 5, 8], limits=[(0.5, 6), (0.5, 12)])
    data = tl.sweep(rigs, box((-0.2, 0.2), (0.1, 0.5), 0.0, step=0.1), "capacity-margin", chunk=37)
    margin = data["capacity-margin"]
    assert margin.dims == ("side", "count", "limits", "x", "y", "z")
    assert margin.shape == (2, 3, 2, 5, 5, 1)
    for i, j, k in np.ndindex(rigs.shape):
        rig = rigs.rig([i, j, k])
        position = np.stack(np.meshgrid(data.x, data.y, data.z, indexing="ij"), axis=-1)
        expected = capacity_margin(rig.structure_matrix(position), rig.limits)
        np.testing.assert_allclose(margin[i, j, k], expected, rtol=1e-12, atol=1e-12)
        here = data.isel(side=i, count=j, limits=k)
        np.testing.assert_array_equal(here.anchor[: rig.m], rig.anchors)
        assert here.anchor[rig.m :].isnull().all()
        assert here.upper[: rig.m].values.tolist() == rig.limits.upper.tolist()
        assert here.module_name.values.tolist()[: rig.m] == [module.name for module in rig.modules]
        assert here.rig.item() == rig.name


def test_anchors_that_ride_on_a_body_are_where_it_is():
    modules = [tl.Module("worn", [0.0, 0.0, 0.1], 0.5, 6.0, frame="hip"), *CUBE.modules]
    rig = tl.Rig("worn", "point", tuple(modules), np.zeros(3))
    frames = {"hip": ([0.3, 0.0, 0.0], exponential(np.array([0.0, np.pi / 2, 0.0])))}
    data = tl.sweep([rig, CUBE], [[0.1, 0.2, 0.3]], "capacity-margin", frames=frames)
    expected = capacity_margin(rig.structure_matrix([0.1, 0.2, 0.3], frames=frames), rig.limits)
    assert data["capacity-margin"].sel(rig="worn").item() == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(data.anchor.sel(rig="worn")[0], [0.4, 0.0, 0.0], atol=1e-12)


def test_where_a_cable_has_no_length_there_is_no_value():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 1.5], [0.1, 0.0, 0.0]])
    cords = tuple(replace(module, cable_stiffness=1e4) for module in CUBE.modules)
    rig = replace(CUBE, modules=cords, platform=tl.Platform(0.2))
    data = tl.sweep(rig, poses, list({*METRICS} - {"body-distance"}))
    for name, values in data.items():
        assert np.isnan(values.values).tolist() == [[False, True, False]], name
    rig, turn = held("platform", 3), exponential(np.array([0.0, 0.0, 0.4]))
    corner = np.array([2.0, 3.0, 1.0]) - turn @ [0.1, 0.2, -0.1]
    found = tl.sweep(rig, PoseList([corner, corner], [turn, np.eye(3)]), "cable-distance")["cable-distance"]
    assert np.isnan(found.values).tolist() == [[True, False]]


def test_stiffness_is_that_with_the_tensions_of_newton():
    rig = tl.load_rig("cogiro")
    rig = replace(rig, modules=tuple(replace(module, cable_stiffness=1e5) for module in rig.modules))
    grid = box([-3.0, 0.0], [0.0, 6.0], 2.0, step=3.0)  # the last row is beyond the anchors
    data = tl.sweep(
        rig, grid, ["least-stiffness", "stiffness-along:x", "stiffness-along", "first-natural-frequency"]
    )
    positions, _ = grid.arrays()
    held = rig.allocate(np.zeros(6), positions)
    stiffness = tl.stiffness_matrix(rig, held.tensions, positions)
    expected = {
        "least-stiffness": tl.stiffness_eigenvalues(rig, stiffness)[:, 0],
        "stiffness-along:x": stiffness[:, 0, 0],
        "stiffness-along": stiffness[:, 2, 2],
        "first-natural-frequency": tl.natural_frequencies(rig, stiffness)[:, 0],
    }
    assert 0 < held.exact.sum() < len(positions)
    for name, values in expected.items():
        np.testing.assert_allclose(data[name].values.ravel(), np.where(held.exact, values, np.nan), rtol=1e-9)
    tilted = metric("stiffness-along", direction=(3.0, 0.0, 4.0))
    found = tl.sweep(rig, [rig.home], tilted)[tilted.name].item()
    matrix = tl.stiffness_matrix(rig, rig.allocate(np.zeros(6)).tensions, rig.home)[:3, :3]
    assert found == pytest.approx([0.6, 0.0, 0.8] @ matrix @ [0.6, 0.0, 0.8])


def test_every_variable_is_labelled_and_the_manifest_says_where_it_comes_from(tmp_path):
    for out in (None, tmp_path / "a.zarr"):
        rigs = vary(tl.ring_plus_top, side=[1.0], limits=[(0.5, 6)])
        data = tl.sweep(rigs, Grid(0.0, 0.2, 0.1), ["feasible-direction-fraction:2.0", "squared-tension"], out=out)
        assert {"side", "limits", "limits_lower", "anchor", "lower"} <= set(data.coords)
        for name, variable in data.variables.items():
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
        assert data.x.units == data.anchor.units == data.side.units == "m"
        assert data.upper.units == data.limits_upper.units == "N"
        assert data["squared-tension"].units == "N²"
        assert data["feasible-direction-fraction:2.0"].better == "higher"
        manifest = json.loads(data.manifest)
        assert manifest["versions"]["numpy"] == np.__version__
        assert {"call", "git_commit", "processor", "seed", "date"} <= set(manifest)


ORIGIN = [[0, 0, 0]]
CLASHING = vary(lambda x: CUBE, x=[1.0])


@pytest.mark.parametrize(
    ("changed", "error", "words"),
    [
        ({"metrics": []}, SweepError, "no metric is named; give one at least"),
        ({"metrics": "beauty"}, SweepError, "no metric is called 'beauty'"),
        ({"metrics": ["tension-factor", "tension-factor"]}, SweepError, 'called "tension-factor"'),
        ({"metrics": "capacity-margin:-1"}, InputError, "radius is -1.0"),
        ({"metrics": "body-distance"}, InputError, "has no bodies; list them"),
        ({"metrics": "least-stiffness"}, RigError, 'key "cable_stiffness" is missing'),
        ({"rigs": "cube.toml"}, SweepError, "rigs holds 'c'"),
        ({"rigs": vary(CUBE, limits=[(6, 1)])}, RigError, '"lower" is 6.0'),
        ({"rigs": [CUBE, tl.load_rig("kntu-planar")]}, SweepError, 'rig "kntu-planar" .* needs 2'),
        ({"rigs": CLASHING, "poses": Grid(0.0, 0.0, 0.0)}, SweepError, 'are called "x"'),
        ({"poses": [[0, 0]]}, SweepError, '2 coordinates; rig "box-corners".*needs 3'),
        ({"poses": PoseList([[0, 0, 0]], [np.eye(3)])}, SweepError, "cannot turn"),
        ({"poses": Grid(*[np.zeros(1000)] * 3)}, SweepError, "8.0 GB.*give out"),
        ({"chunk": 0}, SweepError, "chunk is 0"),
        ({"frames": {"hip": [0, 0, 0]}}, SweepError, '"hip"'),
    ],
)
def test_odd_sweeps_are_refused_before_any_work(changed, error, words, monkeypatch):
    monkeypatch.setattr("tensionlab.workspace.sweep.evaluate_on_threads", None)
    with pytest.raises(error, match=words):
        tl.sweep(**{"rigs": CUBE, "poses": ORIGIN, "metrics": "tension-factor"} | changed)


def test_a_body_frame_that_is_not_given_is_named():
    rig = tl.Rig("worn", "point", (tl.Module("worn", [0, 0, 0], 0.5, 6.0, frame="hip"),), np.zeros(3))
    with pytest.raises(RigError, match='is attached to the frame "hip", which is missing'):
        tl.sweep(rig, [[1, 0, 0]], "squared-tension")
    with pytest.raises(SweepError, match="one pose for each body frame"):
        tl.sweep(rig, [[1, 0, 0]], "squared-tension", frames={"hip": np.zeros((2, 3))})


def test_a_function_with_a_unit_is_a_metric():
    def height(batch):
        """Height of the reference point."""
        return batch.position[:, 1]

    data = tl.sweep(CUBE, [[0.0, 0.2, 0.0]], Metric("height", height, "m"))["height"]
    assert data.item() == 0.2
    assert (data.units, data.long_name, data.better) == ("m", "height", "higher")
    assert data.description == "Height of the reference point."
