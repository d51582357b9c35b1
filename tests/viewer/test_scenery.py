"""What is drawn around a rig of the scenario that it plays: arrays, without a browser."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.hardware.log.reader import read_run
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.scenarios.scenery import ScenePhase, Surface, scenery
from tensionlab.scenarios.stick_figure import HEAD_M
from tensionlab.support.colours import GREEN, GREY
from tensionlab.viewer.recorded import instant_at
from tensionlab.viewer.scenery import CAP_RAD, PATCH_M, SURFACE_COLOUR, body_origins, draw_scenery

HAND = np.array([0.0, 0.1, 1.0])


def played(name, tmp_path, seconds=0.1):
    scenario = load_scenario(name)
    play(scenario, simulate_modules(scenario), seconds=seconds, log=tmp_path / "run.mcap")
    return scenery(scenario), read_run(tmp_path / "run.mcap")


@pytest.fixture
def bow(tmp_path):
    found, run = played("bow", tmp_path)
    return found, run.rig, instant_at(run, len(run) - 1)


def surfaces(bow, *given):
    """What is drawn of surfaces in a phase that is active."""
    found, rig, instant = bow
    around = replace(found, phases=(ScenePhase("one", 0.0, 9.0, given),), seen_from=None)
    return draw_scenery(around, rig, instant).surfaces


def area(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_a_plane_is_a_patch_in_it_near_the_middle_of_the_script(bow):
    [drawn] = surfaces(bow, Surface("plane", (0.0, 0.0, 1.0), (0.0, 0.6, 0.8)))
    normal = np.array([0.0, 0.6, 0.8])
    np.testing.assert_allclose((drawn.mesh.vertices - [0.0, 0.0, 1.0]) @ normal, 0.0, atol=1e-12)
    middle = np.array(bow[0].middle)
    foot = middle - ((middle - [0.0, 0.0, 1.0]) @ normal) * normal
    np.testing.assert_allclose(drawn.mesh.vertices.mean(axis=0), foot)
    assert area(drawn.mesh) == pytest.approx((2 * PATCH_M) ** 2)


def test_a_ball_a_box_and_the_end_of_a_reach_have_their_size(bow):
    ball, box, reach = surfaces(
        bow,
        Surface("ball", (0.1, 0.0, 1.0), size=(0.2,)),
        Surface("box", (0.0, 0.0, 1.0), size=(0.1, 0.2, 0.3)),
        Surface("reach", (0.0, 0.0, 1.0), size=(0.5,), brakes=True),
    )
    np.testing.assert_allclose(np.linalg.norm(ball.mesh.vertices - [0.1, 0.0, 1.0], axis=1), 0.2)
    assert area(ball.mesh) == pytest.approx(4 * np.pi * 0.2**2, rel=0.03)
    assert np.ptp(box.mesh.vertices, axis=0) == pytest.approx([0.1, 0.2, 0.3])
    assert area(box.mesh) == pytest.approx(2 * (0.1 * 0.2 + 0.1 * 0.3 + 0.2 * 0.3))
    assert len(box.edges.points) == 12
    arms = reach.mesh.vertices - [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), 0.5)
    ahead = np.array(bow[0].middle) - [0.0, 0.0, 1.0]
    assert (arms @ ahead / np.linalg.norm(ahead)).min() > 0.5 * np.cos(1.5 * CAP_RAD)
    assert (reach.colour, ball.colour) == (GREEN, SURFACE_COLOUR)


def test_what_is_seen_from_a_body_goes_with_it(bow):
    found, rig, instant = bow
    way = np.array([0.1, 0.2, 0.3])
    moved = replace(instant, anchors=instant.anchors + way)
    one, other = (draw_scenery(found, rig, replace(each, time=1.0)) for each in (instant, moved))
    origin = body_origins(rig, instant.anchors)["bow"]
    radii = np.linalg.norm(one.surfaces[0].mesh.vertices - origin, axis=1)
    np.testing.assert_allclose(radii, 0.8)
    radii = np.linalg.norm(other.surfaces[0].mesh.vertices - (origin + way), axis=1)
    np.testing.assert_allclose(radii, 0.8)


def test_only_surfaces_of_phases_in_progress_are_filled_and_named(bow):
    found, rig, instant = bow
    over, active = (draw_scenery(found, rig, replace(instant, time=time)) for time in (4.0, 1.0))
    assert (len(over.surfaces[0].mesh.faces), over.surfaces[0].colour) == (0, GREY)
    assert len(over.surfaces[0].edges.points) == len(active.surfaces[0].edges.points) > 0
    old = draw_scenery(found, rig, replace(instant, time=1.0), fresh=False)
    assert (len(old.surfaces[0].mesh.faces), old.surfaces[0].colour) == (0, GREY)
    assert (len(active.surfaces[0].mesh.faces) > 0, active.surfaces[0].colour) == (True, GREEN)
    assert [label.text for label in over.labels] == ["draw hand", "bow hand"]
    assert [label.text for label in active.labels] == ["draw hand", "bow hand", "full draw"]


def test_the_person_holds_what_is_known_of_it(bow):
    found, rig, instant = bow
    scene = draw_scenery(found, rig, instant)
    ends = scene.person.points.reshape(-1, 3)
    for place in (instant.hand, body_origins(rig, instant.anchors)["bow"]):
        assert np.linalg.norm(ends - place, axis=1).min() == pytest.approx(0.0, abs=1e-9)
    assert ends[:, 2].min() == pytest.approx(0.0)
    assert scene.points[:, 2].max() >= scene.head[2] > 1.5 + HEAD_M / 2
    nobody = draw_scenery(replace(found, stands=None), rig, instant)
    assert (len(nobody.person.points), nobody.head) == (0, None)


@pytest.mark.parametrize("name", ["materials", "collision", "recoil", "weight"])
def test_every_scenario_is_drawn(name, tmp_path):
    found, run = played(name, tmp_path)
    scene = draw_scenery(found, run.rig, instant_at(run, 0))
    assert len(scene.surfaces) == sum(len(phase.surfaces) for phase in found.phases)
    assert np.isfinite(scene.points).all()
