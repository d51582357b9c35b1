"""Scenes that a log holds for viewers of robots."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.demand import Pose
from tensionlab.hardware.log.scene import SCHEMA, SceneEncoder
from tensionlab.hardware.runner import cycle_table
from tensionlab.support.colours import GREY, ramp, rgb
from tests.helpers import runs

LAYOUT = Path(__file__).parents[3] / "examples" / "foxglove" / "layout.json"
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
# Rotation from the world of a rig to a scene whose z axis points up.
UPRIGHT = {"ipanema-1": np.eye(3), "bartels2026-validation": np.eye(3)[[2, 0, 1]]}


def drawn(cycle, rig):
    """Return the entity that draws a cycle."""
    content = json.loads(SceneEncoder(rig).encode(cycle, 1_800_000_000_123_456_789))
    jsonschema.validate(content, SCHEMA)
    (entity,) = content["entities"]
    assert entity["timestamp"] == {"sec": 1_800_000_000, "nsec": 123_456_789}
    return entity


def cycle_of(rig, **state):
    """Return the second cycle of a run, which has telemetry, with other values in its state."""
    cycle = list(runs.cycles(rig, 2))[1]
    return replace(cycle, state=replace(cycle.state, **state))


def numbers(items, keys):
    return np.array([[item[key] for key in keys] for item in items])


@pytest.mark.parametrize("name", UPRIGHT)
def test_cables_run_from_attachments_to_anchors_coloured_by_tension(name):
    rig = tl.load_rig(name)
    rotation = QUARTER if rig.n > 3 else None
    cycle = cycle_of(rig, pose=Pose(rig.home + 0.1, rotation))
    cycle.state.active[3] = False
    entity = drawn(cycle, rig)
    (line,) = entity["lines"]
    points = numbers(line["points"], "xyz").reshape(-1, 2, 3)
    ends = rig.home + 0.1 + rig.attachments @ (np.eye(3) if rotation is None else rotation).T
    np.testing.assert_allclose(points[:, 0], ends @ UPRIGHT[name].T, atol=1e-6)
    np.testing.assert_allclose(points[:, 1], rig.anchors @ UPRIGHT[name].T, atol=1e-6)
    centres = numbers([sphere["pose"]["position"] for sphere in entity["spheres"]], "xyz")
    np.testing.assert_array_equal(points[:, 1], centres)
    expected = ramp(cycle.state.tensions, rig.limits.lower, rig.limits.upper)
    expected[3] = rgb(GREY)  # it is lost
    colours = numbers(line["colors"], "rgb").reshape(-1, 2, 3)
    np.testing.assert_allclose(colours, np.stack([expected, expected], axis=1) / 255.0, atol=1e-3)


@pytest.mark.parametrize(
    "tensions", [[1.0, 1.0, 1.0, 1.0], [0.5, 0.5, 0.5, 6.0], [5.0, 1.0, 0.5, 0.5], [1e-4, 2e-4, 1e-4, 2e-4]]
)
def test_the_arrow_points_along_the_force_in_proportion_to_it(tensions):
    rig = runs.four()
    cycle = cycle_of(rig, tensions=np.array(tensions))
    force = UPRIGHT[rig.name] @ (cycle.state.structure @ tensions)
    (arrow,) = drawn(cycle, rig)["arrows"]
    turn = Rotation.from_quat([arrow["pose"]["orientation"][axis] for axis in "xyzw"])
    shown = turn.apply([arrow["shaft_length"] + arrow["head_length"], 0.0, 0.0])
    size = np.ptp(np.vstack([rig.anchors, rig.home]), axis=0).max()
    np.testing.assert_allclose(shown, force * 0.5 * size / 6.0, atol=1e-9)


@pytest.mark.parametrize("name", ["kntu-planar", "cogiro", "body-mounted"])
def test_every_kind_of_rig_is_drawn_before_and_after_its_first_telemetry(name):
    rig, active = tl.load_rig(name), cycle_of(runs.four())
    pose, structure = Pose(rig.home, frames=rig.at_rest), rig.structure_matrix(rig.home, frames=rig.at_rest)
    for tension, arrows in ((np.nan, 0), (1.0, 1)):
        tensions = tension * np.arange(rig.m)
        changed = {"pose": pose, "structure": structure, "active": np.full(rig.m, True), "tensions": tensions}
        cycle = replace(active, state=replace(active.state, **changed), commanded=np.full(rig.m, np.nan))
        entity = drawn(cycle, rig)
        assert (len(entity["arrows"]), len(entity["spheres"])) == (arrows, rig.m)


@pytest.mark.parametrize(("rate", "pictures"), [(10.0, 20), (50.0, 60), (1000.0, 60)])
def test_pictures_come_at_30_hz_at_most(rate, pictures):
    rig = runs.four()
    encoder, first = SceneEncoder(rig), cycle_of(rig)
    cycles = [replace(first, state=replace(first.state, time=index / rate)) for index in range(int(2 * rate))]
    assert sum(encoder.encode(cycle, 0) is not None for cycle in cycles) == pictures


def test_the_layout_plots_columns_that_a_log_has():
    text = LAYOUT.read_text(encoding="utf-8")
    json.loads(text)
    paths = re.findall(r'"value": "cycle\.(\w+)\[(\d)\]"', text)
    assert len(paths) == text.count('"value"') > 10
    lengths = {dim: len(names) for dim, names in cycle_table.labels(tl.load_rig("cube-8")).items()}
    for name, index in paths:
        (dim,) = cycle_table.COLUMNS[name].dims
        assert int(index) < lengths[dim]
