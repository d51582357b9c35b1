"""Saving from the design page: files below the folder in which it was started, and no others."""

from __future__ import annotations

from pathlib import Path

from tensionlab.errors import RigError, WriteError
from tensionlab.model.files import save_rig
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.validation.rig_check import check_rig

RIG_SUFFIX = ".toml"


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
    """Write a rig to a file below a folder, unless ``rig check`` says that it cannot work; it ends in .toml.

    Raises
    ------
    RigError
        With the findings of the checks that failed.
    WriteError
        If the file cannot be written, or lies elsewhere.
    """
    place = place_below(folder, path)
    if place.suffix.lower() != RIG_SUFFIX:
        raise WriteError(f"{path or 'no file'}: unsupported format; name a file that ends in {RIG_SUFFIX}")
    failed = [check for check in check_rig(rig) if check.passed is False]
    if failed:
        findings = "; ".join(f"{check.name}: {check.text}" for check in failed)
        raise RigError(f"{rig.name} cannot work at home, so it is not saved. {findings}")
    writing.require_writable(place, (RIG_SUFFIX,))
    save_rig(rig, place)
    return place
