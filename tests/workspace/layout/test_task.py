"""Space files: what they mean, and what is said of those that mean nothing."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensionlab.errors import RigError
from tensionlab.model.module import Platform
from tensionlab.model.requirement import Requirement
from tensionlab.workspace.layout.task import load_task

SPACES = Path(__file__).parents[3] / "datasets" / "spaces"

GOOD = """
name = "desk"
counts = [2, 3]

[limits]
lower = 0.5
upper = 6.0

[room]
size = [4.0, 2.5, 3.0]
faces = ["ceiling", "floor"]

[[surfaces]]
name = "belt"
corner = [0.0, 0.0, 0.1]
edges = [[0.3, 0.0, 0.0]]
frame = "hip"

[[modules]]
name = "door"
anchor = [1.0, 0.0, 0.0]
upper = 3.0

[[frames]]
name = "hip"
position = [0.5, 1.0, 0.0]
rotation = [0.0, 0.5, 0.0]

[target]
x = [-0.1, 0.1]
y = [1.0, 1.2]
z = [0.0, 0.0]
step = 0.1

[platform]
mass = 0.2

[required]
ball = 0.5
gravity = true

[objective]
force = 1.5

[search]
seed = 7
generations = 3
starts = 2
"""


@pytest.fixture
def write(tmp_path):
    def written(text):
        path = tmp_path / "desk.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def test_a_file_says_everything_about_a_search(write):
    task = load_task(write(GOOD))
    space = task.space
    assert [surface.name for surface in space.surfaces] == ["belt", "ceiling", "floor"]
    assert (space.counts, space.limits) == ((2, 3), (0.5, 6.0))
    (door,) = space.fixed
    assert (door.name, door.lower, door.upper) == ("door", 0.5, 3.0)
    turn = Rotation.from_rotvec([0, 0.5, 0]).as_matrix()
    np.testing.assert_allclose(space.placed.corners[0], [0.5, 1, 0] + turn @ [0, 0, 0.1], atol=1e-15)
    np.testing.assert_allclose(space.placed.corners[1], [-2, 2.5, -1.5])
    assert task.target[0].arrays()[0].shape == (9, 3)
    assert task.objective.force == 1.5
    assert (space.platform, space.required) == (Platform(0.2), Requirement(ball=0.5, gravity=True))
    assert (task.name, task.seed, task.generations, task.starts) == ("desk", 7, 3, 2)
    found = task.run()
    assert [layout.rig.name for layout in found.layouts] == ["desk-3", "desk-4"]
    assert all(layout.rig.modules[-1] == door for layout in found.layouts)


def test_most_of_a_file_can_be_left_out(write):
    start, end = GOOD.index("[[surfaces]]"), GOOD.index("[target]")
    task = load_task(write(GOOD[:start] + GOOD[end : GOOD.index("[objective]")].replace("faces", "#")))
    assert len(task.space.surfaces) == 2
    assert task.objective.force is None
    assert (task.seed, task.generations, task.starts) == (0, 30, 50)


def test_a_flat_space_has_flat_targets_and_angles(write):
    task = load_task(
        write("""
        name = "flat"
        counts = [3]
        limits = { lower = 1, upper = 5.0 }
        target = { x = [0, 1], y = [0, 1], step = 0.5 }
        surfaces = [{ name = "wall", corner = [0, 0], edges = [[1, 0]], frame = "cart" }]
        frames = [{ name = "cart", position = [1, 1], rotation = [1.5707963267948966] }]
        """)
    )
    assert task.target[0].arrays()[0].shape == (9, 2)
    np.testing.assert_allclose(task.space.placed.edges[0], [[0, 1], [0, 0]], atol=1e-15)


MISTAKES = {
    "unknown key": ("counts", "count", 'count is an unknown key'),
    "no list": ("counts = [2, 3]", "counts = 2", 'counts is 2; give a list (how many modules to place'),
    "step as text": ("step = 0.1", 'step = "small"', "target.step is 'small'; give a number (the distance"),
    "backwards": ("y = [1.0, 1.2]", "y = [1.2, 1.0]", "y goes from 1.2 to 1 m"),
    "too many positions": ("step = 0.1", "step = 0.0001", 'key "step" gives 4,004,001 positions'),
    "edge as text": ("[[0.3, 0.0, 0.0]]", '[["x", 0.0, 0.0]]', 'surfaces[0] ("belt"): edges[0][0] is'),
    "surface without a corner": ("corner =", "corners =", 'corner is missing'),
    "weight unknown": ("mass = 0.2", "mass = -0.2", '[platform]: key "mass" is -0.2'),
    "weight nowhere": ("[platform]\nmass = 0.2", "", "does not know its weight; its file needs [platform]"),
    "frame that is not given": ('frame = "hip"', 'frame = "hand"', 'is attached to the frame "hand"'),
    "turn without end": ("[0.0, 0.5, 0.0]", "[0.0, 1e300, 0.0]", "give rad, within 100"),
    "module with a bad anchor": ("anchor = [1.0, 0.0, 0.0]", "anchor = [1.0, 0.0]", 'module "door": has 2'),
    "no TOML": ("[limits]", "[limits", "not valid TOML"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_named_with_file_table_and_key(write, mistake):
    good, bad, message = mistake
    assert GOOD.count(good) >= 1
    path = write(GOOD.replace(good, bad, 1))
    with pytest.raises(RigError) as caught:
        load_task(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_the_file_in_the_documentation_is_one(write):
    text = (SPACES.parent / "README.md").read_text(encoding="utf-8").split("## The format of a space file")[1]
    task = load_task(write(text.split("```toml")[1].split("```")[0]))
    assert [surface.name for surface in task.space.surfaces] == ["belt", "floor", "ceiling", "left wall"]


@pytest.mark.parametrize("path", sorted(SPACES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_spaces_of_the_repository_can_be_read(path):
    task = load_task(path)
    assert task.name == path.stem
    assert len(task.target[0].arrays()[0]) > 10


WALLS_AND_PATH = """
name = "desk"
counts = [5]
bodies = "standing"
limits = { lower = 0.5, upper = 6.0 }
room = { size = [4.0, 2.5, 3.0] }
objective = { force = 1.0, directions = ["up", [0, 0, 2]], stiffness = 300, walls = ["-x", "down"], losses = 1 }
search = { generations = 1, starts = 1 }
targets = [
  { path = "hand.csv" },
  { x = [-0.1, 0.1], y = [1.0, 1.2], z = [0.4, 0.6], step = 0.1 },
]
"""


def test_directions_are_words_or_vectors_and_targets_paths_or_boxes(write, tmp_path):
    (tmp_path / "hand.csv").write_text("x,y,z\n0,1.1,0.5\n0.1,1.2,0.6\n", encoding="utf-8")
    task = load_task(write(WALLS_AND_PATH))
    assert task.objective.directions == ((0, 1, 0), (0, 0, 1))
    assert task.objective.walls == ((-1, 0, 0), (0, -1, 0))
    assert task.objective.losses == 1
    assert [len(target.arrays()[0]) for target in task.target] == [2, 27]
    assert [body.name for body in task.space.bodies][:3] == ["head", "neck", "torso"]


@pytest.mark.parametrize(
    ("good", "bad", "message"),
    [
        ('"-x"', '"ahead"', '[objective]: key "walls": \'ahead\'; give words such as "up"'),
        ("[0, 0, 2]", "[0, 0]", "of 3 numbers"),
        (", step = 0.1", "", 'key "step" is missing'),
        ('path = "hand.csv"', 'path = "none.csv"', "none.csv"),
        ("stiffness = 300, ", "", "give walls their stiffness"),
        ("room = { size = [4.0, 2.5, 3.0] }",
         'surfaces = [{ name = "a", corner = [0, 0, 0], edges = [[1, 0, 0]] }]',
         'key "up" is missing; a person needs'),
    ],
)  # fmt: skip
def test_mistakes_of_objectives_and_targets_are_named(write, tmp_path, good, bad, message):
    (tmp_path / "hand.csv").write_text("x,y,z\n0,1.1,0.5\n0.1,1.2,0.6\n", encoding="utf-8")
    assert good in WALLS_AND_PATH
    with pytest.raises(RigError, match=r"desk\.toml: ") as caught:
        load_task(write(WALLS_AND_PATH.replace(good, bad)))
    assert message in str(caught.value)
