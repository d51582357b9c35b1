"""Checks of the firmware's core: sizes, forbidden symbols, code for the ESP32, sanitizers, fuzzing.

Run it from the root of the repository: ``make firmware-check``, or ``python firmware/check.py``. A check
whose tool is missing is left out with a message. The sizes in `figures.json` are a budget: more than `MARGIN`
beyond them is an error, until ``python firmware/check.py arm esp32 --write`` replaces them.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

FIRMWARE = Path(__file__).parent
CORE = sorted((FIRMWARE / "core").glob("*.cpp"))
FUZZ = FIRMWARE / "fuzz"
FIGURES = FIRMWARE / "figures.json"
MOST_TEXT, MOST_BSS = 16 * 1024, 2 * 1024  # bytes
ALLOWED = {"memcpy", "memset"}  # what the core may ask of a library: so there is no heap
BARE = ["-std=c++17", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics", "-ffreestanding"]
STRICT = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror"]
CORTEX = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
MARGIN, SLACK = 0.05, 20  # by which a figure may exceed the committed one: a share, and bytes or instructions
SIZES = ("arm", "esp32")  # the checks whose figures are budgets
CONTENTS = 7  # of frames of each length whose bits are flipped
SANITIZERS = "address,undefined,float-divide-by-zero,float-cast-overflow"
# Of a picolibc for other processors: headers only.
PICOLIBC = Path("/usr/lib/xtensa-lx106-elf/include")

Figures = dict[str, object]


class UnfitError(Exception):
    """The core is not fit for a module."""


def over_budget(name: str, found: Figures) -> list[str]:
    """Return the sizes that exceed the committed ones, each as a sentence."""
    return exceeded(found, json.loads(FIGURES.read_text(encoding="utf-8"))[name])


def exceeded(found: Mapping[str, object], budget: Mapping[str, object]) -> list[str]:
    """Return the figures that exceed their budget by more than the margin, each as a sentence."""
    return [
        f"{name} is {number}; {allowed} were committed, and {MARGIN:.0%} more are allowed"
        for name, allowed in budget.items()
        if isinstance(allowed, int) and isinstance(number := found[name], int)
        if number > (1 + MARGIN) * allowed + SLACK
    ]


def not_installed(tools: Iterable[str | Path]) -> list[str]:
    """Return those of some tools, programs by their names or files, that this computer lacks."""
    return [str(tool) for tool in tools if not (tool.exists() if isinstance(tool, Path) else shutil.which(tool))]


def run(*words: object) -> str:
    """Return what a command prints, or raise with that as the reason."""
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise UnfitError(f"{words[0]} failed:\n{done.stderr[-4000:]}{done.stdout[-2000:]}")
    return done.stdout


def arm(folder: Path) -> Figures:
    """Text and bss for a Cortex-M4F, with one module in it; what it asks of libraries; its deepest stack frame."""
    instance = folder / "instance.cpp"
    instance.write_text(
        '#include "module.hpp"\n'
        "tensionlab::firmware::Module module(1, tensionlab::firmware::ResetReason::power);\n"
    )
    objects = []
    for source in [*CORE, instance]:
        objects.append(folder / f"{source.stem}.o")
        flags = [*BARE, *CORTEX, *STRICT, "-Os", "-nostdinc++", "-fstack-usage", f"-I{FIRMWARE / 'core'}"]
        run("arm-none-eabi-g++", *flags, "-c", source, "-o", objects[-1])
    whole = folder / "core.o"
    run("arm-none-eabi-ld", "-r", *objects, "-o", whole)
    text, data, bss, *_ = run("arm-none-eabi-size", whole).splitlines()[1].split()
    wanted = {line.split()[-1] for line in run("arm-none-eabi-nm", "-u", whole).splitlines() if line.strip()}
    frames = [line.split("\t") for path in folder.glob("*.su") for line in path.read_text().splitlines()]
    if not wanted <= ALLOWED:
        raise UnfitError(
            f"the core asks for {', '.join(sorted(wanted - ALLOWED))}; it may ask for {', '.join(ALLOWED)}"
        )
    if int(text) >= MOST_TEXT or int(data) + int(bss) >= MOST_BSS:
        raise UnfitError(
            f"the core has {text} bytes of text and {bss} of bss; below {MOST_TEXT} and {MOST_BSS} are allowed"
        )
    if any(frame[2] != "static" for frame in frames):
        raise UnfitError("a stack frame of the core has no size that is known beforehand")
    return {
        "text_bytes": int(text),
        "data_bytes": int(data),
        "bss_bytes": int(bss),
        "asks_for": sorted(wanted),
        "deepest_frame_bytes": max(int(frame[1]) for frame in frames),
    }


def around_a_bug(code: str) -> str:
    """LLVM 22 can't choose between two float constants for this processor: let it choose integers."""

    def bits(constant: str) -> int:
        raw = bytes.fromhex(constant[2:].rjust(16, "0")) if constant.startswith("0x") else None
        value = struct.unpack(">d", raw)[0] if raw else float(constant)
        return struct.unpack("<I", struct.pack("<f", value))[0]

    choice = re.compile(
        r"^ +(%\S+) = select (?:\w+ )*?(i1 %[\w.]+), float ([-+.\dexA-F]+), float ([-+.\dexA-F]+)", re.M
    )
    return choice.sub(
        lambda found: (
            f"  %bits{found[1][1:]} = select {found[2]}, i32 {bits(found[3])}, i32 {bits(found[4])}\n"
            f"  {found[1]} = bitcast i32 %bits{found[1][1:]} to float"
        ),
        code,
    )


def esp32(folder: Path) -> Figures:
    """Compile the core for the ESP32's processor: how many instructions, and which helpers it calls."""
    assembly = ""
    for source in CORE:
        code, result = folder / f"{source.stem}.ll", folder / f"{source.stem}.s"
        target = ["--target=xtensa", *BARE, "-w", "-emit-llvm", "-S", "-Os", "-isystem", PICOLIBC]
        run("clang++-22", *target, source, "-o", code)
        code.write_text(around_a_bug(code.read_text()))
        run("llc-22", "-march=xtensa", "-mcpu=esp32", "-O2", "-filetype=asm", code, "-o", result)
        assembly += result.read_text()
    own = set(re.findall(r"^([\w$]+):", assembly, re.M))
    words = set(re.findall(r"^\s+\.literal\s+\S+,\s*([A-Za-z_]\w*)", assembly, re.M))
    called = sorted(word for word in words - own if not word.startswith((".L", "_ZN10tensionlab")))
    doubles = [word for word in called if re.search(r"df[23]|df2|sfdf|sidf|dfsi", word)]
    heap = [word for word in called if re.match(r"malloc|free|_Zn|_Zd|__cxa", word)]
    if doubles or heap:
        raise UnfitError(f"the code of the core for the ESP32 calls {', '.join(doubles + heap)}")
    instructions = len(re.findall(r"^\t[a-z]\w*(?:\.\w+)*(?:\t|$)", assembly, re.M))
    return {"core_instructions": instructions, "core_calls": called}


def flips(folder: Path) -> Figures:
    """Flip every one and every two bits of frames of every length, and count those that pass."""
    program = folder / "flips"
    run("c++", "-std=c++17", "-O2", *STRICT, FUZZ / "flips.cpp", "-o", program)
    [(count, passed)] = re.findall(r"(\d+) flips, (\d+) passed", run(program, CONTENTS, 1))
    return {"flips": int(count), "passed": int(passed)}


def fuzz(folder: Path, chunks: int) -> Figures:
    """Feed chunks of bytes to modules under the address and undefined behaviour sanitizers."""
    program = folder / "fuzz"
    flags = ["-std=c++17", "-O1", "-g", *STRICT, f"-fsanitize={SANITIZERS}", "-fno-sanitize-recover=all"]
    run("c++", *flags, FUZZ / "fuzz.cpp", FUZZ / "driver.cpp", *CORE, "-o", program)
    output = run(program, chunks, 1)
    print(f"  {output.strip()}")
    return {"chunks": int(output.split()[0]), "steps": int(output.split()[2])}


def libfuzzer(folder: Path, seconds: int) -> Figures:
    """Fuzz with libFuzzer, which follows coverage."""
    program, corpus = folder / "libfuzzer", folder / "corpus"
    corpus.mkdir()
    flags = ["-std=c++17", "-O1", "-g", f"-fsanitize=fuzzer,{SANITIZERS}", "-fno-sanitize-recover=all"]
    run("clang++-22", *flags, FUZZ / "fuzz.cpp", *CORE, "-o", program)
    run(program, f"-max_total_time={seconds}", "-max_len=4000", f"-artifact_prefix={folder}/", corpus)
    return {"seconds": seconds}


def in_a_folder(check: Callable[[Path], Figures]) -> Figures:
    """Run a check in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        return check(Path(folder))


def main() -> int:
    """Run all checks whose tools are there; 1 if one fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("checks", nargs="*", metavar="CHECK", help="all, if none is named")
    parser.add_argument("--chunks", type=int, default=10_000_000, help="how much to fuzz (default: 10 million)")
    parser.add_argument("--seconds", type=int, default=30, help="how long libFuzzer may run (default: 30)")
    parser.add_argument("--write", action="store_true", help=f"write the figures to {FIGURES.name}")
    options = parser.parse_args()
    checks: dict[str, tuple[Callable[[Path], Figures], tuple[str | Path, ...]]] = {
        "arm": (arm, ("arm-none-eabi-g++",)),
        "esp32": (esp32, ("clang++-22", "llc-22", PICOLIBC)),
        "flips": (flips, ("c++",)),
        "fuzzing": (lambda folder: fuzz(folder, options.chunks), ("c++",)),
        "libfuzzer": (lambda folder: libfuzzer(folder, options.seconds), ("clang++-22",)),
    }
    if unknown := set(options.checks) - set(checks):
        parser.error(f"no check is called {', '.join(sorted(unknown))}; there are {', '.join(checks)}")
    figures: dict[str, Figures] = json.loads(FIGURES.read_text(encoding="utf-8"))
    failed = False
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # each waits for programs
        running: dict[str, Future[Figures]] = {}
        for name in options.checks or checks:
            check, tools = checks[name]
            if lacking := not_installed(tools):
                print(f"{name}: left out, for want of {', '.join(lacking)}")
            else:
                running[name] = pool.submit(in_a_folder, check)
        for name, result in running.items():
            try:
                found = figures[name] = result.result()
                if name in SIZES and not options.write and (excess := over_budget(name, found)):
                    raise UnfitError("; ".join(excess))
            except UnfitError as reason:
                print(f"{name}: {reason}")
                failed = True
            else:
                print(f"{name}: " + ", ".join(f"{key} {value}" for key, value in found.items()))
    if options.write and not failed:
        FIGURES.write_text(json.dumps(figures, indent=1) + "\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
