"""Searches whose answers are known, and what a search says of them. Small budgets."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import InputError, ShapeError
from tensionlab.model.files import rig_from_toml
from tensionlab.model.module import Module, Platform
from tensionlab.workspace import Objective, Space, Surface, box, capacity_margin, room, search_layout
from tensionlab.workspace.layout.objective import as_targets
from tensionlab.workspace.layout.problem import LayoutProblem, polish
from tensionlab.workspace.layout.space import Placement
from tests.helpers.examples import many

WALLS = (
    Surface("south", [-1, -1], [[2, 0]]),
    Surface("east", [1, -1], [[0, 2]]),
    Surface("north", [-1, 1], [[2, 0]]),
    Surface("west", [-1, -1], [[0, 2]]),
)
LIMITS = (1.0, 5.0)


@pytest.mark.parametrize("count", [3, 5])
def test_an_odd_number_of_modules_around_a_point_is_as_good_as_can_be(count):
    """The available forces are a polygon with 2m sides of 4 N; of these the regular one holds the largest disc."""
    found = search_layout(Space(WALLS, (count,), LIMITS), [[0, 0]], Objective(), generations=3, starts=2)
    (layout,) = found.layouts
    assert layout.score == pytest.approx(2 / np.tan(np.pi / (2 * count)), rel=1e-3)
    assert layout.score == layout.worst
    assert layout.rig.kind == "planar-point"


def test_the_rig_has_the_score_and_its_modules_the_contributions():
    """Measured again by way of the rig, its structure matrices and the capacity margin."""
    door = Module("door", [1.0, 0.2, 0.1], 0.5, 3.0)
    space = Space(room([2, 2, 2], centre=[0, 0, 0]), (4,), LIMITS, fixed=(door,))
    target = box((-0.2, 0.2), (-0.2, 0.2), (0, 0.2), step=0.2)
    found = search_layout(space, target, Objective(1.0), name="five", generations=1, starts=1)
    layout = found.best
    positions = target.arrays()[0]
    rig = layout.rig
    assert rig.name == "five-5"
    assert rig.modules[-1] == door
    margins = capacity_margin(rig.structure_matrix(positions), rig.limits)
    share = np.tile([[[1.0], [2.0], [1.0]]] * np.array([1.0, 2.0, 1.0])[:, None, None], 2).ravel() / 32
    assert layout.score == pytest.approx((margins >= 1.0) @ share)
    assert layout.worst == pytest.approx(margins.min(), abs=1e-12)
    np.testing.assert_allclose(rig.home, [0, 0, 0.1], atol=1e-15)
    for index, lost in enumerate(layout.contributions):
        rest = tl.Rig(
            name="rest", kind="point", modules=rig.modules[:index] + rig.modules[index + 1 :], home=rig.home
        )
        without = capacity_margin(rest.structure_matrix(positions), rest.limits)
        assert lost == pytest.approx(layout.score - (without >= 1.0) @ share)
    surfaces = [surface.name for surface in space.surfaces]
    order = [surfaces.index(module.name.rsplit(" ", 1)[0]) for module in rig.modules[:-1]]
    assert order == sorted(order)
    for module in rig.modules[:-1]:
        assert np.abs(module.anchor).max() == pytest.approx(1.0)
        assert (module.lower, module.upper) == LIMITS


def test_margins_are_about_what_is_required_and_the_rig_says_so():
    """A tool of 0.3 kg, and pushes of 1 N about its weight: another layout than that without a load is best."""
    required = tl.Requirement(wrench=[1.0, 0.0], box=[0.5, 0.0], ball=0.2, gravity=True)
    loaded = Space(WALLS, (3,), LIMITS, up="y", platform=Platform(0.3), required=required)
    rig = (found := search_layout(loaded, [[0, 0]], Objective(), generations=3, starts=2).best).rig
    corners = [[0.5, 0.3 * 9.81], [1.5, 0.3 * 9.81]]
    margin = capacity_margin(rig.structure_matrix([0, 0]), rig.limits, corners) - 0.2
    assert found.score == pytest.approx(margin, abs=1e-9)
    assert (rig.platform, rig.required, rig.up) == (Platform(0.3), required, "y")
    assert "about its weight of 0.3 kg and the wrench" in rig.description
    assert rig_from_toml(text := found.to_toml(), "text") == rig
    assert f"score {found.score:.4g}, worst margin" in text
    without = search_layout(Space(WALLS, (3,), LIMITS), [[0, 0]], Objective(), generations=3, starts=2).best.rig
    assert margin > capacity_margin(without.structure_matrix([0, 0]), without.limits, corners) - 0.2 + 0.5


def test_a_layout_for_losses_keeps_its_force_without_any_one_cable():
    """Eight modules around a square: more is left after the worst loss than of the layout that is best intact."""
    space, hand = Space(WALLS, (8,), LIMITS), [[0.0, 0.0], [0.2, 0.1]]
    intact, robust = (
        search_layout(space, hand, Objective(losses=losses), generations=2, starts=2, certify=True).best
        for losses in (0, 1)
    )
    left = [
        tl.workspace.loss_margins(found.rig.structure_matrix(hand), found.rig.limits).min()
        for found in (intact, robust)
    ]
    assert robust.score == robust.worst == pytest.approx(left[1], abs=1e-9)
    assert left[1] > left[0] + 0.1
    assert 0.9 * left[1] < robust.proved <= left[1]
    assert "in every direction after the loss of any one cable throughout" in robust.rig.description
    pushed = search_layout(space, hand, Objective(1.0, [[0, 1]], losses=1), generations=2, starts=1).best
    assert pushed.score == 1.0
    few = search_layout(
        Space(WALLS, (2,), LIMITS), hand, Objective(losses=1), generations=1, starts=1, certify=True
    )
    assert np.isnan(few.best.proved)
    with pytest.raises(InputError, match="losses is 2"):
        Objective(losses=2)


def test_the_same_seed_gives_the_same_layout_and_another_seed_another_way_there(monkeypatch):
    space = Space(room([2, 2, 2], centre=[0, 0, 0]), (4,), LIMITS)
    target = [[0, 0, 0], [0.3, 0.1, 0.2]]

    def anchors(seed):
        return search_layout(space, target, Objective(), seed=seed, generations=1, starts=1).best.rig.anchors

    first = anchors(3)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "1")
    np.testing.assert_array_equal(first, anchors(3))
    assert not np.array_equal(first, anchors(4))


def test_the_front_holds_the_layouts_that_further_modules_pay_for():
    space = Space(WALLS, (6, 3, 2), LIMITS)
    found = search_layout(space, [[0, 0]], Objective(3.0), generations=1, starts=1)
    assert [layout.rig.m for layout in found.layouts] == [2, 3, 6]
    assert [layout.score for layout in found.layouts] == [0, 1, 1]
    assert [layout.rig.m for layout in found.front] == [2, 3]
    assert found.best.rig.m == 3


def test_modules_on_a_body_keep_the_axes_of_the_body():
    """Only a box on the hip and two fixed modules: the searched module ends up in the box, in the hip's axes."""
    belt = Surface("belt", [-0.1, 0, 0], [[0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.05]], frame="hip")
    fixed = tuple(Module(f"f{i}", anchor, *LIMITS) for i, anchor in enumerate(np.eye(3)))
    space = Space((belt,), (1,), LIMITS, fixed=fixed, rest=(tl.RestPose("hip", [-1.0, -1.0, -1.0]),))
    found = search_layout(space, [[0, 0, 0]], Objective(), generations=3, starts=2).best
    module = found.rig.modules[0]
    assert (module.name, module.frame) == ("belt 1", "hip")
    assert ((module.anchor >= [-0.1, 0, 0]) & (module.anchor <= [0.1, 0.1, 0.05])).all()
    margin = capacity_margin(found.rig.structure_matrix([0, 0, 0], frames=found.rig.at_rest), found.rig.limits)
    assert found.score == pytest.approx(margin, abs=1e-12)
    # The best is on the diagonal, opposite to the three others: (x, y, z) all equal in the world.
    placed = module.anchor - 1.0
    np.testing.assert_allclose(placed / placed[0], 1, atol=0.06)


def test_bad_input_is_refused():
    space = Space(WALLS, (3,), LIMITS)
    with pytest.raises(ShapeError, match="target has shape"):
        search_layout(space, [[0, 0, 0]], Objective())
    with pytest.raises(ShapeError, match="no points"):
        search_layout(space, np.zeros((0, 2)), Objective())
    with pytest.raises(InputError, match="starts is 0"):
        search_layout(space, [[0, 0]], Objective(), starts=0)
    with pytest.raises(InputError, match="generations is 0"):
        search_layout(space, [[0, 0]], Objective(), generations=0)


DESIRED = [
    (None, {}), (0.5, {}), (2.0, {}), (9.0, {}),
    (None, {"directions": [[0, 1, 0], [1, 0, 0]]}),
    (None, {"walls": [[0, 1, 0]]}),
    (2.0, {"directions": [[0, 1, 0]], "stiffness": 300.0, "walls": [[0, 0, -1]]}),
]  # fmt: skip


@pytest.mark.parametrize(("force", "desired"), DESIRED)
@pytest.mark.parametrize("seed", range(many(5, least=1)))
def test_polishing_never_makes_it_worse_and_stays_on_the_surfaces(force, desired, seed):
    space = Space(room([2, 2, 2], centre=[0, 0, 0]), (6,))
    rng = np.random.default_rng(seed)
    start = space.decode(rng.random((6, 1, 4)))
    target = rng.uniform(-0.5, 0.5, size=(20, 3))
    objective = Objective(force, **desired)
    problem = LayoutProblem.of(space, as_targets(target, 3), objective)
    before = problem.values(space.cables(start))
    found, margins = polish(problem, start)
    np.testing.assert_allclose(margins, problem.values(space.cables(found)), atol=1e-12)
    least = [each.min(axis=0) for each in (margins, before)]
    assert objective.smooth(least[0], 0.01) >= objective.smooth(least[1], 0.01) - 1e-9
    assert ((found.along >= 0) & (found.along <= 1)).all()
    np.testing.assert_array_equal(found.surfaces, start.surfaces)
    if objective.level is None:
        assert margins.min() > before.min() + 0.1


def test_no_layout_nearby_is_better_than_the_polished_one():
    space = Space(room([2, 2, 2], centre=[0, 0, 0]), (5,))
    rng = np.random.default_rng(4)
    target = rng.uniform(-0.3, 0.3, size=(8, 3))
    problem = LayoutProblem.of(space, as_targets(target, 3), Objective())
    found, margins = polish(problem, Placement(np.arange(5)[:, None], rng.random((5, 1, 3))))
    near = np.clip(found.along + rng.normal(scale=0.01, size=(4000, 5, 1, 3)), 0, 1)
    others = space.cables(Placement(np.broadcast_to(found.surfaces, (4000, 5, 1)), near))
    assert problem.values(others).min(axis=(-2, -1)).max() <= margins.min() + 1e-4


def test_progress_is_shown_as_it_comes():
    shares = []
    search_layout(
        Space(WALLS, (2, 3), LIMITS), [[0, 0]], Objective(), generations=3, starts=2, progress=shares.append
    )
    assert (np.diff(shares) >= 0).all()
    assert shares[-1] == pytest.approx(1.0)
