"""What leaves the page: files that are read again, and programs that run."""

import ast
import subprocess
import sys

import pytest

import tensionlab as tl
from tensionlab.errors import WriteError
from tensionlab.viewer import export
from tensionlab.viewer import state as edits
from tensionlab.viewer.state import begin


@pytest.fixture
def point():
    return begin(tl.load_rig("bartels2026-validation"))


def test_what_is_saved_is_the_very_same_rig(point, tmp_path):
    moved = edits.move_anchor(point, "floor-1", [0.7, 0.0, 0.1])
    export.save(moved.rig, "mine.toml", tmp_path)
    assert tl.load_rig(tmp_path / "mine.toml") == moved.rig


def test_a_rig_that_cannot_work_is_not_saved(point, tmp_path):
    below = edits.move_anchor(point, "top", [0.0, -0.5, 0.0])
    with pytest.raises(tl.RigError, match=r"cannot work at home, so it is not saved\. balance: no tensions hold"):
        export.save(below.rig, "mine.toml", tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", ["", "rig.txt", "rig"])
def test_a_file_of_another_kind_is_refused(point, path, tmp_path):
    with pytest.raises(WriteError, match=r"ends in \.toml"):
        export.save(point.rig, path, tmp_path)


@pytest.mark.parametrize("path", ["../mine.toml", "/mine.toml", "link/mine.toml", "a/../../mine.toml", "a\0.toml"])
def test_a_file_elsewhere_is_refused(point, path, tmp_path):
    here = tmp_path / "here"
    here.mkdir()
    (here / "link").symlink_to(tmp_path)
    with pytest.raises(WriteError, match=r"uses files below it only|is no path"):
        export.save(point.rig, path, here)
    assert list(tmp_path.iterdir()) == [here]


def test_a_rig_by_name_is_saved_under_it_and_a_file_in_its_place(point, tmp_path):
    def proposed(name, word):
        return export.default_path(edits.name_rig(point, name).rig, word, tmp_path)

    assert proposed("bartels2026-validation", "bartels2026-validation") == "bartels2026-validation.toml"
    assert proposed("mine", "rooms/mine.toml") == "rooms/mine.toml"
    assert proposed("mine", "../rooms/mine.toml") == "mine.toml"
    assert proposed("../../x", "bartels2026-validation") == "_.._x.toml"
    assert proposed("/etc/x", "") == "_etc_x.toml"
    assert proposed("..", "") == "rig.toml"


def test_a_name_with_quotes_stays_a_text_in_the_program(point):
    name = '"); raise SystemExit("\n```\n<script>'
    program = export.python_text(point, name)
    [line] = [each for each in program.splitlines() if each.startswith("rig = ")]
    assert ast.literal_eval(line.removeprefix("rig = tl.load_rig(").removesuffix(")")) == name


@pytest.mark.parametrize("name", ["bartels2026-validation", "cogiro", "body-mounted", "kntu-planar"])
def test_the_program_allocates_what_the_page_shows(name, tmp_path):
    state = begin(tl.load_rig(name))
    state = edits.choose(solver="newton", policy="force")(edits.desire(state, state.wrench + 0.5))
    if state.rig.n > state.rig.dimension:
        turn = tl.workspace.roll_pitch_yaw(0.0, 0.0, 0.1)[0] if state.rig.dimension == 3 else 0.1
        state = edits.turn_platform(state, turn)
    program = export.python_text(state, name)
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    structure = state.rig.structure_matrix(state.position, state.rotation, state.rig.at_rest)
    shown = tl.allocate(structure, state.exerted, state.rig.limits, solver="newton", policy="force")
    assert run.stdout.partition("residual")[0] == str(shown).partition("residual")[0]
