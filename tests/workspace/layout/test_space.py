import numpy as np
import pytest

from tensionlab.errors import RigError
from tensionlab.model.module import Module
from tensionlab.model.pose import RestPose
from tensionlab.workspace.layout.space import Placement, Space, Surface, room

CUBE = Space(room([2, 2, 2], centre=[0, 0, 0]), (4,), limits=(1.0, 5.0))
FLOOR = Surface("floor", [-1, 0, -1], [[2, 0, 0], [0, 0, 2]])


def test_a_room_has_six_faces_that_bound_it():
    faces = {face.name: face for face in room([4, 2.5, 3])}
    assert list(faces) == ["left wall", "right wall", "floor", "ceiling", "back wall", "front wall"]
    corners = {
        name: [face.corner + np.array(x) @ face.edges for x in ([0, 0], [0, 1], [1, 0], [1, 1])]
        for name, face in faces.items()
    }
    for name, axis, value in (
        ("left wall", 0, -2), ("right wall", 0, 2), ("floor", 1, 0), ("ceiling", 1, 2.5), ("back wall", 2, -1.5),
        ("front wall", 2, 1.5),
    ):  # fmt: skip
        assert {float(corner[axis]) for corner in corners[name]} == {value}
    everywhere = np.concatenate(list(corners.values()))
    assert len(np.unique(everywhere, axis=0)) == 8
    np.testing.assert_array_equal(np.ptp(everywhere, axis=0), [4, 2.5, 3])
    moved = room([4, 2.5, 3], centre=[1, 1, 1])[2]
    np.testing.assert_array_equal(moved.corner, [-1, -0.25, -0.5])


def test_surfaces_on_bodies_are_placed_where_the_bodies_are():
    """A hip that is turned by 90 degrees about Y and stands at x = 5: its x axis points along -Z of the world."""
    belt = Surface("belt", [0, 0, 0.1], [[0.3, 0, 0]], frame="hip")
    worn = Module("worn", [0.2, 0, 0], 1, 2, frame="hip")
    space = Space((FLOOR, belt), (1,), fixed=(worn,), rest=(RestPose("hip", [5, 1, 0], [0, np.pi / 2, 0]),))
    np.testing.assert_allclose(space.placed.corners, [[-1, 0, -1], [5.1, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(space.placed.edges[1], [[0, 0, -0.3], [0, 0, 0], [0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(space.placed.edges[0], [[2, 0, 0], [0, 0, 2], [0, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(space.placed.fixed, [[[5, 1, -0.2]]], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Surface("", [0, 0, 0], [[1, 0, 0]]), '"name" is empty'),
        (lambda: Surface("s", [0, 0], [[1, 0, 0]]), 'surface "s": key "edges" must list 1 to 2 vectors of 2'),
        (lambda: Surface("s", [0, 0, 0], [[1, 0, 0], [2, 0, 0]]), "zero, parallel or not finite"),
        (lambda: room([4, -2, 4]), "three lengths in m, above zero"),
        (lambda: Space((), (4,)), 'surfaces has 0 entries; give 1 or more'),
        (lambda: Space((FLOOR,), (4,), hardware={"brakes": 1.0}), "hardware.brakes is 'brakes'; give 'brake'"),
        (lambda: Space((FLOOR,), (0,)), r'^Space: counts\[0\] is 0; give more than 0$'),
        (lambda: Space((FLOOR, FLOOR), (4,)), 'surface "floor": its name is used twice'),
        (lambda: Space((FLOOR, Surface("line", [0, 0], [[1, 0]])), (4,)), 'surface "line": has 2 coordinates'),
        (lambda: Space((FLOOR,), (4,), fixed=(Module("m", [0, 0], 1, 2),)), 'module "m": has 2 coordinates'),
        (lambda: Space((FLOOR,), (4,), limits=(3, 2)), 'limits is 3.0 to 2.0'),
        (lambda: Space((Surface("s", [0, 0, 0], [[1, 0, 0]], "hip"),), (4,)), '"hip", which is missing'),
    ],
)  # fmt: skip
def test_a_space_that_is_none_is_refused(make, message):
    with pytest.raises(RigError, match=message):
        make()


def test_genes_pick_surfaces_evenly_and_reach_the_ends_of_edges():
    genes = np.zeros((6, 1, 1, 4))
    genes[:, 0, 0, 0] = (np.arange(6) + 0.5) / 6
    assert CUBE.decode(genes).surfaces.ravel().tolist() == list(range(6))
    last = CUBE.decode(np.ones((1, 1, 1, 4)))
    assert last.surfaces.item() == 5
    middle = CUBE.decode(np.full((1, 1, 1, 4), 0.5))
    np.testing.assert_allclose(middle.along, 0.5)
    along = CUBE.decode(np.linspace(0, 1, 101)[:, None, None, None] * np.ones(4)).along[:, 0, 0, 0]
    assert (along == 0).sum() > 5
    assert (along == 1).sum() > 5
    assert (np.diff(along) >= 0).all()


def test_anchors_lie_on_their_surfaces_with_the_fixed_ones_last():
    fixed = Module("door", [0.9, -1, 0.3], 0, 9)
    space = Space((Surface("rail", [0, 0, 0], [[0, 3, 0]]),), (2,), limits=(1, 5), fixed=(fixed,))
    found = space.cables(Placement(np.zeros((2, 1), int), np.array([[[0.5, 0.9, 0.9]], [[1, 0, 0]]])))[:, 0]
    np.testing.assert_array_equal(found, [[0, 1.5, 0], [0, 3, 0], [0.9, -1, 0.3]])
    limits = space.tension_limits(2)
    assert limits.lower.tolist() == [1, 1, 0]
    assert limits.upper.tolist() == [5, 5, 9]
