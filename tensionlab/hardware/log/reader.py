"""Runs read from their logs, as arrays, as an `xarray.Dataset` and as plain columns."""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from itertools import product
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, Status
from tensionlab.demand import EffectTable
from tensionlab.errors import LogError
from tensionlab.hardware.log.mcap_file import read_records
from tensionlab.hardware.log.writer import RunSetup
from tensionlab.hardware.protocol.codes import Fault, Limit
from tensionlab.hardware.runner import cycle_table
from tensionlab.hardware.runner.cycle_table import COLUMNS, EFFECT_NUMBERS, CycleTable, labels
from tensionlab.hardware.runner.records import PERCENTILES, RunEvent, Statistics, percentiles
from tensionlab.model.files import rig_from_toml, rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.support import provenance
from tensionlab.support.files import writing
from tensionlab.support.files.reading import as_path, parse_json
from tensionlab.support.formatting import format_duration, format_number
from tensionlab.support.table import Column, Table
from tensionlab.support.validation import validate

if TYPE_CHECKING:
    import pandas
    import xarray


BLOCK_CYCLES = 1000  # number of cycles decoded at a time: as text and lists they take many times the memory
MAX_EVENTS = 12  # number of events shown below a table; JSON has all
EXTREMES = ("min", "mean", "max")  # columns of a module's commanded tensions
BROKEN = (KeyError, TypeError, ValueError, OverflowError, RecursionError)  # errors of decoding what is no cycle


@dataclass(frozen=True)
class LogMetadata:
    """Metadata of a log, by their names."""

    manifest: dict[str, Any]
    setup: RunSetup
    modules: dict[str, dict[str, Any]] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(CycleTable, LogMetadata):
    """Run read from its log: arrays over its K cycles, as in `CycleTable`, and the rest of the log.

    Attributes
    ----------
    rig, setup : Rig, RunSetup
    manifest : dict
        Origin of the run: `tensionlab.support.provenance.manifest`.
    modules : dict of str to dict
        Fields of `protocol.Info` by the name of the module.
    summary : dict
        `Statistics.summary` at the end; empty in a log that was cut off.
    events : tuple of RunEvent
    effects : dict of str to EffectTable
        What each effect desired, and the share of its parameters that was rendered.
    began : float
        Seconds since 1970 at the run's time 0, by the host's clock; NaN if there is no cycle.
    complete : bool
        Whether the log was closed. If not, the last cycles may be missing.
    """

    rig: Rig
    events: tuple[RunEvent, ...]
    began: float
    complete: bool
    effects: dict[str, EffectTable] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.cycle)

    @property
    def allocation(self) -> Allocation:
        """Allocations of all cycles, without the reasons of failed backends."""
        names = ("residual", "status", "scale", "iterations", "separation")
        return Allocation(self.chosen, self.rendered, **{name: getattr(self, name) for name in names})

    def __repr__(self) -> str:
        return f"<Run of {self.rig.name} by {self.setup.solver}: {len(self)} cycles at {self.setup.rate:g} Hz>"

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in report(self))

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each cycle, with the columns of `flat_columns`, such as ``chosen.floor-1``."""
        return provenance.data_frame(flat_columns(self)).set_index("cycle")

    def to_xarray(self) -> xarray.Dataset:
        """Return the run as a dataset with names, units and labels.

        Every column is a variable with the dimension ``cycle`` and its own, and has ``units`` and a ``long_name``.
        The attributes have the rest of the log: ``rig`` in TOML; ``manifest``, ``setup``, ``modules``, ``summary``
        and ``events`` in JSON; ``began``, in s since 1970; ``complete``, 1 or 0.
        """
        variables: dict[str, Any] = {
            name: (("cycle", *dims), getattr(self, name), {"units": unit, "long_name": meaning})
            for name, (_, unit, meaning, dims) in COLUMNS.items()
        }
        for name in ("lower", "upper"):
            described = {"units": "N", "long_name": f"{name} limit of the tension that the solver may choose"}
            variables[name] = ("module", np.array(getattr(self.setup, name)), described)
        documents = {name: getattr(self, name) for name in ("manifest", "modules", "summary")}
        documents |= {"setup": asdict(self.setup), "events": [asdict(event) for event in self.events]}
        if self.effects:
            every = [*self.effects.values()]
            forces = (("cycle", "effect", "axis"), np.stack([effect.force for effect in every], axis=1))
            variables["effect_force"] = (*forces, {"units": "N", "long_name": "force that an effect desires"})
            for name in EFFECT_NUMBERS:
                numbers = np.stack([getattr(effect, name) for effect in every], axis=1)
                variables[f"effect_{name}"] = (("cycle", "effect"), numbers, {"long_name": f"{name} of an effect"})
        attributes = {
            "title": f"tensionlab run: {self.rig.name}, {self.setup.solver}",
            "rig": rig_to_toml(self.rig),
            **{name: json.dumps(document) for name, document in documents.items()},
            "began": self.began,
            "complete": int(self.complete),
        }
        dataset: xarray.Dataset = provenance.import_xarray().Dataset(
            variables, labels(self.rig) | ({"effect": [*self.effects]} if self.effects else {}), attributes
        )
        return dataset.set_coords(["cycle", "time", "lower", "upper"])


def read_run(path: str | PathLike[str], progress: Callable[[float], None] | None = None) -> Run:
    """Return the run in the log at ``path``; a log that was cut off is read as far as it goes.

    `progress` is called with the share of the work that is done, from 0 to 1. A `LogError` if the file can't be
    read, is no log of a run, or was cut off before the run began.
    """
    path = as_path(path)
    documents: dict[str, Any] = {}
    events: list[RunEvent] = []
    rows: list[bytes] = []
    effect_rows: list[bytes] = []
    blocks: list[dict[str, NDArray[Any]]] = []
    rig: Rig | None = None
    first_ns: int | None = None
    complete = False

    def decode_rows() -> None:
        assert rig is not None
        try:
            blocks.append(cycle_table.decode(rows, rig))
        except BROKEN as error:
            broken = f"a cycle in it is none of this rig ({type(error).__name__}); it is damaged"
            raise LogError(f"{path}: {broken}") from None
        rows.clear()

    for kind, name, content, time_ns in read_records(path, progress):
        if kind == "attachment":
            rig = rig_from_toml(content.decode(errors="replace"), f"{path}: rig.toml")
        elif kind == "metadata":
            documents[name] = content
        elif kind == "end":
            complete = True
        elif name == "event":
            here = f"{path}: event {len(events) + 1}"
            events.append(validate(RunEvent, parse_json(content, here, LogError), LogError, here))
        elif name == "effects":
            effect_rows.append(content)
        elif name == "cycle" and rig is not None:
            first_ns = time_ns if first_ns is None else first_ns
            rows.append(content)
            if len(rows) == BLOCK_CYCLES:
                decode_rows()
    if rig is None or not {"manifest", "setup"} <= documents.keys():
        raise LogError(f"{path}: the log was cut off before the run began; there is nothing in it")
    metadata = validate(LogMetadata, documents, LogError, path)
    if not len(metadata.setup.lower) == len(metadata.setup.upper) == rig.m:
        raise LogError(f"{path}: setup has {len(metadata.setup.lower)} tension limits for {rig.m} modules")
    decode_rows()
    table: dict[str, Any] = {name: np.concatenate([block[name] for block in blocks]) for name in COLUMNS}
    try:
        effects = cycle_table.decode_effects(effect_rows, table["cycle"], rig.dimension)
    except BROKEN as error:
        raise LogError(f"{path}: an effect in it is none ({type(error).__name__}); it is damaged") from None
    began = np.nan if first_ns is None else 1e-9 * first_ns - float(table["time"][0])
    about: dict[str, Any] = {**table, **vars(metadata)}
    return Run(**about, rig=rig, events=tuple(events), effects=effects, began=began, complete=complete)


def flat_columns(run: Run) -> dict[str, NDArray[Any]]:
    """Return a run as columns of one number per cycle: ``chosen.floor-1``, ``structure.Fx.floor-1``, ..."""
    names = labels(run.rig)
    columns: dict[str, NDArray[Any]] = {}
    for name, column in COLUMNS.items():
        entries = list(product(*(names[dim] for dim in column.dims)))
        values = getattr(run, name).reshape(len(run), len(entries)).T
        columns |= {".".join((name, *entry)): value for entry, value in zip(entries, values, strict=True)}
    for name, effect in run.effects.items():
        columns |= {
            f"effect.{name}.F{axis}": force for axis, force in zip(names["axis"], effect.force.T, strict=True)
        }
        columns |= {f"effect.{name}.{number}": getattr(effect, number) for number in EFFECT_NUMBERS}
    return columns


def write_netcdf(run: Run, path: str | PathLike[str]) -> None:
    """Write the dataset of a run to a NetCDF file of version 3: integers have 32 bits, truth values are bytes."""
    dataset = run.to_xarray()
    empty = [dim for dim, size in dataset.sizes.items() if size == 0 and dim != "cycle"]  # such as no frames
    writing.write_bytes(path, bytes(dataset.drop_dims(empty).to_netcdf(engine="scipy")))


def recount(run: Run) -> Statistics:
    """Return the statistics of a run by its cycles, whether or not the runner wrote its own."""
    deadlines = np.round((run.time - run.start_delay) * run.setup.rate)
    changed = np.isfinite(run.commanded) & (abs(run.commanded - run.chosen) > 0.0)
    return Statistics(
        cycles=len(run),
        missed=int(deadlines[-1] - deadlines[0]) + 1 - len(run) if len(run) else 0,
        fallback_used=int(run.fallback_used.sum()),
        slew_limited=int(changed.any(axis=1).sum()),
        statuses=Counter(Status(number) for number in run.status.tolist()),
        ended=str(run.summary.get("ended", "")),
        start_delays=deque(run.start_delay.tolist()),
        compute_times=deque(run.compute_time.tolist()),
    )


def describe_modules(run: Run) -> list[dict[str, Any]]:
    """Return name, link, commanded tensions, limiters, faults and ages of telemetry of each module.

    Limiters are shares of the cycles; `lost_at_s` is the time from which the module did not take part.
    """
    names = {int(limit): limit.name for limit in Limit}
    rows = []
    for index, module in enumerate(run.rig.modules):
        commanded = run.commanded[:, index][np.isfinite(run.commanded[:, index])]
        tensions = [commanded.min(), commanded.mean(), commanded.max()] if commanded.size else [np.nan] * 3
        row: dict[str, Any] = {"name": module.name, "link": run.setup.links.get(module.name, "")}
        row |= {f"commanded_{word}_n": float(tension) for word, tension in zip(EXTREMES, tensions, strict=True)}
        counts = Counter(run.limiters[:, index].tolist())
        row["limiters"] = {
            names.get(number, f"limiter {number}"): counts[number] / len(run)
            for number in sorted(counts.keys() - {int(Limit.NONE)})
        }
        row["faults"] = [str(fault.name) for fault in Fault if (run.faults[:, index] & fault).any()]
        row["telemetry_age_s"] = dict(zip(PERCENTILES, percentiles(run.ages[:, index]), strict=True))
        lost = run.time[~run.active[:, index]]
        row["lost_at_s"] = float(lost[0]) if lost.size else None
        rows.append(row)
    return rows


def summarise(run: Run) -> dict[str, Any]:
    """Return how a run went, as far as its log goes, as plain numbers and texts."""
    statistics = recount(run)
    return {
        "rig": run.rig.name,
        "solver": run.setup.solver,
        "policy": run.setup.policy,
        "rate_hz": run.setup.rate,
        "duration_s": float(np.ptp(run.time)) if len(run) else 0.0,
        **statistics.counts(),
        "ended": statistics.ended,
        "complete": run.complete,
        "modules": describe_modules(run),
        "events": [asdict(event) for event in run.events],
    }


def report(run: Run) -> tuple[Table, Table]:
    """Return how a run went as a table of the whole and a table of its modules, with its events as notes."""
    summary, statistics = summarise(run), recount(run)
    end = ("finished", statistics.ended or "the log does not say why")
    if not run.complete:
        end = ("cut off", "the log was never closed, so its last moments may be missing")
    cycles = f"{len(run)} in {summary['duration_s']:.2f} s, {run.setup.rate:g} Hz desired"
    policy = f", nearest in {run.setup.policy}" if run.setup.policy else ""
    title = f"{run.rig.name}, {run.setup.solver}{policy}"
    rows = []
    for module in summary["modules"]:
        limits = [
            f"{name.lower()} {f'{100 * share:.0f} %' if share >= 0.005 else '<1 %'}"
            for name, share in module["limiters"].items()
        ]
        limits += [f"fault {name}" for name in module["faults"]]
        limits += [] if module["lost_at_s"] is None else [f"lost at {module['lost_at_s']:.3f} s"]
        tensions = [module[f"commanded_{word}_n"] for word in EXTREMES]
        rows.append([module["name"], *tensions, *module["telemetry_age_s"].values(), ", ".join(limits)])
    columns = ["module", *(Column(f"tension {word}", "N", format_number) for word in EXTREMES)]
    columns += [*(Column(f"age {word}", format=format_duration) for word in PERCENTILES), "limited by"]
    notes = [
        f"{event.time:.3f} s  {event.kind}: {f'{event.module}: ' * bool(event.module)}{event.text}"
        for event in run.events[:MAX_EVENTS]
    ]
    if len(run.events) > MAX_EVENTS:
        notes.append(f"and {len(run.events) - MAX_EVENTS} more events; --json has all")
    whole = Table(["", ""], [("cycles", cycles), *statistics.rows(), end], title)
    return whole, Table(columns, rows, notes=notes)
