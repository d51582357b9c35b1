"""Bodies: what is refused, what files say of them, and the ready person."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.model.bodies import place_bodies
from tensionlab.model.files import rig_from_toml

RIG = """
name = "desk"
kind = "point"
up = "z"
home = [0.0, 0.3, 1.0]
{bodies}
[[modules]]
name = "left"
anchor = [-0.5, 0.0, 0.0]
lower = 0.5
upper = 6.0
"""
TABLES = """
[[bodies]]
name = "head"
centre = [0.0, 0.0, 1.6]
radius = 0.12
frame = "head"
margin = 0.1
sway = 0.02

[[bodies]]
name = "arm"
start = [0.0, 0.0, 0.0]
end = [0.0, 0.3, 0.0]
radius = 0.05
frame = "hand"

[[bodies]]
name = "table"
centre = [0.0, 1.0, 0.7]
size = [1.2, 0.6, 0.04]

[[frames]]
name = "head"
position = [0.0, 0.0, 0.1]
"""
B = "[[bodies]]\nname = 'b'\n"
MOST = 'bodies = {person = "seated", at = [0.0, -1.0, 0.1], facing = [1.0, 1.0, 0.5], height = 1.6, sway = 0.1}'


def load(bodies):
    return rig_from_toml(RIG.format(bodies=bodies), "desk.toml")


@pytest.mark.parametrize("bodies", ['bodies = "standing"', MOST, TABLES], ids=["word", "table", "tables"])
def test_bodies_survive_a_file(tmp_path, bodies):
    rig = load(bodies)
    tl.save_rig(rig, tmp_path / "desk.toml")
    assert tl.load_rig(tmp_path / "desk.toml") == rig
    assert rig != replace(rig, bodies=rig.bodies[:-1], rest=() if bodies == TABLES else rig.rest)


def test_a_file_lists_spheres_capsules_and_boxes():
    head, arm, table = load(TABLES).bodies
    assert [body.shape for body in (head, arm, table)] == ["sphere", "capsule", "box"]
    assert (head.margin, head.sway, arm.margin, arm.frame) == (0.1, 0.02, 0.05, "hand")
    assert (
        eval(repr(head), {"Body": tl.Body, "array": np.array}) == head
    )  # its places are part of what identifies a sweep
    assert load("bodies = []").bodies == ()


@pytest.mark.parametrize(
    ("bodies", "words"),
    [
        (B + "radius = 0.1", 'body "b": give "centre" for a sphere or box'),
        (B + "start = [0.0, 0.0, 0.0]\nradius = 0.1", 'give "centre"'),
        (
            B + "centre = [0.0, 0.0, 0.0]\nend = [0.0, 0.0, 1.0]\nradius = 0.1",
            '"start" and "end"',
        ),
        (B + "centre = [0.0, 0.0, 0.0]", 'body "b": key "radius" is missing'),
        (B + "centre = [0.0, 0.0, 0.0]\nradius = -0.1", 'key "radius" is -0.1'),
        (B + "centre = [0.0, 0.0, 0.0]\nsize = [1.0, 0.0, 1.0]", 'a box has a "size" above zero'),
        (
            B + "centre = [0.0, 0.0, 0.0]\nsize = [1.0, 1.0]",
            'key "size" has 2 numbers; give 3',
        ),
        (B + "centre = [0.0, 0.0]\nradius = 0.1", 'body "b" has 2 coordinates'),
        (B + "centre = [0.0, 0.0, 0.0]\nradius = '0.1'", 'bodies[0] ("b"): radius is '),
        (B + "center = [0.0, 0.0, 0.0]", "center is an unknown key; did you mean"),
        (
            "[[bodies]]\nperson = 'standing'\nradius = 0.2",
            'person = "standing": key "radius" does not belong to it; the keys are at, facing',
        ),
        (
            TABLES + '[[bodies]]\nname = "arm"\ncentre = [0.0, 0.0, 0.0]\nradius = 0.1',
            'body "arm": key "name" is used',
        ),
        ('bodies = "sitting"', "person is "),
        ('bodies = {person = "seated", facing = [0.0, 0.0, 2.0]}', 'in "facing" a direction that is not upright'),
        ('bodies = {person = "seated", height = 175}', 'key "height" is 175'),
        ("bodies = 3", "bodies is 3; give"),
        ('[[frames]]\nname = "head"\nposition = [0.0, 0.0, 0.0]', "carries no module and no body"),
    ],
)
def test_wrong_bodies_are_named(bodies, words):
    with pytest.raises(RigError) as raised:
        load(bodies)
    assert words in str(raised.value)
    assert str(raised.value).startswith("desk.toml: ")


def test_a_person_needs_an_axis_that_points_up():
    with pytest.raises(RigError, match='key "up" is missing; a person needs'):
        rig_from_toml(RIG.format(bodies='bodies = "standing"').replace('up = "z"', ""), "desk.toml")


@pytest.mark.parametrize("up", ["x", "y", "z", "-z"])
@pytest.mark.parametrize("posture", ["standing", "seated"])
def test_a_person_stands_on_the_floor_and_faces_ahead(posture, up):
    """Heights known of the source: 1.75 m from sole to vertex; a seated person is a thigh, 0.245 of it, lower."""
    upright = tl.model.module.upward(up, 3)
    at, facing = np.array([0.3, -0.2, 0.5]), np.roll(upright, 2) + 0.3 * upright
    bodies, rest = tl.person(posture, up, at, facing, height=1.75, margin=0.07, sway=0.01)
    assert {(body.margin, body.sway, body.frame) for body in bodies} == {(0.07, 0.01, "person")}
    frames = {"person": rest.frame}
    placed = dict(zip([b.name for b in bodies], place_bodies(bodies, np.zeros(3), None, frames), strict=True))
    heights = {name: (where.ends - at) @ upright for name, where in placed.items()}
    assert heights["head"].max() + bodies[0].radius == pytest.approx(
        1.75 * (1.0 if posture == "standing" else 0.755)
    )
    soles = [heights[body.name].min() - body.radius for body in bodies if body.size is None]
    assert min(soles) == pytest.approx(0.0, abs=1e-12)
    level = facing - (facing @ upright) * upright
    torso = next(body for body in bodies if body.name == "torso")
    across = placed["torso"].axes.T @ np.cross(upright, level)
    assert torso.size @ np.abs(across) == pytest.approx(2 * 0.284)
    if posture == "seated":
        thigh = placed["left thigh"].ends
        np.testing.assert_allclose(thigh[1] - thigh[0], 0.245 * 1.75 * level, atol=1e-12)
        left = np.cross(upright, level)
        assert (placed["left shank"].ends - placed["right shank"].ends) @ left == pytest.approx([0.17, 0.17])
