"""What a log tells viewers of robots: messages as Foxglove publishes them, of where things are."""

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.demand import Pose
from tensionlab.hardware.log.mcap_file import read_records
from tensionlab.hardware.log.scene import CHANNELS, SceneEncoder
from tensionlab.hardware.runner.cycle_table import anchors_in_world
from tensionlab.support.colours import FORCE_COLOURS, GREY, ramp, rgb
from tests.helpers import runs

LAYOUT = Path(__file__).parents[3] / "examples" / "foxglove" / "layout.json"
TIME_NS = 1_800_000_000_123_456_789
RIGS = ("bartels2026-validation", "ipanema-1", "kntu-planar", "cogiro")
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def messages(cycle, rig):
    """Messages of the first picture, by channel."""
    return {name: json.loads(content) for name, content in SceneEncoder(rig).messages(cycle, TIME_NS)}


def picture(cycle, rig):
    """Entities of the first picture, by name."""
    found = messages(cycle, rig)
    return {each["id"]: each for name in found if name.startswith("scene/") for each in found[name]["entities"]}


def cycle_of(rig, **state):
    """Return the second cycle of a run, which has telemetry, with other values in its state."""
    cycle = list(runs.cycles(rig, 2))[1]
    return replace(cycle, state=replace(cycle.state, **state))


def xyz(vector):
    return [vector[axis] for axis in "xyz"]


def turned(quaternion):
    return Rotation.from_quat([quaternion[axis] for axis in "xyzw"])


def ends_of(arrow):
    """Start and end of an arrow, which points along x before it is turned."""
    start, turn = np.array(xyz(arrow["pose"]["position"])), turned(arrow["pose"]["orientation"])
    return start, start + turn.apply([arrow["shaft_length"] + arrow["head_length"], 0.0, 0.0])


@pytest.mark.parametrize("name", RIGS)
def test_messages_keep_to_their_schemas(tmp_path, name):
    runs.logged(tmp_path / "run.mcap", tl.load_rig(name), 60, lost=2)
    counts = dict.fromkeys(CHANNELS, 0)
    for record in read_records(tmp_path / "run.mcap"):
        if record.name in CHANNELS:
            jsonschema.validate(json.loads(record.content), CHANNELS[record.name])
            counts[record.name] += 1
    assert counts.pop("scene/platform") == 1, "it stands still in its frame"
    assert counts.pop("scene/modules") == 2, "at first, and when one is lost"
    assert set(counts.values()) == {36}, "60 cycles at 50 Hz last 1.2 s"


@pytest.mark.parametrize(("rate", "pictures"), [(10.0, 20), (50.0, 60), (1000.0, 60)])
def test_pictures_come_at_30_hz_at_most(rate, pictures):
    rig = runs.four()
    encoder, first = SceneEncoder(rig), cycle_of(rig)
    times = np.arange(int(2 * rate)) / rate
    cycles = [replace(first, state=replace(first.state, time=float(time))) for time in times]
    assert sum(bool(list(encoder.messages(cycle, TIME_NS))) for cycle in cycles) == pictures


def test_cables_run_from_anchors_to_attachments_coloured_by_tension():
    rig = tl.load_rig("ipanema-1")
    cycle = cycle_of(rig, pose=Pose(rig.home + 0.1, QUARTER))
    cycle.state.active[3] = False
    (line,) = picture(cycle, rig)["cables"]["lines"]
    points = np.array([xyz(point) for point in line["points"]]).reshape(-1, 2, 3)
    np.testing.assert_allclose(points[:, 0], rig.anchors, atol=1e-6)
    np.testing.assert_allclose(points[:, 1], rig.home + 0.1 + rig.attachments @ QUARTER.T, atol=1e-6)
    colours = np.array([[color[part] for part in "rgb"] for color in line["colors"]]).reshape(-1, 2, 3)
    np.testing.assert_array_equal(colours[:, 0], colours[:, 1])
    expected = ramp(cycle.state.tensions, rig.limits.lower, rig.limits.upper)
    expected[3] = rgb(GREY)  # it is lost
    np.testing.assert_allclose(colours[:, 0], expected / 255.0, atol=1e-3)


def test_the_platform_is_drawn_in_its_frame_and_transforms_place_it():
    rig = tl.load_rig("ipanema-1")
    cycle = cycle_of(rig, pose=Pose(rig.home + 0.1, QUARTER))
    platform = picture(cycle, rig)["platform"]
    assert platform["frame_id"] == "platform"
    arms = np.array([xyz(point) for point in platform["lines"][0]["points"]])[1::2]
    place = {each["child_frame_id"]: each for each in messages(cycle, rig)["transforms"]["transforms"]}["platform"]
    placed = turned(place["rotation"]).apply(arms) + xyz(place["translation"])
    np.testing.assert_allclose(placed, rig.home + 0.1 + rig.attachments @ QUARTER.T, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "up"), [("bartels2026-validation", [0, 1, 0]), ("kntu-planar", [0, 1, 0]), ("cogiro", [0, 0, 1])]
)
def test_what_is_up_in_the_rig_is_up_in_the_viewer(name, up):
    rig = tl.load_rig(name)
    (world,) = (
        each
        for each in messages(cycle_of(rig), rig)["transforms"]["transforms"]
        if each["child_frame_id"] == "world"
    )
    assert world["parent_frame_id"] == "upright"
    np.testing.assert_allclose(turned(world["rotation"]).apply(up), [0.0, 0.0, 1.0], atol=1e-12)


def test_a_platform_in_the_plane_turns_about_z():
    rig = tl.load_rig("kntu-planar")
    cycle = cycle_of(rig, pose=Pose(rig.home, np.array(np.pi / 2)))
    place = messages(cycle, rig)["transforms"]["transforms"][1]
    np.testing.assert_allclose(turned(place["rotation"]).as_matrix(), QUARTER, atol=1e-12)


def test_modules_on_bodies_go_with_them():
    rig = tl.load_rig("body-mounted")
    frames = {name: tl.CoordinateFrame([0.3, 0.2, 0.1], QUARTER) for name in rig.frames}
    cycle = cycle_of(tl.load_rig("bartels2026-validation"))  # only its wrench and its time are used
    state = replace(
        cycle.state,
        pose=Pose(rig.home, frames=frames),
        structure=rig.structure_matrix(rig.home, frames=frames),
        **{name: np.ones(rig.m) for name in ("lengths", "tensions", "speeds", "upper_now")},
        active=np.full(rig.m, True),
    )
    cycle = replace(cycle, commanded=np.ones(rig.m), solver_wrench=np.zeros(rig.n), state=state)
    places = [xyz(each["pose"]["position"]) for each in picture(cycle, rig)["modules"]["spheres"]]
    np.testing.assert_allclose(places, anchors_in_world(cycle, rig), atol=1e-6)
    placed = {each["child_frame_id"]: each for each in messages(cycle, rig)["transforms"]["transforms"]}
    for name in rig.frames:
        assert xyz(placed[name]["translation"]) == [0.3, 0.2, 0.1]
        np.testing.assert_allclose(turned(placed[name]["rotation"]).as_matrix(), QUARTER, atol=1e-12)


@pytest.mark.parametrize("wrench", [[1.0, 2.0, -0.5], [0.0, 3.0, 0.0], [-2.0, 0.0, 0.0]])
def test_arrows_are_forces_to_one_scale_and_those_of_the_numbers(wrench):
    rig = runs.four()
    cycle = cycle_of(rig)
    cycle = replace(cycle, demand=replace(cycle.demand, wrench=np.array(wrench)), solver_wrench=np.array(wrench))
    numbers = messages(cycle, rig)["forces"]
    assert xyz(numbers["desired"]) == wrench
    structure = cycle.state.structure
    np.testing.assert_allclose(xyz(numbers["commanded"]), structure @ cycle.commanded, atol=1e-6)
    np.testing.assert_allclose(xyz(numbers["measured"]), structure @ cycle.state.tensions, atol=1e-6)
    arrows = picture(cycle, rig)["forces"]["arrows"]
    scales = []
    for arrow, (name, colour) in zip(arrows, FORCE_COLOURS.items(), strict=True):
        start, end = ends_of(arrow)
        force = np.array(xyz(numbers[name]))
        scales.append(np.linalg.norm(end - start) / np.linalg.norm(force))
        np.testing.assert_allclose((end - start) / scales[-1], force, atol=1e-4)
        np.testing.assert_allclose([arrow["color"][part] for part in "rgb"], rgb(colour) / 255.0, atol=1e-3)
    np.testing.assert_allclose(scales, scales[0], rtol=1e-4)


def test_what_is_not_known_is_left_out():
    rig = runs.four()
    first = next(runs.cycles(rig, 2))  # before the first telemetry
    numbers = replace(first, demand=replace(first.demand, wrench=None), commanded=np.full(rig.m, np.nan))
    found = messages(numbers, rig)
    assert set(found["forces"]) == {"timestamp", "commanded"}
    assert [sorted(joint) for joint in found["cables"]["joints"]] == [["name", "position", "velocity"]] * rig.m
    assert found["margins"]["cables"] == [{"name": module.name} for module in rig.modules]
    assert "smallest" not in found["margins"]


def test_a_margin_is_to_the_nearer_limit():
    rig = runs.four()
    upper = np.array([6.0, 3.0, 6.0, 6.0])
    cycle = replace(cycle_of(rig, upper_now=upper), commanded=np.array([0.6, 2.0, 0.4, np.nan]))
    found = messages(cycle, rig)["margins"]
    lower = rig.limits.lower
    expected = [0.6 - lower[0], min(2.0 - lower[1], 1.0), 0.4 - lower[2]]
    assert [each["margin"] for each in found["cables"][:3]] == pytest.approx(expected)
    assert "margin" not in found["cables"][3]
    assert found["smallest"] == pytest.approx(min(expected))


def test_joints_are_lengths_speeds_and_tensions_at_the_time_of_the_cycle():
    rig = runs.four()
    cycle = cycle_of(rig)
    found = messages(cycle, rig)["cables"]
    assert found["timestamp"] == {"sec": 1_800_000_000, "nsec": 123_456_789}
    assert [joint["name"] for joint in found["joints"]] == [module.name for module in rig.modules]
    for key, expected in (("position", "lengths"), ("velocity", "speeds"), ("effort", "tensions")):
        assert [joint[key] for joint in found["joints"]] == getattr(cycle.state, expected).tolist()


def test_the_layout_shows_channels_that_a_log_has():
    """Paths such as ``cables.joints[0].effort``, and panels that are there."""
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    panels = layout["configById"]

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    (run,) = (panel for name, panel in panels.items() if name.startswith("3D!"))
    assert set(run["topics"]) == {name for name in CHANNELS if name.startswith("scene/")}
    paths = [
        each["value"] for name, panel in panels.items() if name.startswith("Plot!") for each in panel["paths"]
    ]
    assert len(paths) == len(set(paths)) > 10
    for path in paths:
        topic, *parts = path.replace("[", ".[").split(".")
        schema = CHANNELS[topic]
        for part in parts:
            schema = schema["items"] if part.startswith("[") else schema["properties"][part]
        assert schema["type"] == "number", path
