"""Files of the design page: rigs that it saves and spaces that it reads, below the folder where it was started."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tensionlab.errors import RigError, WriteError
from tensionlab.model.files import save_rig
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.support.files.named import is_path, list_names
from tensionlab.validation.rig_check import check_rig
from tensionlab.viewer.state import Edit
from tensionlab.workspace.layout.task import load_task

SUFFIX = ".toml"


def place_below(folder: Path, path: str) -> Path:
    """Return the place of a path that a browser gives, which must lie below a folder.

    Raises
    ------
    WriteError
        If it lies elsewhere; symbolic links are followed.
    """
    try:
        place = (folder / path.strip()).resolve()
        inside = place.is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # a null character, or a loop of links
        raise WriteError(f"{path!r} is no path of a file ({error})") from None
    if not inside:
        raise WriteError(f"{path}: the page was started in {folder}, and uses files below it only; name one there")
    return place


def save(rig: Rig, path: str, folder: Path) -> Path:
    """Write a rig to a TOML file below a folder, unless ``rig check`` says that it cannot work.

    Raises
    ------
    RigError
        With the findings of the checks that failed.
    WriteError
        If the file cannot be written, or lies elsewhere.
    """
    place = place_below(folder, path)
    writing.require_writable(place, (SUFFIX,))
    failed = [check for check in check_rig(rig) if check.passed is False]
    if failed:
        findings = "; ".join(f"{check.name}: {check.text}" for check in failed)
        raise RigError(f"{rig.name} cannot work at home, so it is not saved. {findings}")
    save_rig(rig, place)
    return place


def snap_to_space(word: str, folder: Path) -> Edit:
    """Return the edit that snaps anchors to a space, by its name or its file; to none until that is complete."""
    name = word.strip()
    if name not in list_names("spaces") and not name.endswith(SUFFIX):
        return lambda state: replace(state, task=None)
    return lambda state: replace(
        state, task=load_task(place_below(folder, name) if is_path(name, SUFFIX) else name)
    )
