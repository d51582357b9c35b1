"""What is drawn of an instant of a run: arrays, without a browser."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.hardware.runner.cycle_table import VALUES
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREY, ORANGE, RED, rgb
from tensionlab.viewer.run_scene import DASHES, ENLARGED, Instant, draw_instant
from tensionlab.viewer.scene import force_scale, size
from tests.helpers.runs import cycles, four


def instant_of(rig, count=10, **how):
    *_, cycle = cycles(rig, count, **how)
    row = {name: np.asarray(value(cycle, rig)) for name, value in VALUES.items()}
    return Instant.of(rig, row), row


@pytest.fixture
def rig():
    return four()


@pytest.fixture
def instant(rig):
    return instant_of(rig)[0]


def ended(scene, name):
    return scene.arrows[name].end - scene.arrows[name].start


def test_three_forces_are_drawn_to_scale_beside_one_another(rig, instant):
    scene = draw_instant(rig, instant)
    for name in FORCE_COLOURS:
        force = ENLARGED * force_scale(rig) * getattr(instant, name)
        assert ended(scene, name) == pytest.approx(force), name
    starts = np.array([scene.arrows[name].start for name in FORCE_COLOURS])
    assert np.linalg.norm(starts[:, None] - starts, axis=-1)[np.triu_indices(3, 1)].min() > 0.01 * size(rig)


def test_what_the_solver_was_not_asked_to_render_counts_as_commanded(rig):
    _, row = instant_of(rig)
    row["solver_wrench"] = row["demanded"] - [0.0, 1.0, 0.0]  # an impedance pulls with 1 N
    found = Instant.of(rig, row)
    assert found.commanded == pytest.approx(row["structure"] @ row["commanded"] + [0.0, 1.0, 0.0])


def test_without_a_desired_wrench_the_other_two_are_drawn(rig):
    instant, row = instant_of(rig, 50)
    assert np.isnan(instant.desired).all()
    assert instant.commanded == pytest.approx(row["structure"] @ np.nan_to_num(row["commanded"]))
    assert set(draw_instant(rig, instant).arrows) == {"commanded", "measured"}


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


def test_modules_on_bodies_have_their_colour_and_are_where_they_were():
    rig = tl.load_rig("body-mounted")
    assert rig.frames
    moved = rig.anchors + 1.0
    m, n = rig.m, rig.n
    instant = Instant(
        time=0.0, hand=rig.home, anchors=moved, ends=np.tile(rig.home, (m, 1)), tensions=np.full(m, np.nan),
        set_points=np.full(m, np.nan), active=np.ones(m, bool), desired=np.full(n, np.nan), commanded=np.zeros(n),
        measured=np.zeros(n),
    )  # fmt: skip
    scene = draw_instant(rig, instant)
    assert scene.anchors == pytest.approx(moved)
    for module, colour in zip(rig.modules, scene.colours, strict=True):
        assert colour.tolist() == rgb(ORANGE if module.frame in rig.frames else BLUE).tolist()
    assert scene.arrows == {}


def test_a_rig_in_the_plane_lies_in_it():
    rig = tl.load_rig("kntu-planar")
    instant, _ = instant_of(rig, size=10.0)
    scene = draw_instant(rig, instant)
    assert set(scene.arrows) == set(FORCE_COLOURS)
    for arrow in scene.arrows.values():
        assert (arrow.start[2], arrow.end[2]) == (0.0, 0.0)
