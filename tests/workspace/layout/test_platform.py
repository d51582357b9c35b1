"""Layouts of platforms: anchors, attachments or both, held against independent linear programs."""

import numpy as np
import pytest
from scipy.optimize import linprog

import tensionlab as tl
from tensionlab.errors import InputError, RigError, ShapeError
from tensionlab.model.kinematics import exponential
from tensionlab.workspace import Objective, PoseList, Space, Surface, box, search_layout
from tensionlab.workspace.layout.objective import as_targets
from tensionlab.workspace.layout.problem import LayoutProblem, polish

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
ROOM = tuple(
    Surface(f"post {i}", [2.0 * x, 1.5 * y, 0.0], [[0, 0, 3.0]]) for i, (x, y) in enumerate(CORNERS[::2, :2])
)
PLATE = Surface("plate", [-0.3, -0.2, -0.1], [[0.6, 0, 0], [0, 0.4, 0], [0, 0, 0.2]])
LIMITS = (5.0, 200.0)
LOAD = {"platform": tl.Platform(5.0, com=[0.05, 0.0, 0.02]), "up": "z"}
TILTS = exponential(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, -0.1, 0.1]]))
HAND = box((-0.3, 0.3), (-0.2, 0.2), (1.2, 1.8), step=0.3, rotations=TILTS)
FLAT = {
    "surfaces": tuple(Surface(f"side {i}", [-1, y], [[2, 0]]) for i, y in enumerate((-1, 1))),
    "attachments": (Surface("bar", [-0.2, -0.1], [[0.4, 0], [0, 0.2]]),),
}


def largest_force(rig, position, rotation, direction):
    """Return the largest force along a direction beyond what is required, by a linear program of HiGHS."""
    structure, required = rig.structure_matrix(position, rotation), rig.required.middle(rig, rotation)
    matrix = np.column_stack([structure, -direction])
    bounds = [*zip(rig.limits.lower, rig.limits.upper, strict=True), (0, None)]
    found = linprog(np.append(np.zeros(rig.m), -1.0), A_eq=matrix, b_eq=required, bounds=bounds, method="highs")
    return found.x[-1] if found.success else -np.inf


@pytest.mark.parametrize("symmetry", [(), ("x",), ("x", "y"), ("2-fold",)])
@pytest.mark.parametrize("spatial", [True, False])
def test_slopes_by_anchors_and_attachments_are_finite_differences(spatial, symmetry):
    rng = np.random.default_rng(3)
    required = tl.Requirement(gravity=True, ball=1.0)
    if spatial:
        space = Space(ROOM, (8,), LIMITS, attachments=(PLATE,), symmetry=symmetry, required=required, **LOAD)
        target = PoseList(
            rng.uniform([-0.2, -0.2, 1.3], [0.2, 0.2, 1.7], (3, 3)), exponential(rng.normal(0, 0.1, (3, 3)))
        )
    else:
        space = Space(**FLAT, counts=(8,), limits=LIMITS, symmetry=symmetry)
        target = PoseList(rng.uniform(-0.2, 0.2, (3, 2)), rng.normal(0, 0.1, 3))
    problem = LayoutProblem.of(space, as_targets(target, space.dimension, turns=True), Objective())
    count, d, step = 8 // len(space.images), space.dimension, 1e-6
    places = space.decode(rng.uniform(0.3, 0.7, size=(count, 2, d + 1)))
    found = problem.linear(places, problem.poses)
    np.testing.assert_allclose(found.values, problem.values(space.cables(places)), atol=1e-9)
    for index in np.ndindex(count, 2, d):
        moved = []
        for sign in (1, -1):
            along = places.along.copy()
            along[index] += sign * step
            moved.append(problem.values(space.cables(places._replace(along=along))))
        slopes = found.slopes.reshape(-1, count, 2, d)[(slice(None), *index)]
        np.testing.assert_allclose(slopes, ((moved[0] - moved[1]) / (2 * step)).ravel(), rtol=1e-4, atol=1e-4)


def test_a_platform_that_is_found_renders_its_score_in_every_direction():
    """Its margin is that of its rig; random wrenches of that size are feasible for HiGHS; and it is proved."""
    required = tl.Requirement(gravity=True)
    space = Space(ROOM, (8,), LIMITS, attachments=(PLATE,), symmetry=("x", "y"), required=required, **LOAD)
    layout = search_layout(space, HAND, Objective(), generations=5, starts=2, certify=True).best
    rig = layout.rig
    assert (rig.kind, rig.m) == ("platform", 8)
    assert rig.required.length == pytest.approx(np.linalg.norm([0.3, 0.2, 0.1]))
    margins = tl.sweep(rig, HAND, ["capacity-margin"])["capacity-margin"].values
    assert layout.score == pytest.approx(margins.min(), abs=1e-6)
    assert 0.95 * layout.score < layout.proved <= layout.score
    rng = np.random.default_rng(0)
    least = np.inf
    for _ in range(300):  # between the points, too
        position = rng.uniform([-0.3, -0.2, 1.2], [0.3, 0.2, 1.8])
        direction = rng.normal(size=6)
        direction /= np.linalg.norm(direction)
        direction[3:] *= rig.required.length
        least = min(least, largest_force(rig, position, TILTS[rng.integers(3)], direction))
    assert layout.proved <= least
    # Every cable has its mirror images, with attachments on the plate and anchors on the posts.
    ends = np.stack([rig.anchors, rig.attachments], axis=1)
    for mirror in ([-1, 1, 1], [1, -1, 1]):
        images = (ends * mirror)[:, None] - ends
        assert (np.abs(images).max(axis=(-2, -1)).min(axis=1) < 1e-9).all()
    assert (np.abs(rig.attachments) <= np.array([0.3, 0.2, 0.1]) + 1e-9).all()
    np.testing.assert_allclose(np.abs(rig.anchors[:, :2]), np.tile([2.0, 1.5], (8, 1)))
    assert rig.modules[3].name == f"{rig.modules[0].name} image 3"


def test_anchors_alone_and_attachments_alone_are_searched():
    """Points are surfaces without edges: only what may move does, and a search of both is at least as good."""
    points = tuple(Surface(f"corner {i}", 0.5 * PLATE.corner * signs) for i, signs in enumerate(CORNERS))
    posts = tuple(Surface(f"end {i}", [2 * x, 1.5 * y, 1.5 + 1.5 * z]) for i, (x, y, z) in enumerate(CORNERS))
    quick = {"generations": 2, "starts": 1}
    anchors = search_layout(Space(ROOM, (8,), LIMITS, attachments=points), HAND, Objective(), **quick).best.rig
    there = np.abs(anchors.attachments[:, None] - [each.corner for each in points]).max(axis=-1)
    assert (there.min(axis=1) < 1e-9).all()
    fixed = search_layout(Space(posts, (8,), LIMITS, attachments=(PLATE,)), HAND, Objective(), **quick).best.rig
    there = np.abs(fixed.anchors[:, None] - [each.corner for each in posts]).max(axis=-1)
    assert (there.min(axis=1) < 1e-9).all()
    assert (np.abs(fixed.attachments) <= np.abs(PLATE.corner) + 1e-9).all()


def test_polishing_moves_attachments_to_where_the_force_is_largest():
    space = Space(**FLAT, counts=(4,), limits=(1.0, 5.0))
    problem = LayoutProblem.of(space, as_targets([[0.0, 0.0]], 2, turns=True), Objective())
    rng = np.random.default_rng(1)
    start = space.decode(rng.random((4, 2, 3)))
    before = problem.values(space.cables(start)).min()
    found, values = polish(problem, start)
    assert values.min() > before + 0.1
    near = np.clip(found.along + rng.normal(scale=0.01, size=(3000, *found.along.shape)), 0, 1)
    others = space.cables(found._replace(surfaces=np.broadcast_to(found.surfaces, near.shape[:-1]), along=near))
    assert problem.values(others).min(axis=(-2, -1)).max() <= values.min() + 1e-4


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Space(ROOM, (8,), attachments=(PLATE,), symmetry=("w",)), "symmetry has 'w'; give \"x\""),
        (lambda: Space(ROOM, (8,), attachments=(PLATE,), symmetry=("3-fold",)), "give up as well"),
        (lambda: Space(ROOM, (6,), attachments=(PLATE,), symmetry=("x", "y")), "give multiples of 4"),
        (lambda: Space(ROOM, (6,), attachments=(PLATE,), bodies=(tl.Body("b", [0, 0, 0], radius=1.0),)), "bodies"),
        (lambda: Space(ROOM, (6,), attachments=(Surface("s", [0, 0, 0], frame="hip"),)), "leave frame out"),
    ],
)
def test_a_space_for_platforms_that_is_none_is_refused(make, message):
    with pytest.raises(RigError, match=message):
        make()


def test_what_no_platform_has_is_refused():
    space = Space(ROOM, (8,), LIMITS, attachments=(PLATE,))
    with pytest.raises(InputError, match="walls push a hand"):
        search_layout(space, HAND, Objective(walls=[[0, 0, 1]]))
    with pytest.raises(InputError, match="a path with orientations cannot be proved"):
        search_layout(space, PoseList([[0, 0, 1]], [np.eye(3)]), Objective(), certify=True)
    with pytest.raises(ShapeError, match="target has wrenches"):
        search_layout(space, PoseList([[0, 0, 1]], wrench=[[0, 0, 1]]), Objective())
    with pytest.raises(ShapeError, match="target has orientations"):
        search_layout(Space(ROOM, (8,), LIMITS), HAND, Objective())
