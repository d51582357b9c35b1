"""Kinds of file that the program reads: the content of a good one, its encoding, and its reader."""

from __future__ import annotations

import json
import random
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tensionlab.errors import HardwareError
from tensionlab.hardware.calibration.lengths import load_lengths
from tensionlab.hardware.client.links import load_modules
from tensionlab.hardware.client.parameter_file import parse
from tensionlab.hardware.log.mcap_file import McapWriter
from tensionlab.hardware.log.reader import flat_columns, read_run, report, summarise
from tensionlab.hardware.runner.cycle_table import COLUMNS, TYPES, labels
from tensionlab.hardware.runner.program import load_program
from tensionlab.interop.caspr import load_caspr
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model import directions
from tensionlab.model.files import load_rig, rig_from_toml, rig_to_toml
from tensionlab.model.layouts import ring_plus_top
from tensionlab.scenarios.scenario import FOLDER, load_scenario
from tensionlab.support.files.reading import read_text
from tensionlab.validation.data_tables import FORCES, read_published, read_recording, read_vectors
from tensionlab.validation.protocol import Journal
from tensionlab.validation.rig_check import check_rig
from tensionlab.validation.sensors import follow_file
from tensionlab.workspace.layout.task import load_task
from tensionlab.workspace.poses import box, read_poses
from tensionlab.workspace.sweep import sweep
from tests.stress.file_encodings import csv, parquet, toml, xml
from tests.stress.file_mutations import Raw, spoil, spoil_bytes

Files = bytes | dict[str, bytes]  # content of a file; or of each file in a folder, by name
STRUCTURE = 0.7  # share of the cases in which the content of a file is mutated; in the others its bytes are
_SCRATCH = tempfile.TemporaryDirectory()  # for documents that are made by writing a file
RIG = ring_plus_top(1.0)
BRAKED = replace(RIG, modules=tuple(replace(module, brake=186.0) for module in RIG.modules))


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes
    ----------
    document : callable
        Returns the content of a good one: tables, lists and values.
    encode : callable
        Writes a file of a document, whatever it holds.
    read : callable
        Reads and uses a file as the program does.
    """

    suffix: str
    document: Callable[[], Any]
    encode: Callable[[Any], Files]
    read: Callable[[Path], object]

    def case(self, rng: random.Random) -> Files:
        """Return a damaged file."""
        if rng.random() < STRUCTURE:
            return self.encode(spoil(self.document(), rng))
        content = self.encode(self.document())
        if isinstance(content, bytes):
            return spoil_bytes(content, rng)
        name = rng.choice(list(content))
        return {**content, name: spoil_bytes(content[name], rng)}


def _both(document: Any) -> Files:
    parts = document if isinstance(document, dict) else {}
    return {f"{name}.xml".replace("/", "_").replace("\x00", "_"): xml(part) for name, part in parts.items()}


def _bodies() -> dict[str, Any]:
    joint = ["joint", {"type": "T_XYZ", "q_initial": "0 0 1"}, ""]
    inertia = [
        "inertia",
        {"ref": "com"},
        [[f"I{name}", {}, "0.1"] for name in ("xx", "yy", "zz", "xy", "xz", "yz")],
    ]
    physical = ["physical", {}, [["mass", {}, "1.0"], ["com_location", {}, "0 0 0"], inertia]]
    parent = ["parent", {}, [["num", {}, "0"], ["location", {}, "0 0 0"]]]
    link = ["link_rigid", {"num": "1", "name": "point"}, [joint, physical, parent]]

    def cable(name: str, x: str) -> list[Any]:
        ends = [
            ["attachment", {}, [["link", {}, str(end)], ["location", {}, place]]]
            for end, place in enumerate((x, "0 0 0"))
        ]
        properties = ["properties", {}, [["force_min", {}, "0.5"], ["force_max", {}, "6"]]]
        inside = [properties, ["attachments", {}, ends]]
        return ["cable_ideal", {"name": name, "attachment_reference": "joint"}, inside]

    cables = ["cable_set", {"id": "one"}, [cable("a", "1 0 2"), cable("b", "-1 0 2"), cable("c", "0 1 2")]]
    return {
        "bodies": ["bodies_system", {}, [["links", {}, [link]]]],
        "cables": ["cables", {"default_cable_set": "one"}, [cables]],
    }


def _read_caspr(place: Path) -> object:
    return rig_from_toml(rig_to_toml(load_caspr(place / "bodies.xml", place / "cables.xml")), "imported")


def _read_rig(place: Path) -> object:
    rig = load_rig(place)
    rig_from_toml(rig_to_toml(rig), "copy")
    rig_to_mjcf(rig)
    return check_rig(rig) if rig.m <= 16 else rig.cables(rig.home, frames=rig.at_rest)


def _space() -> dict[str, Any]:
    return {
        "name": "desk",
        "counts": [2, 3],
        "limits": {"lower": 0.5, "upper": 6.0},
        "room": {"size": [4.0, 2.5, 4.0], "faces": ["floor", "ceiling"]},
        "surfaces": [{"name": "belt", "corner": [0, 0, 0], "edges": [[0.3, 0, 0], [0, 0.1, 0]], "frame": "hip"}],
        "modules": [{"name": "desk left", "anchor": [0.6, 0.75, 0.9]}],
        "frames": [{"name": "hip", "position": [-0.1, 0.6, 0.05], "rotation": [0.0, 0.2, 0.0]}],
        "target": {"x": [-0.3, 0.0], "y": [0.8, 1.0], "z": [0.4, 0.6], "step": 0.1},
        "objective": {"force": 0.5},
        "search": {"seed": 0, "generations": 1, "starts": 1},
    }


def _read_space(place: Path) -> object:
    task = load_task(place)
    return task.space.placed, [each.arrays() for each in task.target]


@cache
def _scenario() -> dict[str, Any]:
    return tomllib.loads((FOLDER / "bow.toml").read_text(encoding="utf-8"))


def _read_scenario(place: Path) -> object:
    scenario = load_scenario(place, FOLDER / "bow.rig.toml")
    return scenario.active_phases(1.0), scenario.person.script.position(1.0)


def _program() -> dict[str, Any]:
    step = {"seconds": 0.5, "wrench": [0.0, 0.0, 1.5], "ramp": True, "brakes": ["top"]}
    return {"name": "push", "repeat": False, "steps": [step, {"seconds": 2.0, "wrench": [0.0, 0.0, 1.5]}]}


def _read_parameters(place: Path) -> object:
    return parse(read_text(place, "a file of parameters (*.toml)", HardwareError), str(place))


def _published() -> dict[str, Any]:
    return {"source": "an author", "values": {"vectors": {"value": 182, "unit": "", "meaning": "directions"}}}


def _read_poses(place: Path) -> object:
    poses = read_poses(place)
    return poses.arrays(), poses.labels()


def _read_forces(place: Path) -> object:
    with closing(follow_file(place)) as sensor:
        return sensor.take()


def _recording() -> dict[str, Any]:
    modules = ["a", "b"]
    columns: dict[str, Any] = {f"{name}.F{axis}": [0.5, 1.0] for name in FORCES for axis in "xyz"}
    columns |= {f"tensions.{name}": [1.0, 2.0] for name in modules}
    columns |= {"spread": [0.1, 0.2], "status": ["EXACT", "NEAREST"], "fallback_used": [True, False]}
    columns |= {"samples": [10, 20], "limited_modules": ["", "a"]}
    about = {
        "simulated": True,
        "rig": "r",
        "modules": modules,
        "solver": "newton",
        "sensor": "sim:",
        "alignment": "paper",
        "rotations": {"paper": np.eye(3).tolist()},
        "rate": 1000.0,
        "hold": 1.0,
    }
    return {"columns": columns, "manifest": {"call": "x", "recording": about}}


def _read_recording(place: Path) -> object:
    found = read_recording(place)
    return found.error, found.title, found.simulated


def _vectors() -> dict[str, Any]:
    return {"columns": {"vector": [0, 1], "x": [0.0, 1.0], "y": [1.0, 0.0], "z": [0.0, 0.0]}, "manifest": {}}


def _journal() -> list[Any]:
    force = {
        "number": 0,
        "desired": [0.0, 1.0, 0.0],
        "rendered": [0.0, 1.0, 0.0],
        "measured": [0.0, 1.0, 0.0],
        "tensions": [1.0, 2.0],
        "status": "EXACT",
        "fallback_used": False,
        "samples": 10,
        "spread": 0.1,
        "rested": 0.0,
        "limited_modules": [],
    }
    return [{"format": "tensionlab validation 2", "rig": "r"}, force, {**force, "number": 1}]


def _json_lines(document: Any) -> bytes:
    rows = document if isinstance(document, list) else [document]
    return "".join(f"{row if isinstance(row, Raw) else json.dumps(row)}\n" for row in rows).encode(
        errors="replace"
    )


@cache
def _log() -> dict[str, Any]:
    length = {dim: len(names) for dim, names in labels(RIG).items()}
    cycle: dict[str, Any] = {}
    for name, column in COLUMNS.items():
        values = np.zeros([length[dim] for dim in column.dims], TYPES[name]).ravel().tolist()
        cycle[name] = values if column.dims else values[0]
    links = {module.name: "sim:" for module in RIG.modules}
    setup = {
        "solver": "newton",
        "parameters": {},
        "policy": "direction",
        "rate": 50.0,
        "ttl": 0.25,
        "on_loss": "stop",
        "lower": [0.5] * RIG.m,
        "upper": [6.0] * RIG.m,
        "links": links,
    }
    event = {"cycle": 0, "time": 0.0, "kind": "armed", "text": "all", "module": ""}
    return {
        "rig": tomllib.loads(rig_to_toml(RIG)),
        "manifest": {"call": "x"},
        "setup": setup,
        "modules": {name: {"protocol": 1} for name in links},
        "summary": {"ended": "x"},
        "events": [event],
        "cycles": [cycle, {**cycle, "cycle": 1, "time": 0.02}],
    }


def _mcap(document: Any) -> bytes:
    """Write a log whose checksums are right."""
    given = document if isinstance(document, Mapping) else {}
    path = Path(_SCRATCH.name) / "written.mcap"
    path.unlink(missing_ok=True)
    writer = McapWriter(path, {"cycle": {"title": "c"}, "event": {"title": "e"}})
    writer.attachment("rig.toml", "application/toml", toml(given.get("rig")))
    for name in ("manifest", "setup", "modules", "summary"):
        values = given.get(name)
        writer.metadata(name, values if isinstance(values, dict) else {"x": values})
    for topic in ("event", "cycle"):
        messages = given.get(f"{topic}s")
        for each in messages if isinstance(messages, list) else [messages]:
            text = each if isinstance(each, Raw) else json.dumps(each)
            writer.message(topic, 10**18, 10**18, text.encode("utf-8", "replace"))
    writer.finish()
    return path.read_bytes()


def _read_log(place: Path) -> object:
    run = read_run(place)
    return summarise(run), report(run), flat_columns(run), run.allocation


def _sweep(place: Path) -> object:
    return sweep(RIG, box((-0.1, 0.1), 0.3, 0.0, step=0.1), "wrench-closure", out=place, chunk=2)


@cache
def _store() -> dict[str, bytes]:
    """Return the files of a finished store."""
    place = Path(_SCRATCH.name) / "good.zarr"
    _sweep(place)
    return {path.relative_to(place).as_posix(): path.read_bytes() for path in place.rglob("*") if path.is_file()}


def _store_files(document: Any) -> Files:
    return {
        name.replace("\x00", "_"): each if isinstance(each, bytes) else str(each).encode("utf-8", "replace")
        for name, each in document.items()
    }


def write(content: Files, place: Path) -> Path:
    """Write a file, or a folder of files."""
    if isinstance(content, bytes):
        place.write_bytes(content)
        return place
    for old in sorted(place.rglob("*"), reverse=True):
        old.rmdir() if old.is_dir() else old.unlink()
    for name, inner in content.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(inner)
    return place


RIG_TABLE = tomllib.loads(rig_to_toml(RIG))
LINKS = {"modules": {"floor-1": "socket://127.0.0.1:1", "floor-2": "/dev/rfcomm0"}}
PARAMETERS = {"module": {"serial_number": 1}, "parameters": {"tension_lower": 0.5, "slew": 60.0, "ttl": 250.0}}
DIRECTIONS = [["x", "y", "z"], [1, 0, 0], [0, 1, 0]]
POSES = [["x", "y", "z", "rx", "ry", "rz"], [0.0, 0.0, 1.0, 0.0, 0.0, 0.1], [0.1, 0.0, 1.0, 0.0, 0.0, 0.2]]
LENGTHS = [[*(module.name for module in RIG.modules), "x", "y", "z"], [0.6, 0.7, 0.7, 2.0, 0.0, 0.3, 0.0]]
SENSOR_FORCES = [["Fx", "Fy", "Fz"], [1.0, 0.0, 0.5], [1.0, 0.0, 0.5]]
POSE_TABLE = {"columns": {"x": [0.0, 0.1], "y": [0.0, 0.0], "z": [1.0, 1.0]}, "manifest": {"call": "x"}}
KINDS = {
    "rig": Kind(".toml", lambda: RIG_TABLE, toml, _read_rig),
    "space": Kind(".toml", _space, toml, _read_space),
    "scenario": Kind(".toml", _scenario, toml, _read_scenario),
    "program": Kind(".toml", _program, toml, lambda place: load_program(place, BRAKED).seconds),
    "modules": Kind(".toml", lambda: LINKS, toml, load_modules),
    "parameters": Kind(".toml", lambda: PARAMETERS, toml, _read_parameters),
    "published values": Kind(".toml", _published, toml, read_published),
    "directions": Kind(
        ".csv", lambda: DIRECTIONS, csv, lambda place: directions.forces(directions.read_csv(place), 3, 3)
    ),
    "poses, CSV": Kind(".csv", lambda: POSES, csv, _read_poses),
    "lengths": Kind(".csv", lambda: LENGTHS, csv, lambda place: load_lengths(place, RIG)),
    "forces": Kind(".csv", lambda: SENSOR_FORCES, csv, _read_forces),
    "poses, Parquet": Kind(".parquet", lambda: POSE_TABLE, parquet, _read_poses),
    "recording": Kind(".parquet", _recording, parquet, _read_recording),
    "vectors": Kind(".parquet", _vectors, parquet, read_vectors),
    "CASPR": Kind("", _bodies, _both, _read_caspr),
    "journal": Kind(".jsonl", _journal, _json_lines, lambda place: Journal(place, {"rig": "r"}).measurements),
    "log": Kind(".mcap", _log, _mcap, _read_log),
    "store": Kind(".zarr", _store, _store_files, _sweep),
}
