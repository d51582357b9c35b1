"""Scenarios in TOML: those that come with this package, by name, and anybody's own."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from tensionlab.allocation import Nearest
from tensionlab.errors import EffectError, ScenarioError
from tensionlab.files.reading import read_toml
from tensionlab.haptics.effects.described import effect_of, read
from tensionlab.haptics.effects.parameters import require_dimension
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.scenarios.brake_target import Hold
from tensionlab.scenarios.person import PersonPlan
from tensionlab.scenarios.scenario import Phase, Scenario

FOLDER = Path(__file__).parent / "files"
"""Where those of this package are: NAME.toml, and NAME.rig.toml beside it."""
SCENARIOS = ("materials", "collision", "recoil", "weight", "bow")
"""Their names, in the order of the publication."""
KEYS = {
    "title": str,
    "about": str,
    "seconds": float,
    "rate": float,
    "nearest": Nearest,
    "seen_from": str,
    "slew": float,
    "labels": dict[str, str],
    "stands": tuple[float, ...],
    "up": str,
}
NEEDED = ("title", "about", "seconds", "up")


def load_scenario(name: str | PathLike[str], rig: str | PathLike[str] | None = None) -> Scenario:
    """Which scenario has this name, or is in this file?

    Parameters
    ----------
    name : str or path
        One of `SCENARIOS`, or a file (``.toml``).
    rig : path, optional
        A rig file in place of the scenario's own, which is NAME.rig.toml beside NAME.toml.

    Raises
    ------
    ScenarioError
        Naming the file and the key: what is wrong and what to do.
    RigError
        If the rig's file is.
    """
    path = Path(name)
    if path.suffix != ".toml":
        if str(name) not in SCENARIOS:
            raise ScenarioError(f'no scenario "{name}"; there are {", ".join(SCENARIOS)}, or give a file (.toml)')
        path = FOLDER / f"{name}.toml"
    table = read_toml(path, "a scenario file (*.toml)", ScenarioError)
    try:
        return _scenario(table, path, rig)
    except (ScenarioError, EffectError) as error:
        raise ScenarioError(f"{path}: {error}") from None


def _scenario(table: dict[str, Any], path: Path, rig: str | PathLike[str] | None) -> Scenario:
    unknown = set(table) - set(KEYS) - {"person", "phases"}
    if unknown:
        raise ScenarioError(f'no key "{min(unknown)}"; there are {", ".join((*KEYS, "person", "phases"))}')
    for key in (*NEEDED, "person", "phases"):
        if key not in table:
            raise ScenarioError(f'key "{key}" is missing')
    loaded = load_rig(path.with_suffix(".rig.toml") if rig is None else rig)
    if not isinstance(table["phases"], list):
        raise ScenarioError("phases: give a list of tables, [[phases]]")
    return Scenario(
        name=path.stem,
        rig=loaded,
        person=read("person", PersonPlan, table["person"]),
        phases=tuple(_phase(each, loaded) for each in table["phases"]),
        **{key: read(key, kind, table[key]) for key, kind in KEYS.items() if key in table},
    )


def _phase(table: Any, rig: Rig) -> Phase:
    """Return a phase, whose effects have a kind and parameters as over the bridge."""
    if not isinstance(table, Mapping) or not isinstance(table.get("effects", {}), Mapping):
        raise ScenarioError("phases: each is a table, and its effects are tables too")
    name = table.get("name", "?")
    effects = {each: effect_of(each, given, rig) for each, given in table.get("effects", {}).items()}
    hold = None
    if "hold" in table:
        where = f'phase "{name}": hold'
        hold = read(where, Hold, table["hold"])
        require_dimension(hold, rig.dimension, where)
    rest = {key: value for key, value in table.items() if key not in ("effects", "hold")}
    if unknown := set(rest) - {"name", "begin", "end"}:
        raise ScenarioError(f'phase "{name}": no key "{min(unknown)}"; there are name, begin, end, effects, hold')
    given = {key: read(f'phase "{name}": {key}', kind, rest.get(key)) for key, kind in PHASE.items()}
    return Phase(**given, effects=effects, hold=hold)


PHASE = {"name": str, "begin": float, "end": float}
