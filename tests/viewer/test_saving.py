"""Where the design page saves rigs, and which."""

import pytest

import tensionlab as tl
from tensionlab.errors import WriteError
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_page import save_below
from tensionlab.viewer.state import begin


@pytest.fixture
def point():
    return begin(tl.load_rig("bartels2026-validation"))


def test_what_is_saved_is_the_very_same_rig(point, tmp_path):
    moved = edits.move_anchor(point, "floor-1", [0.7, 0.0, 0.1])
    save_below(tmp_path, moved.rig, "mine.toml")
    assert tl.load_rig(tmp_path / "mine.toml") == moved.rig


def test_a_rig_that_cannot_work_is_not_saved(point, tmp_path):
    below = edits.move_anchor(point, "top", [0.0, -0.5, 0.0])
    with pytest.raises(
        tl.errors.RigError, match=r"cannot work at home, so it is not saved\. balance: no tensions hold"
    ):
        save_below(tmp_path, below.rig, "mine.toml")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", ["", "rig.txt", "rig"])
def test_a_file_of_another_kind_is_refused(point, path, tmp_path):
    with pytest.raises(WriteError, match=r"must end in \.toml"):
        save_below(tmp_path, point.rig, path)


@pytest.mark.parametrize("path", ["../mine.toml", "/mine.toml", "link/mine.toml", "a/../../mine.toml", "a\0.toml"])
def test_a_file_elsewhere_is_refused(point, path, tmp_path):
    here = tmp_path / "here"
    here.mkdir()
    (here / "link").symlink_to(tmp_path)
    with pytest.raises(WriteError, match=r"uses files below it only|is no path"):
        save_below(here, point.rig, path)
    assert [each.name for each in tmp_path.iterdir()] == ["here"]
