"""What is drawn around a rig of the scenario that it plays: solids and nodes, without a browser."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensionlab.hardware.log.reader import read_run
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.scenarios.scenery import ScenerySurface, scenery
from tensionlab.support.colours import GREEN, GREY
from tensionlab.viewer.replay import instant_at
from tensionlab.viewer.run_scene import (
    SceneryDrawing,
    body_origins,
    named_places,
    person,
    points_to_see,
    solid,
    solids,
)
from tensionlab.viewer.scene import as_rgb

MIDDLE = np.array([0.3, 0.4, 1.2])


def played(name, tmp_path, seconds=0.1):
    scenario = load_scenario(name)
    play(scenario, simulate_modules(scenario), seconds=seconds, log=tmp_path / "run.mcap")
    run = read_run(tmp_path / "run.mcap")
    return scenery(scenario), run.rig, instant_at(run, len(run) - 1)


@pytest.fixture
def bow(tmp_path):
    return played("bow", tmp_path)


def normal(plate):
    return Rotation.from_quat(plate.turn, scalar_first=True).apply([0.0, 0.0, 1.0])


def test_a_plane_is_a_plate_in_it_near_the_middle_of_the_script():
    plate = solid(ScenerySurface("plane", (0.0, 0.0, 1.0), (0.0, 0.6, 0.8)), np.zeros(3), MIDDLE)
    across = np.array([0.0, 0.6, 0.8])
    assert normal(plate) == pytest.approx(across)
    assert (plate.centre - [0.0, 0.0, 1.0]) @ across == pytest.approx(0.0)
    assert np.cross(plate.centre - MIDDLE, across) == pytest.approx(np.zeros(3))


def test_the_end_of_a_reach_is_a_plate_on_the_side_of_the_middle():
    plate = solid(ScenerySurface("reach", (0.0, 0.0, 0.0), size=(0.5,)), np.array([0.0, 0.0, 1.0]), MIDDLE)
    ahead = MIDDLE - [0.0, 0.0, 1.0]
    assert plate.centre - [0.0, 0.0, 1.0] == pytest.approx(0.5 * ahead / np.linalg.norm(ahead))
    assert normal(plate) == pytest.approx(ahead / np.linalg.norm(ahead))


def test_a_ball_and_a_box_have_their_place_and_size():
    ball = solid(ScenerySurface("ball", (0.1, 0.0, 1.0), size=(0.2,)), np.array([1.0, 0.0, 0.0]), MIDDLE)
    assert (ball.centre.tolist(), ball.radius) == ([1.1, 0.0, 1.0], 0.2)
    box = solid(ScenerySurface("box", (0.0, 0.0, 1.0), size=(0.1, 0.2, 0.3)), np.zeros(3), MIDDLE)
    assert (box.centre.tolist(), box.edges.tolist()) == ([0.0, 0.0, 1.0], [0.1, 0.2, 0.3])


def test_surfaces_in_the_frame_of_a_body_go_with_it(bow):
    found, rig, instant = bow
    shift = np.array([0.1, 0.2, 0.3])
    for anchors in (instant.anchors, instant.anchors + shift):
        (plate,) = solids(found, rig, replace(instant, anchors=anchors))
        origin = body_origins(rig, anchors)["bow"]
        assert np.linalg.norm(plate.centre - origin) == pytest.approx(0.8)


def test_only_surfaces_of_phases_in_progress_are_coloured(bow):
    found, rig, instant = bow
    nodes = []

    def node(*name, **how):
        nodes.append(MagicMock(kind=name[0], **how))
        return nodes[-1]

    scene = MagicMock(add_box=node, add_label=node)
    drawing = SceneryDrawing(scene, found, rig, instant)
    for time, fresh, colour in ((4.0, True, GREY), (1.0, True, GREEN), (1.0, False, GREY)):
        drawing.show(replace(instant, time=time), fresh=fresh)
        assert nodes[0].color == as_rgb(colour)
        assert [label.text for label in nodes[1:]] == ["draw hand", "bow hand"]


def test_the_person_holds_what_is_known_of_it(bow):
    found, rig, instant = bow
    figure = person(found, rig, named_places(found, rig, instant))
    joints = np.concatenate(figure.lines)
    for place in (instant.hand, body_origins(rig, instant.anchors)["bow"]):
        assert np.linalg.norm(joints - place, axis=1).min() == pytest.approx(0.0, abs=1e-9)
    assert joints[:, 2].min() == pytest.approx(0.0)
    assert points_to_see(found, rig, instant)[:, 2].max() >= figure.head[2] > 1.5
    assert person(replace(found, feet=None), rig, {}) is None


@pytest.mark.parametrize("name", ["materials", "collision", "recoil", "weight"])
def test_every_scenario_is_drawn(name, tmp_path):
    found, rig, instant = played(name, tmp_path)
    assert len(solids(found, rig, instant)) == sum(len(phase.surfaces) for phase in found.phases)
    SceneryDrawing(MagicMock(), found, rig, instant).show(instant, fresh=True)
    assert np.isfinite(points_to_see(found, rig, instant)).all()
