"""How a word is written makes it the name of something that comes with the package, or the path of a file."""

import os
import shutil
from pathlib import Path

import pytest

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.support.files import named
from tensionlab.workspace.layout.task import load_task


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An empty folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", ["rigs", "spaces"])
def test_every_name_of_its_kind_loads_without_its_folder(empty, kind):
    load = {"rigs": tl.load_rig, "spaces": load_task}[kind]
    names = [name.partition("/")[2] for name in tl.datasets.names(kind)]
    assert [load(name).name for name in names] == names
    assert "bartels2026-validation-0.3m" in tl.datasets.names("rigs")[1], "a dot is no suffix"


def test_a_name_means_the_package_whatever_files_there_are(empty):
    other = shutil.copy(tl.datasets.folder() / "rigs" / "tetra-4.toml", empty / "cube-8")
    shutil.copy(other, empty / "cube-8.toml")
    assert tl.load_rig("cube-8").m == 8
    for path in ("cube-8.toml", "cube-8.TOML", "./cube-8", str(other), Path("cube-8")):
        if path != "cube-8.TOML":
            assert tl.load_rig(path).name == "tetra-4"
        assert named.is_path(path, ".toml")


def test_a_wrong_name_is_told_which_one_is_close_and_how_to_list_them(empty):
    said = r"no rig is called 'ipanema-3'; did you mean 'ipanema-2'\? A path ends in"
    with pytest.raises(RigError, match=said):
        tl.load_rig("ipanema-3")
    with pytest.raises(
        RigError, match=r"no rig is called 'xyz'; `tensionlab datasets rigs` lists them\. A path ends in \.toml"
    ):
        tl.load_rig("xyz")
    with pytest.raises(RigError, match="no space is called 'four'; did you mean 'four-in-a-room'"):
        load_task("four")
    long = "x" * 10_000
    with pytest.raises(RigError) as refused:
        tl.load_rig(long)
    assert len(str(refused.value)) < 300


def test_a_file_whose_suffix_was_left_out_is_told_by_its_path(empty):
    shutil.copy(tl.datasets.folder() / "rigs" / "tetra-4.toml", empty / "mine.toml")
    with pytest.raises(RigError, match=r"^no rig of tensionlab is called 'mine'; for the file give mine\.toml$"):
        tl.load_rig("mine")


@pytest.mark.parametrize("path", ["cogiro.toml", "rigs/cogiro", "datasets/rigs/cogiro.toml"])
def test_a_path_at_which_there_is_nothing_is_told_the_name(empty, path):
    with pytest.raises(RigError, match=r"no such file; the rig that comes with tensionlab is called 'cogiro'"):
        tl.load_rig(path)


def test_other_paths_are_refused_as_files_are(empty):
    with pytest.raises(RigError, match=r"^my-rig\.toml: no such file; give the path of a rig file"):
        tl.load_rig("my-rig.toml")
    with pytest.raises(RigError, match="cannot be read"):
        tl.load_rig("nul\0/character")


def test_backslashes_separate_where_the_system_says_so(monkeypatch):
    assert named.is_path(f"rigs{os.sep}mine", ".toml")
    assert not named.is_path("rigs\\mine", ".toml") or os.sep == "\\"
    monkeypatch.setattr(named, "SEPARATORS", {"/", "\\"})
    assert named.is_path("rigs\\mine", ".toml")
