"""What leaves the page: files that are read again, and programs that run."""

import subprocess
import sys

import pytest

import tensionlab as tl
from tensionlab.errors import WriteError
from tensionlab.view import export
from tensionlab.view import state as edits
from tensionlab.view.state import begin


@pytest.fixture
def point():
    return begin(tl.load_rig("bartels2026-validation"))


def test_what_is_saved_is_the_very_same_rig(point, tmp_path):
    moved = edits.move_anchor(point, "floor-1", [0.7, 0.0, 0.1])
    export.save(moved.rig, str(tmp_path / "mine.toml"))
    assert tl.load_rig(tmp_path / "mine.toml") == moved.rig


def test_a_rig_that_cannot_work_is_not_saved(point, tmp_path):
    below = edits.move_anchor(point, "top", [0.0, -0.5, 0.0])
    with pytest.raises(tl.RigError, match=r"cannot work at home, so it is not saved\. balance: no tensions hold"):
        export.save(below.rig, str(tmp_path / "mine.toml"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", ["", "rig.txt", "rig"])
def test_a_file_of_another_kind_is_refused(point, path):
    with pytest.raises(WriteError, match=r"ends in \.toml"):
        export.save(point.rig, path)


def test_a_rig_by_name_is_saved_under_it_and_a_file_in_its_place(point):
    assert export.default_path(point.rig, "bartels2026-validation") == "bartels2026-validation.toml"
    assert export.default_path(point.rig, "rooms/mine.toml") == "rooms/mine.toml"


@pytest.mark.parametrize("name", ["bartels2026-validation", "cogiro", "body-mounted", "kntu-planar"])
def test_the_program_allocates_what_the_page_shows(name, tmp_path):
    state = begin(tl.load_rig(name))
    state = edits.choose(solver="newton", nearest="force")(edits.desire(state, state.wrench + 0.5))
    if state.rig.n > state.rig.dimension:
        turn = tl.workspace.roll_pitch_yaw(0.0, 0.0, 0.1)[0] if state.rig.dimension == 3 else 0.1
        state = edits.turn_platform(state, turn)
    program = export.python_text(state, name)
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    structure = state.rig.structure_matrix(state.position, state.rotation, state.rig.at_rest)
    shown = tl.allocate(structure, state.exerted, state.rig.limits, solver="newton", nearest="force")
    assert run.stdout.partition("residual")[0] == str(shown).partition("residual")[0]
