"""Allocate on emulated processors: answers, instructions, stack: ``python firmware/emulate.py``.

The same problems, a tenth of them random and the rest adversarial, are solved in float by this computer, by a
Cortex-M4F and by an Xtensa like the ESP32's, both under QEMU; all must give the same bytes. With ``--write`` the
figures go to `allocator.json`. Debian has everything that is needed::

    apt install gcc-arm-none-eabi libnewlib-arm-none-eabi libstdc++-arm-none-eabi-newlib qemu-system-arm
    apt install clang-22 llvm-22 qemu-system-misc  # for the Xtensa, beside those
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from firmware.check import CORTEX, STRICT, around_a_bug, run  # noqa: E402
from firmware.emulation.link_xtensa import link  # noqa: E402

EMULATION = ROOT / "firmware" / "emulation"
FIGURES = ROOT / "firmware" / "allocator.json"
SHAPES = ((3, 4), (3, 8), (6, 8))
PROBLEMS, ITERATION_LIMIT = 100_000, 100
POLICIES = ("force", "tension", "direction")
# No fused multiplications but where the code asks for one: then all processors round alike.
COMMON = ["-std=c++17", "-O2", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics", "-ffp-contract=off",
          "-fno-math-errno", f"-I{ROOT}", f"-I{ROOT / 'include'}"]  # fmt: skip
PLAIN = ("-fno-builtin", "-fno-asynchronous-unwind-tables", "-fomit-frame-pointer")
NEWLIB = Path("/usr/include/newlib")  # of arm-none-eabi: its headers of C++ serve any processor of 32 bits
QEMU_ARM = ("qemu-system-arm", "-M", "mps2-an386", "-icount", "shift=0", "-semihosting-config",
            "enable=on,target=native", "-nographic", "-kernel")  # fmt: skip
QEMU_XTENSA = ("qemu-system-xtensa", "-M", "sim", "-cpu", "de233_fpu", "-semihosting", "-nographic", "-icount",
               "shift=0", "-kernel")  # fmt: skip
TOOLS = {
    "host": ("c++",),
    "cortex-m4f": ("arm-none-eabi-g++", QEMU_ARM[0]),
    "xtensa": ("clang++-22", "llc-22", "llvm-mc-22", QEMU_XTENSA[0], NEWLIB),
}


def missing(processor: str) -> list[str]:
    """Return the tools of a processor that are not installed."""
    return [
        str(tool)
        for tool in TOOLS[processor]
        if not (tool.exists() if isinstance(tool, Path) else shutil.which(tool))
    ]


def figures_of(*words: object, timeout_s: float) -> dict[str, int]:
    """Run a program, and return the figures that it prints."""
    command = [str(word) for word in words]
    pipe = subprocess.PIPE
    done = subprocess.run(command, stdout=pipe, stderr=subprocess.STDOUT, text=True, check=True, timeout=timeout_s)
    return {name: int(number) for name, number in re.findall(r"^(?:.qemu. )?(\w+) (\d+)$", done.stdout, re.M)}


def build_host(options: list[str], folder: Path) -> tuple[tuple[object, ...], int]:
    """Compile for this computer; return the command to run, and the bytes of code (0: not counted)."""
    program = folder / "host"
    run("c++", *COMMON, *STRICT, *options, EMULATION / "allocator_bench.cpp", EMULATION / "host.cpp", "-o", program)
    return (program,), 0


def build_cortex(options: list[str], folder: Path) -> tuple[tuple[object, ...], int]:
    """Compile for a Cortex-M4F; return the command that emulates it, and the bytes of code."""
    program = folder / "cortex.elf"
    sources = [EMULATION / "allocator_bench.cpp", EMULATION / "cortex_m4.cpp"]
    linker = ["-nostartfiles", "-Wl,--gc-sections", "-T", EMULATION / "cortex_m4.ld"]
    sections = ["-ffunction-sections", "-fdata-sections"]
    run("arm-none-eabi-g++", *COMMON, *CORTEX, *sections, *options, *sources, *linker, "-o", program)
    return (*QEMU_ARM, program), int(run("arm-none-eabi-size", program).splitlines()[1].split()[0])


def build_xtensa(options: list[str], folder: Path) -> tuple[tuple[object, ...], int]:
    """Compile for an Xtensa with the ESP32's instructions, but for one that QEMU's processor lacks, and link."""
    version = max((NEWLIB / "c++").iterdir())
    headers = ["-nostdinc++", "-isystem", version, "-isystem", version / "arm-none-eabi/thumb/v6-m/nofp",
               "-isystem", NEWLIB]  # fmt: skip
    objects = []
    for source in (EMULATION / "esp32.s", EMULATION / "allocator_bench.cpp", EMULATION / "esp32.cpp"):
        assembly, code = folder / f"{source.stem}{source.suffix}.s", folder / f"{source.stem}.ll"
        if source.suffix == ".s":
            text = source.read_text()
        else:
            target = [
                "--target=xtensa",
                "-w",
                "-emit-llvm",
                "-S",
                "-fno-builtin",
                "-fno-asynchronous-unwind-tables",
            ]
            run("clang++-22", *COMMON, *target, *headers, *options, source, "-o", code)
            code.write_text(around_a_bug(code.read_text()))
            backend = ["-march=xtensa", "-mcpu=esp32", "-mattr=-mul32high", "-O2", "-fp-contract=off"]
            run("llc-22", *backend, "--function-sections", "-filetype=asm", code, "-o", assembly)
            text = re.sub(r"^\t\.literal_position$", "\t.p2align 2", assembly.read_text(), flags=re.M)
            text = re.sub(r"^\t\.literal (\S+), (\S+)$", r"\1:\n\t.long \2", text, flags=re.M)
        assembly.write_text(text)
        objects.append(assembly.with_suffix(".o"))
        run("llvm-mc-22", "-arch=xtensa", "-mcpu=esp32", "-filetype=obj", assembly, "-o", objects[-1])
    program = folder / "xtensa.elf"
    return (*QEMU_XTENSA, program), link(objects, program)


BUILDS = {"host": build_host, "cortex-m4f": build_cortex, "xtensa": build_xtensa}


def measure(
    processor: str,
    shape: tuple[int, int],
    problems: int = PROBLEMS,
    iteration_limit: int = ITERATION_LIMIT,
    policy: str = "force",
    timeout_s: float = 7200.0,
) -> dict[str, int]:
    """Return what the bench prints on a processor, with the bytes of its code as ``flash``."""
    values = {"N_COMPONENTS": shape[0], "M_CABLES": shape[1], "PROBLEMS": problems,
              "ITERATION_LIMIT": iteration_limit, "POLICY": POLICIES.index(policy)}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        command, flash = BUILDS[processor]([f"-D{name}={value}" for name, value in values.items()], Path(folder))
        return {**figures_of(*command, timeout_s=timeout_s), "flash": flash}


def main() -> int:
    """Measure on every processor whose tools are there; 1 if one answers otherwise than this computer."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--problems", type=int, default=PROBLEMS, help=f"of each size (default: {PROBLEMS})")
    parser.add_argument("--write", action="store_true", help=f"write the figures to {FIGURES.name}")
    options = parser.parse_args()
    table: dict[str, dict[str, dict[str, int]]] = {}
    for processor in BUILDS:
        if lacking := missing(processor):
            print(f"{processor}: left out, for want of {', '.join(lacking)}")
            continue
        for n, m in SHAPES:
            found = measure(processor, (n, m), options.problems)
            table.setdefault(processor, {})[f"{n} x {m}"] = found
            print(f"{processor}, {n} x {m}: " + ", ".join(f"{name} {number}" for name, number in found.items()))
            if found["hash"] != table["host"][f"{n} x {m}"]["hash"]:
                print(f"{processor}, {n} x {m}: the answers are not those of this computer")
                return 1
    if options.write:
        FIGURES.write_text(json.dumps({"problems": options.problems, "iteration_limit": ITERATION_LIMIT, **table},
                                      indent=1) + "\n")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
