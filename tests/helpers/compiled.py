"""Programs of `tests/data`, compiled with the firmware's headers."""

import shutil
import subprocess
from pathlib import Path

import pytest

from firmware.dangers import OPTIONS as STRICT
from firmware.emulation.processors import missing

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "firmware"


def compile_program(name: str, folder: Path, *sources: Path, options: tuple[str, ...] = STRICT) -> Path:
    """Compile a program of `tests/data` with these sources of the firmware, and return it."""
    compiler = shutil.which("c++")
    assert compiler is not None, "no C++ compiler 'c++' was found; the package itself needs one to build"
    includes = [f"-I{FIRMWARE}", f"-I{FIRMWARE / 'esp32'}", "-isystem", str(FIRMWARE / "stubs")]
    files = [str(ROOT / "tests" / "data" / f"{name}.cpp"), *map(str, sources)]
    subprocess.run([compiler, *options, *includes, *files, "-o", str(folder / name)], check=True)
    return folder / name


def run_program(program: Path, *words: object, content: str | None = None) -> list[list[str]]:
    """Run a program, and return the words of each line that it prints."""
    command = [str(program), *map(str, words)]
    done = subprocess.run(command, input=content, check=True, capture_output=True, text=True, timeout=120)
    return [line.split() for line in done.stdout.splitlines()]


def skip_without(*processors: str) -> None:
    """Skip a test, or the rest of it, where the tools of an emulated processor are not installed."""
    if lacking := [tool for processor in processors for tool in missing(processor)]:
        pytest.skip(f"not installed: {', '.join(lacking)}; firmware/emulate.py says which packages have them")
