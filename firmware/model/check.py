"""Check the model of the supervisor with SPIN: properties that hold, and built-in errors that are found.

Run it from the root of the repository: ``make model``, or ``python firmware/model/check.py``. It prints what was
explored for each property, and which property each error breaks. With ``--write`` the figures go to `model.json`,
from which ``make generated`` makes the table in README.md. It needs Debian's package `spin` and GCC.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))
from firmware.check import not_installed

MODEL = Path(__file__).with_name("supervisor.pml")
FIGURES = Path(__file__).with_name("model.json")
TOOLS = ("spin", "gcc")
MAX_DEPTH = 200_000  # of a search, in steps
MAX_MEMORY_MB = 1000
# What happens in a search: the host's frames, or faults, settings and the brake; both at once are too many states.
ENVIRONMENTS = {"links": "SERVICE=0", "service": "LINKS=0"}
PROPERTIES = {
    "limits": "Never above `tension_upper`; no tension after a fault or an emergency stop",
    "sound": "Never armed without calibration, or with a fault",
    "released": "Released within the time to live of the last valid set-point, whatever is lost; "
    "2 s later slack, and the brake off",
    "in_order": "Follows no set-point that is late, repeated, or of another session",
    "stop_wins": "After STOP, ESTOP, a fault, or the end of the link, nothing arms that was sent before",
    "estop_lasts": "An emergency stop lasts until CLEAR",
    "confirmation": "Once a host's stop is confirmed, its session pulls no more",
}
ALL = "all"  # of them at once
# Each error that can be built in: where it shows, and the property that it breaks.
ERRORS = {
    "NEVER_EXPIRES": ("links", "released"),
    "LATE_ONES_RENEW": ("links", "released"),
    "REPEATED_ARM_RENEWS": ("links", "released"),
    "BRAKE_STAYS_ON": ("service", "released"),
    "EIGHT_BITS": ("links", "in_order"),
    "ANY_SESSION": ("links", "in_order"),
    "FORGETS_CLOSED_LINKS": ("links", "stop_wins"),
    "CLOSED_LINK_GOES_ON": ("links", "stop_wins"),
    "RESUMES": ("links", "stop_wins"),
    "STOP_LEAVES_ESTOP": ("links", "estop_lasts"),
    "IGNORES_STOPS": ("links", "confirmation"),
    "ARMS_UNCALIBRATED": ("service", "sound"),
    "ARMS_WITH_A_FAULT": ("service", "sound"),
    "NO_CLAMP": ("service", "limits"),
    "SETTINGS_WHILE_PULLING": ("service", "limits"),
}


class Search(NamedTuple):
    """Result of a search for a violation of a property; it ends at the first one."""

    holds: bool
    states: int
    transitions: int
    depth: int
    memory_mb: int
    seconds: float


class Event(NamedTuple):
    """Event of a random run, with its details, and what is true of the module after it.

    The details are: of `ticks` 1 if a fault begins, 2 if one ends; of frames the session (`arms`, `sets`), whether
    they come by the link in use, and number + 10 tension + 100 brake; of `limits_to` the tension.
    """

    name: str
    details: tuple[int, int, int]
    code: str  # of the acknowledgement, or "ignored"
    state: str
    faulty: bool
    tension: int  # in half newtons
    brake: str
    last: int  # number of the last set-point
    session: int  # 1: the host's; 2: another


def run(folder: Path, *words: str) -> str:
    """Return what a command prints that runs in a folder."""
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True).stdout


def build(folder: Path, *defines: str) -> Path:
    """Compile the search of the model with some macros, and return the program."""
    run(folder, "spin", *(f"-D{macro}" for macro in defines), "-a", str(MODEL.resolve()))
    run(folder, "gcc", "-O1", "-w", "-DSAFETY", "-DNOFAIR", f"-DMEMLIM={MAX_MEMORY_MB}", "-o", "pan", "pan.c")
    return folder / "pan"


def search(program: Path, name: str) -> Search:
    """Look for a violation of a property in all states that can be reached."""
    begin = time.perf_counter()
    text = run(program.parent, str(program), f"-m{MAX_DEPTH}", "-N", name)

    def number(pattern: str) -> float:
        return float(re.findall(pattern, text)[0])

    holds = number(r"errors: (\d+)") == 0
    if holds and ("Search not completed" in text or "max search depth too small" in text):
        raise ValueError(f"{name}: the search was not completed\n{text}")
    return Search(
        holds,
        int(number(r"([\d.e+]+) states, stored")),
        int(number(r"([\d.e+]+) transitions")),
        int(number(r"depth reached (\d+)")),
        round(number(r"([\d.]+)\s+total actual memory usage")),
        time.perf_counter() - begin,
    )


def explore(environment: str, names: Iterable[str], error: str = "NONE") -> dict[str, Search]:
    """Look for violations of properties in an environment, with an error built in."""
    with tempfile.TemporaryDirectory() as folder:
        program = build(Path(folder), ENVIRONMENTS[environment], f"ERROR={error}")
        return {name: search(program, name) for name in names}


def random_run(seed: int, steps: int, error: str = "NONE") -> list[Event]:
    """Return the events of a random run of the model, in which everything happens."""
    words = ("spin", "-DRANDOM", f"-DERROR={error}", "-T", f"-n{seed}", f"-u{steps}", str(MODEL.resolve()))
    with tempfile.TemporaryDirectory() as folder:
        text = run(Path(folder), *words)
    events = []
    for line in re.findall(r"^ *EVENT (.*)$", text, re.MULTILINE):
        name, a, b, c, code, state, faulty, tension, brake, last, session = line.split()
        after = (code, state, faulty == "1", int(tension), brake, int(last), int(session))
        events.append(Event(name, (int(a), int(b), int(c)), *after))
    return events


def main() -> int:
    """Check all properties and errors; 1 if a property fails or an error is not found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"write the figures to {FIGURES.name}")
    options = parser.parse_args()
    if lacking := not_installed(TOOLS):
        print(f"left out, for want of {', '.join(lacking)}")
        return 0
    failed = False
    properties, errors = [], []
    print(f"{'property':13} {'with':8} {'states':>8} {'transitions':>12} {'depth':>7} {'MB':>5} {'s':>5}  result")
    for environment in ENVIRONMENTS:
        for name, found in explore(environment, PROPERTIES).items():
            failed |= not found.holds
            figures = found._asdict() | {"property": name, "environment": environment}
            properties.append({key: figure for key, figure in figures.items() if key != "seconds"})
            sizes = f"{found.states:8,} {found.transitions:12,} {found.depth:7,} {found.memory_mb:5}"
            print(f"{name:13} {environment:8} {sizes} {found.seconds:5.1f}  {'holds' if found.holds else 'FAILS'}")
    for error, (environment, name) in ERRORS.items():
        found = explore(environment, [name], error)[name]
        failed |= found.holds
        errors.append({"error": error, "property": name, "states": found.states})
        result = "NOT FOUND" if found.holds else f"breaks {name}, after {found.states:,} states"
        print(f"{error:22} {environment:8} {result}")
    if options.write and not failed:
        FIGURES.write_text(json.dumps({"properties": properties, "errors": errors}, indent=1) + "\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
