"""What leaves the design page: the rig as TOML, as a MuJoCo model, and the state as Python."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from tensionlab.errors import RigError, WriteError
from tensionlab.model.files import save_rig
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.support.files.named import is_path
from tensionlab.validation.rig_check import check_rig
from tensionlab.viewer.state import State

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
    failed = [each for each in check_rig(rig) if each.passed is False]
    if failed:
        findings = "; ".join(f"{each.name}: {each.text}" for each in failed)
        raise RigError(f"{rig.name} cannot work at home, so it is not saved. {findings}")
    writing.require_writable(place, (RIG_SUFFIX,))
    save_rig(rig, place)
    return place


def python_text(state: State, source: str) -> str:
    """Return a program that loads the rig from a file or by name, and allocates tensions as the page does."""
    rig = state.rig
    pose = "position"
    lines = ["import numpy as np", ""] if rig.required else []
    lines += [
        "import tensionlab as tl",
        "",
        f"rig = tl.load_rig({json.dumps(source, ensure_ascii=False)})",
        f"position = {_number(state.position)}",
    ]
    if state.rotation is not None:
        lines.append(f"rotation = {_number(state.rotation)}")
        pose += ", rotation"
    lines.append(f"wrench = {_number(state.wrench)}")
    if rig.required:
        turn = ", rotation" if state.rotation is not None else ""
        lines.append(f"wrench = np.add(wrench, rig.required.middle(rig{turn}))")
    frames = ", frames=rig.at_rest" if rig.frames else ""
    policy = "" if state.policy is None else f', policy="{state.policy}"'
    lines += [
        f"structure = rig.structure_matrix({pose}{frames})",
        "result = tl.allocate(",
        "    structure, wrench, rig.limits,",
        f'    solver="{state.solver}"{policy},',
        ")",
        "print(result)",
    ]
    return "\n".join(lines) + "\n"


def _number(values: np.ndarray) -> str:
    """Return an array as Python has it, rounded to what can be told apart."""
    return str((np.round(values, 12) + 0.0).tolist())


def default_path(rig: Rig, word: str, folder: Path) -> str:
    """Return the path, below a folder, that is proposed for a rig that was given by a name or a path."""
    if is_path(word, RIG_SUFFIX):
        try:
            place_below(folder, word)
        except WriteError:
            return Path(word).name
        return word
    return file_name(rig, RIG_SUFFIX)


def file_name(rig: Rig, suffix: str) -> str:
    """Return a rig's name as that of a file, without what leads to another folder."""
    return (re.sub(r"[^\w .-]", "_", rig.name).strip(" .") or "rig") + suffix
