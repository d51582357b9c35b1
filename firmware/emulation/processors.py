"""Programs for this computer and for emulated processors: compiled, linked, and run for the figures they print."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from firmware.check import CORTEX, STRICT, around_a_bug, not_installed, run
from firmware.emulation.link_xtensa import link

EMULATION = Path(__file__).parent
ROOT = EMULATION.parents[1]
# No fused multiplications but where the code asks for one: then all processors round alike.
COMMON = ["-std=c++17", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics", "-ffp-contract=off",
          "-fno-math-errno", f"-I{ROOT}", f"-I{ROOT / 'include'}"]  # fmt: skip
NEWLIB = Path("/usr/include/newlib")  # of arm-none-eabi: its headers of C++ serve any processor of 32 bits
# An instruction takes 2^5 ns of the emulated clock, hardly less than a tick of the counters: so each one counts.
QEMU_ARM = ("qemu-system-arm", "-M", "mps2-an386", "-icount", "shift=5", "-semihosting-config",
            "enable=on,target=native", "-nographic", "-kernel")  # fmt: skip
QEMU_XTENSA = ("qemu-system-xtensa", "-M", "sim", "-cpu", "de233_fpu", "-semihosting", "-nographic", "-icount",
               "shift=5", "-kernel")  # fmt: skip
TOOLS = {
    "host": ("c++",),
    "cortex-m4f": ("arm-none-eabi-g++", QEMU_ARM[0]),
    "xtensa": ("clang++-22", "llc-22", "llvm-mc-22", QEMU_XTENSA[0], NEWLIB),
}
PROCESSORS = tuple(TOOLS)
Command = tuple[object, ...]


def missing(processor: str) -> list[str]:
    """Return the tools of a processor that are not installed."""
    return not_installed(TOOLS[processor])


def build_host(sources: Sequence[Path], options: Sequence[str], folder: Path) -> tuple[Command, int]:
    """Compile for this computer; return the command to run, and the bytes of code (0: not counted)."""
    program = folder / "host"
    run("c++", *COMMON, *STRICT, *options, *sources, EMULATION / "host.cpp", "-o", program)
    return (program,), 0


def build_cortex(sources: Sequence[Path], options: Sequence[str], folder: Path) -> tuple[Command, int]:
    """Compile for a Cortex-M4F; return the command that emulates it, and the bytes of code."""
    program = folder / "cortex.elf"
    linker = ["-nostartfiles", "-Wl,--gc-sections", "-T", EMULATION / "cortex_m4.ld"]
    sections = ["-ffunction-sections", "-fdata-sections"]
    files = [*sources, EMULATION / "cortex_m4.cpp"]
    run("arm-none-eabi-g++", *COMMON, *CORTEX, *sections, *options, *files, *linker, "-o", program)
    return (*QEMU_ARM, program), int(run("arm-none-eabi-size", program).splitlines()[1].split()[0])


def assembly_of(source: Path, options: Sequence[str], folder: Path) -> str:
    """Compile a source for the ESP32's processor; return assembly with plain words for literals."""
    version = max((NEWLIB / "c++").iterdir())
    headers = ["-nostdinc++", "-isystem", version, "-isystem", version / "arm-none-eabi/thumb/v6-m/nofp",
               "-isystem", NEWLIB]  # fmt: skip
    code, assembly = folder / f"{source.stem}.ll", folder / f"{source.stem}.s"
    target = ["--target=xtensa", "-w", "-emit-llvm", "-S", "-fno-builtin", "-fno-asynchronous-unwind-tables"]
    run("clang++-22", *COMMON, *target, *headers, *options, source, "-o", code)
    code.write_text(around_a_bug(code.read_text()))
    backend = ["-march=xtensa", "-mcpu=esp32", "-mattr=-mul32high", "-O2", "-fp-contract=off"]
    run("llc-22", *backend, "--function-sections", "-filetype=asm", code, "-o", assembly)
    text = re.sub(r"^\t\.literal_position$", "\t.p2align 2", assembly.read_text(), flags=re.M)
    return re.sub(r"^\t\.literal (\S+), (\S+)$", r"\1:\n\t.long \2", text, flags=re.M)


def build_xtensa(sources: Sequence[Path], options: Sequence[str], folder: Path) -> tuple[Command, int]:
    """Compile for an Xtensa with the ESP32's instructions, but for one that QEMU's processor lacks, and link."""
    texts = {"start": (EMULATION / "esp32.s").read_text()}
    for source in (*sources, EMULATION / "esp32.cpp"):
        texts[source.stem] = assembly_of(source, options, folder)
    objects = []
    for name, text in texts.items():
        assembly = folder / f"{name}.s"
        assembly.write_text(text)
        objects.append(assembly.with_suffix(".o"))
        run("llvm-mc-22", "-arch=xtensa", "-mcpu=esp32", "-filetype=obj", assembly, "-o", objects[-1])
    program = folder / "xtensa.elf"
    return (*QEMU_XTENSA, program), link(objects, program)


BUILDS = {"host": build_host, "cortex-m4f": build_cortex, "xtensa": build_xtensa}


def figures_of(
    processor: str,
    sources: Sequence[Path],
    optimise: str,
    values: Mapping[str, int],
    timeout_s: float = 7200.0,
) -> dict[str, int]:
    """Compile a bench for a processor and run it.

    Parameters
    ----------
    processor : str
        One of `PROCESSORS`.
    sources : sequence of Path
        The bench and what it measures.
    optimise : str
        Option of the compiler.
    values : mapping of str to int
        Macros to define.
    timeout_s : float
        Longest run, in s.

    Returns
    -------
    dict of str to int
        What the bench prints, and the bytes of code as ``flash`` (0 on this computer).
    """
    options = [optimise, *(f"-D{name}={value}" for name, value in values.items())]
    with tempfile.TemporaryDirectory() as folder:
        command, flash = BUILDS[processor](sources, options, Path(folder))
        words = [str(word) for word in command]
        pipe = subprocess.PIPE
        done = subprocess.run(
            words, stdout=pipe, stderr=subprocess.STDOUT, text=True, check=True, timeout=timeout_s
        )
    found = re.findall(r"^(?:.qemu. )?(\w+) (\d+)$", done.stdout, re.M)
    return {**{name: int(number) for name, number in found}, "flash": flash}
