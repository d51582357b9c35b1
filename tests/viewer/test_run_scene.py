"""What is drawn of an instant of a run and around its rig: arrays and nodes, without a browser."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.scenarios.scenery import ScenerySurface, scenery
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREEN, GREY, ORANGE, RED, rgb
from tensionlab.viewer.replay import instant_at
from tensionlab.viewer.run_scene import (
    DASHES,
    ENLARGED,
    Instant,
    RunDrawing,
    draw_instant,
    draw_scenery,
    place_surface,
)
from tensionlab.viewer.scene import force_scale, size
from tests.helpers.runs import cycles, four


def instant_of(rig, count=10, **how):
    *_, cycle = cycles(rig, count, **how)
    row = {name: np.asarray(column.value(cycle, rig)) for name, column in COLUMNS.items()}
    return Instant.of(rig, row), row


@pytest.fixture
def rig():
    return four()


@pytest.fixture
def instant(rig):
    return instant_of(rig)[0]


def ended(scene, name):
    return scene.arrows[name][1] - scene.arrows[name][0]


def test_three_forces_are_drawn_to_scale_next_to_each_other(rig, instant):
    scene = draw_instant(rig, instant)
    for name in FORCE_COLOURS:
        force = ENLARGED * force_scale(rig) * getattr(instant, name)
        assert ended(scene, name) == pytest.approx(force), name
    starts = np.array([scene.arrows[name][0] for name in FORCE_COLOURS])
    assert np.linalg.norm(starts[:, None] - starts, axis=-1)[np.triu_indices(3, 1)].min() > 0.01 * size(rig)


def test_modules_impedances_count_as_commanded_and_no_desired_force_has_no_arrow(rig):
    instant, row = instant_of(rig, 50)
    assert np.isnan(instant.desired).all()
    assert set(draw_instant(rig, instant).arrows) == {"commanded", "measured"}
    row["demanded"], row["solver_wrench"] = np.array([0.0, 1.0, 0.0]), np.zeros(3)  # an impedance pulls with 1 N
    expected = row["structure"] @ np.nan_to_num(row["commanded"]) + [0.0, 1.0, 0.0]
    assert Instant.of(rig, row).commanded == pytest.approx(expected)


def test_a_lost_module_is_marked_and_its_cable_dashed(rig):
    instant, _ = instant_of(rig, lost=1)
    scene = draw_instant(rig, instant)
    assert [label.partition(" · ")[2] for label in scene.labels].count("LOST") == 1
    assert scene.labels[1].endswith("LOST")
    assert scene.colours[1].tolist() == rgb(RED).tolist()
    assert len(scene.cables.points) == 3 + DASHES
    dashes = scene.cables.points[3:]
    assert dashes[0, 0] == pytest.approx(scene.hand, abs=1e-9)
    assert dashes[-1, 1] == pytest.approx(scene.anchors[1], abs=1e-9)
    assert {tuple(each) for each in scene.cables.colours[3:].reshape(-1, 3)} == {tuple(rgb(GREY))}


def test_a_slack_cable_is_marked(rig, instant):
    loose = replace(instant, tensions=np.array([0.1, 1.0, 1.0, 1.0]))
    scene = draw_instant(rig, loose)
    assert scene.labels[0] == f"{rig.modules[0].name} · slack"
    assert scene.labels[1] == f"{rig.modules[1].name} · 1.00 N"
    assert len(scene.cables.points) == 3 + DASHES


def test_what_is_not_fresh_looks_like_nothing_live(rig, instant):
    scene = draw_instant(rig, instant, fresh=False)
    assert scene.arrows == {}
    assert {tuple(each) for each in scene.cables.colours.reshape(-1, 3)} == {tuple(rgb(GREY))}
    assert {tuple(each) for each in scene.colours} == {tuple(rgb(GREY))}
    assert list(scene.labels) == [module.name for module in rig.modules]


def test_modules_on_bodies_have_their_colour_and_are_where_they_were(instant):
    rig = tl.load_rig("body-mounted")
    m, nothing, taut = rig.m, np.full(rig.n, np.nan), np.ones(rig.m)
    moved = replace(
        instant, hand=rig.home, anchors=rig.anchors + 1.0, ends=np.tile(rig.home, (m, 1)), tensions=taut,
        set_points=taut, active=taut > 0.0, desired=nothing, commanded=nothing, measured=nothing,
    )  # fmt: skip
    scene = draw_instant(rig, moved)
    assert scene.anchors == pytest.approx(moved.anchors)
    for module, colour in zip(rig.modules, scene.colours, strict=True):
        assert colour.tolist() == rgb(ORANGE if module.frame in rig.frames else BLUE).tolist()
    assert scene.arrows == {}


def test_a_rig_in_the_plane_lies_in_it():
    rig = tl.load_rig("kntu-planar")
    instant, _ = instant_of(rig, size=10.0)
    scene = draw_instant(rig, instant)
    assert set(scene.arrows) == set(FORCE_COLOURS)
    for arrow in scene.arrows.values():
        assert not arrow[:, 2].any()


MIDDLE = np.array([0.3, 0.4, 1.2])


def played(name, tmp_path, seconds=0.1):
    scenario = load_scenario(name)
    play(scenario, simulate_modules(scenario), seconds=seconds, log=tmp_path / "run.mcap")
    run = read_run(tmp_path / "run.mcap")
    return scenery(scenario), run.rig, instant_at(run, len(run) - 1)


@pytest.fixture(scope="module")
def bow(tmp_path_factory):
    return played("bow", tmp_path_factory.mktemp("bow"))


def normal(plate):
    return Rotation.from_quat(plate.turn, scalar_first=True).apply([0.0, 0.0, 1.0])


def test_a_plane_is_a_plate_in_it_near_the_middle_of_the_script():
    plate = place_surface(ScenerySurface("plane", (0.0, 0.0, 1.0), (0.0, 0.6, 0.8)), np.zeros(3), MIDDLE)
    across = np.array([0.0, 0.6, 0.8])
    assert normal(plate) == pytest.approx(across)
    assert (plate.centre - [0.0, 0.0, 1.0]) @ across == pytest.approx(0.0)
    assert np.cross(plate.centre - MIDDLE, across) == pytest.approx(np.zeros(3))


def test_the_end_of_a_reach_is_a_plate_on_the_side_of_the_middle():
    plate = place_surface(ScenerySurface("reach", (0.0, 0.0, 0.0), size=(0.5,)), np.array([0.0, 0.0, 1.0]), MIDDLE)
    ahead = MIDDLE - [0.0, 0.0, 1.0]
    assert plate.centre - [0.0, 0.0, 1.0] == pytest.approx(0.5 * ahead / np.linalg.norm(ahead))
    assert normal(plate) == pytest.approx(ahead / np.linalg.norm(ahead))


def test_a_ball_and_a_box_have_their_place_and_size():
    ball = place_surface(ScenerySurface("ball", (0.1, 0.0, 1.0), size=(0.2,)), np.array([1.0, 0.0, 0.0]), MIDDLE)
    assert (ball.centre.tolist(), ball.radius) == ([1.1, 0.0, 1.0], 0.2)
    box = place_surface(ScenerySurface("box", (0.0, 0.0, 1.0), size=(0.1, 0.2, 0.3)), np.zeros(3), MIDDLE)
    assert (box.centre.tolist(), box.edges.tolist()) == ([0.0, 0.0, 1.0], [0.1, 0.2, 0.3])


def test_only_surfaces_of_phases_in_progress_are_coloured(bow):
    found, rig, instant = bow
    nodes = []

    def node(*name, **how):
        nodes.append(MagicMock(kind=name[0], **how))
        return nodes[-1]

    server = MagicMock()
    server.scene.add_box = server.scene.add_label = node
    drawing = RunDrawing(server, rig, instant, found)
    for time, fresh, colour in ((4.0, True, GREY), (1.0, True, GREEN), (1.0, False, GREY)):
        drawing.show(replace(instant, time=time), fresh=fresh)
        assert nodes[0].color == tuple(rgb(colour))
        assert [label.text for label in nodes[1:3]] == ["draw hand", "bow hand"]


def test_surfaces_and_the_person_follow_the_bodies(bow):
    found, rig, instant = bow
    shifted = draw_scenery(found, rig, replace(instant, anchors=np.add(instant.anchors, [0.1, 0.2, 0.3])))
    scene = draw_scenery(found, rig, instant)
    for moved in (scene, shifted):  # the surface in the frame of the bow goes with it
        assert np.linalg.norm(moved.solids[0].centre - moved.places["bow hand"]) == pytest.approx(0.8)
    assert scene.points[:, 2].max() > 1.7
    assert not draw_scenery(replace(found, feet=None), rig, instant).person.bodies
    head = replace(rig, bodies=(tl.Body("head", [0.0, 0.0, 1.6], radius=0.1),))
    assert not draw_scenery(found, head, instant).person.bodies, "a rig with bodies of its own shows those"


@pytest.mark.parametrize("name", ["materials", "collision", "recoil", "weight"])
def test_every_scenario_is_drawn(name, tmp_path):
    found, rig, instant = played(name, tmp_path)
    scene = draw_scenery(found, rig, instant)
    assert len(scene.solids) == sum(len(phase.surfaces) for phase in found.phases)
    assert np.isfinite(scene.points).all()
    RunDrawing(MagicMock(), rig, instant, found).show(instant)
