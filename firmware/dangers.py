"""Play each danger of `firmware/dangers` with many seeds, and print what the firmware makes of it.

Run it from the root of the repository: ``python firmware/dangers.py``. With ``--write`` the worst of all seeds
goes to `dangers.json`, from which ``make generated`` makes the table in README.md. A thousand seeds take a quarter
of an hour. ``python firmware/dangers.py --serve wire`` serves a module with that defect instead, for
``tensionlab module doctor``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

FIRMWARE = Path(__file__).parent
FIGURES = FIRMWARE / "dangers.json"
SEEDS = 1000
OPTIONS = ("-std=c++17", "-O2", "-pthread", "-Wall", "-Wextra", "-Wconversion", "-Werror")
INCLUDES = (f"-I{FIRMWARE}", f"-I{FIRMWARE / 'core'}", f"-I{FIRMWARE / 'esp32'}", f"-I{FIRMWARE / 'fakes'}")


@dataclass(frozen=True)
class Danger:
    """Result of one danger over some seeds.

    Attributes
    ----------
    danger, must_happen : str
        What is wrong or goes wrong, and what the module must do.
    right : int
        Number of seeds with which it did so, within the bounds of `firmware/dangers/rows.cpp`.
    noticed_s : float
        Longest time until the module reacted, in s; -1 where it cannot.
    tension_n : float
        Largest cable tension since the danger began, in N.
    faults : int
        Faults of which the module must name one, as bits.
    wrong : str
        The first seed that went wrong, and why; or empty.
    """

    danger: str
    must_happen: str
    right: int
    noticed_s: float
    tension_n: float
    faults: int
    wrong: str


def compile_sources(folder: Path, *sources: Path) -> list[Path]:
    """Compile sources of the firmware, and return their objects."""

    def compile_one(source: Path) -> Path:
        words = ["c++", "-c", *OPTIONS, *INCLUDES, "-isystem", FIRMWARE / "stubs", source]
        subprocess.run([str(word) for word in words], cwd=folder, check=True)
        return folder / source.with_suffix(".o").name

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(compile_one, sources))


def compile_firmware(folder: Path) -> list[Path]:
    """Compile the core, the ESP32's layer, the fakes and the dangers, and return their objects."""
    sources = [
        source
        for name in ("core", "esp32", "fakes", "dangers")
        for source in sorted((FIRMWARE / name).glob("*.cpp"))
    ]
    return compile_sources(folder, *sources)


def link(objects: list[Path], program: Path, main: str = "play") -> Path:
    """Link objects into a program, and return it: that of `main`, "play" or "served"."""
    used = [each for each in objects if each.stem not in {"play", "served"} - {main}]
    subprocess.run(["c++", "-pthread", *map(str, used), "-o", str(program)], check=True)
    return program


def play(program: Path, seeds: int, first: int = 0, row: int | None = None) -> list[Danger]:
    """Play all dangers, or one row of them, with some seeds."""
    words = [str(word) for word in (program, first, seeds, *([] if row is None else [row]))]
    output = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    dangers = []
    for line in output.splitlines():
        danger, must_happen, right, seconds, tension, faults, wrong = line.split("\t")
        measured = (int(right), float(seconds), float(tension), int(faults))
        dangers.append(Danger(danger, must_happen, *measured, wrong))
    return dangers


def serve(program: Path, defect: str) -> int:
    """Serve a module with a defect until Ctrl-C."""
    with subprocess.Popen([str(program), defect, "0"], stdout=subprocess.PIPE, text=True) as served:
        if served.stdout is not None and (port := served.stdout.readline()):
            print(f"socket://127.0.0.1:{port.strip()}", flush=True)
        try:
            return served.wait()
        except KeyboardInterrupt:
            served.kill()
            return 0


def main() -> int:
    """Play all dangers; 1 if one went wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"of each danger (default: {SEEDS})")
    parser.add_argument("--jobs", type=int, default=2, help="dangers at a time (default: 2)")
    parser.add_argument("--write", action="store_true", help=f"write the worst to {FIGURES.name}")
    parser.add_argument("--serve", metavar="DEFECT", help='serve a module with a defect ("none": without)')
    options = parser.parse_args()
    if shutil.which("c++") is None:
        print("no C++ compiler 'c++' was found")
        return 1
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(options.jobs) as pool:
        objects = compile_firmware(Path(name))
        if options.serve is not None:
            return serve(link(objects, Path(name) / "served", "served"), options.serve)
        program = link(objects, Path(name) / "dangers")
        rows = range(len(play(program, 0)))
        dangers = []
        for (danger,) in pool.map(lambda row: play(program, options.seeds, row=row), rows):
            dangers.append(danger)
            worst = f"{danger.noticed_s:.4f} s, {danger.tension_n:.2f} N"
            print(f"{danger.danger}: {danger.right} of {options.seeds}, {danger.wrong or worst}", flush=True)
    if any(danger.right < options.seeds for danger in dangers):
        return 1
    if options.write:
        FIGURES.write_text(
            json.dumps({"seeds": options.seeds, "dangers": [asdict(d) for d in dangers]}, indent=1) + "\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
