"""What is proved of layouts: between the points of the target, too."""

from dataclasses import replace

import numpy as np

import tensionlab as tl
from tensionlab.model.requirement import Requirement
from tensionlab.workspace import Objective, PoseList, Space, Surface, box, room, search_layout
from tensionlab.workspace.layout.objective import as_targets
from tensionlab.workspace.layout.search import proved_force

RIG = tl.load_rig("bartels2026-validation")
TARGET = box((-0.1, 0.1), (0.2, 0.4), (-0.1, 0.1), step=0.2)
POINTS = TARGET.arrays()[0]


def least_margin(rig, count=21):
    grid = box((-0.1, 0.1), (0.2, 0.4), (-0.1, 0.1), step=0.2 / (count - 1)).arrays()[0]
    return float(tl.workspace.capacity_margin(rig.structure_matrix(grid), rig.limits).min())


def test_the_force_that_is_proved_is_nearly_all_there_is():
    least = least_margin(RIG)
    assert 0.99 * least < proved_force(RIG, (TARGET,), Objective(), 1.1 * least) < least
    assert proved_force(RIG, (TARGET,), Objective(), 0.5) == 0.5
    assert proved_force(RIG, as_targets(POINTS[:1], 3), Objective(), 0.5) == 0.5  # a single position


def test_the_force_is_counted_from_what_is_required():
    held, least = replace(RIG, required=Requirement(ball=0.3)), least_margin(RIG)
    assert 0.99 * (least - 0.3) < proved_force(held, (TARGET,), Objective(), least) < least - 0.3
    assert np.isnan(proved_force(replace(RIG, required=Requirement(ball=50.0)), (TARGET,), Objective(), 1.0))
    assert np.isnan(proved_force(RIG, (TARGET,), Objective(), -0.1))


def test_a_search_proves_what_it_returns():
    space = Space(room([3.0, 2.4, 4.0]), (4, 5))
    hand = box((-0.2, 0.2), (1.0, 1.4), (-0.2, 0.2), step=0.2)
    arguments = {"generations": 2, "starts": 1, "seed": 1}
    plain = search_layout(space, hand, Objective(), **arguments)
    found = search_layout(space, hand, Objective(), **arguments, certify=True)
    for one, other in zip(plain.layouts, found.layouts, strict=True):
        assert one.proved is None
        assert 0.97 * one.worst < other.proved <= other.worst
        assert "# proved everywhere in the target" in other.to_toml()
        assert "proved" not in one.to_toml()


def test_a_planar_target_without_height_is_proved_too():
    walls = [Surface(name, corner, [[0, 2]]) for name, corner in (("east", [1, -1]), ("west", [-1, -1]))]
    space = Space(walls, (4,), (1.0, 5.0))
    (layout,) = search_layout(
        space, box((-0.1, 0.1), (0, 0), step=0.1), Objective(0.5), generations=2, starts=1, certify=True
    ).layouts
    assert layout.proved == 0.5


def test_a_force_along_a_direction_is_proved_beyond_that_in_every_direction_and_along_a_path():
    path = PoseList([[-0.1, 0.2, -0.1], [0.1, 0.3, 0.0], [0.0, 0.4, 0.1]])
    space = Space(room([3.0, 2.4, 4.0], centre=[0, 0.3, 0]), (5,), required=Requirement(ball=0.5))
    objective = Objective(directions=[[0, 1, 0]])
    found = search_layout(space, path, objective, generations=2, starts=1, certify=True).best
    assert found.score > found.worst
    assert 0.97 * found.score < found.proved <= found.score
    share = np.linspace(0.0, 1.0, 200)[:, None, None]
    line = (path.position[:-1] + share * np.diff(path.position, axis=0)).reshape(-1, 3)
    pull = tl.allocate(found.rig.structure_matrix(line), [0.0, found.proved, 0.0], found.rig.limits)
    assert (pull.status == tl.Status.EXACT).all()
    desired = search_layout(
        space, path, replace(objective, force=0.9 * found.score), certify=True, generations=2, starts=1
    ).best
    assert desired.score == 1.0
    assert desired.proved == 0.9 * found.score
