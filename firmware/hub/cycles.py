"""What does an allocation cost on a module's processor? Arm code, run instruction by instruction.

qemu runs what the cross compiler made for a Cortex-M4F, and logs every instruction; each is worth the cycles that
"Cortex-M4 Technical Reference Manual" (Arm, 2010) gives it, without wait states of the memory. An ESP32 has about
the same instructions, but divides by a subroutine.
"""

from __future__ import annotations

import re
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np

import tensionlab as tl

HUB = Path(__file__).parent
ROOT = HUB.parents[1]
RIG = ROOT / "datasets" / "rigs" / "bartels2026-validation.toml"
ARM = ["-std=c++17", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-fno-exceptions"]
ARM += [
    "-fno-rtti",
    "-fno-threadsafe-statics",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
]
FAST = ["-O2", "-fno-math-errno"]
SAME = 1e-4  # N: what float may differ from double


def problems(count: int = 60, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Structure matrices and wrenches of the published rig: half of them within reach, half mostly beyond."""
    rig, random = tl.load_rig(RIG), np.random.default_rng(seed)
    positions = np.array(rig.home) + random.uniform(-0.15, 0.15, (count, 3))
    structures = rig.structure_matrix(positions)
    tensions = random.uniform(0.5, 6.0, (count, 4))
    wrenches = np.einsum("knm,km->kn", structures, tensions)
    wrenches[1::2] = random.normal(0.0, 3.0, (count // 2, 3))
    return structures.astype(np.float32), wrenches.astype(np.float32)


def braces(values: np.ndarray) -> str:
    """How C++ writes an array of floats, nested."""
    if values.ndim == 0:
        return f"{float(values):.9e}f"
    return "{" + ", ".join(braces(value) for value in values) + "}"


def cost(mnemonic: str, operands: str, jumped: bool) -> int:
    """How many cycles does an instruction take?"""
    if re.match(r"v(div|sqrt)", mnemonic):
        return 14
    if re.match(r"vn?(fma|fms|mla|mls)|vfn", mnemonic):
        return 3
    if re.match(r"[us]div", mnemonic):
        return 12
    if re.match(r"push|pop|v?ldm|v?stm|vpush|vpop", mnemonic):
        listed = operands.partition("{")[2].rstrip("}")
        spans = [
            [int(end[1:]) for end in span.split("-")] for span in re.findall(r"[rsd]\d+(?:-[rsd]\d+)?", listed)
        ]
        named = len(re.findall(r"\b(?:lr|pc|ip|fp|sl|sp)\b", listed))
        double = 2 if re.search(r"\bd\d", listed) else 1
        return 1 + named + double * sum(span[-1] - span[0] + 1 for span in spans) + (3 if jumped else 0)
    if re.match(r"v?ldr", mnemonic):
        return 3 if mnemonic.startswith("ldrd") else 2
    return 4 if jumped else 1


def measure(folder: Path) -> dict[str, object]:
    """Compile, run, check the answers, and count: text and stack in bytes; instructions and cycles a call."""
    structures, wrenches = problems()
    count, _, cables = structures.shape
    lower, upper = np.full(cables, 0.5), np.full(cables, 6.0)
    (folder / "problems.hpp").write_text(
        f"constexpr int kProblems = {count}, kCables = {cables};\n"
        f"constexpr float kStructures[{count}][{3 * cables}] = {braces(structures.reshape(count, -1))};\n"
        f"constexpr float kWrenches[{count}][3] = {braces(wrenches)};\n"
        f"constexpr float kLower[] = {braces(lower)}, kUpper[] = {braces(upper)};\n"
    )
    compiler, hub, program = "arm-none-eabi-g++", folder / "allocate.o", folder / "count.elf"
    run = lambda *words: subprocess.run([str(word) for word in words], check=True, capture_output=True)  # noqa: E731
    run(compiler, *ARM, *FAST, "-fstack-usage", "-c", HUB / "allocate.cpp", "-o", hub)
    run(compiler, *ARM, "-Os", "-c", f"-I{folder}", HUB / "count.cpp", "-o", folder / "count.o")
    libraries = ["-nostartfiles", "-Wl,-Ttext=0x10000", "-lm", "-lc", "-lgcc"]
    run(compiler, *ARM, folder / "count.o", hub, *libraries, "-o", program)
    log = folder / "count.log"
    output = run("qemu-arm", "-cpu", "cortex-a15", "-singlestep", "-d", "nochain,exec", "-D", log, program).stdout
    found = np.frombuffer(output, np.float32).reshape(count, cables)
    exact = tl.allocate(structures, wrenches, (lower, upper), nearest="force")
    reachable = exact.status == tl.Status.EXACT
    error = float(np.abs(found - exact.tensions)[reachable].max())
    if not error <= SAME:
        raise AssertionError(f"the module's solver is {error:.2g} N off; at most {SAME:g} N is allowed")

    listing = run("arm-none-eabi-objdump", "-d", "--no-show-raw-insn", program).stdout.decode()
    code = {
        int(address, 16): (mnemonic, operands)
        for address, mnemonic, operands in re.findall(
            r"^ *([0-9a-f]+):\t(\S+)\s*([^\n;@]*)", listing, re.MULTILINE
        )
    }
    symbol = re.search(r"^([0-9a-f]+) <allocate_tensions>:", listing, re.MULTILINE)
    addresses = [int(line.split("/")[1], 16) for line in log.read_text().splitlines() if line.startswith("Trace")]
    calls: list[list[int]] = []
    for here, after in pairwise(addresses):
        if here == int(symbol[1], 16):
            calls.append([0, 0])
        if calls:
            jumped = not 0 < after - here <= 4
            calls[-1][0] += 1
            calls[-1][1] += cost(*code[here], jumped)
    stack = max(int(line.split("\t")[1]) for line in (folder / "allocate.su").read_text().splitlines())
    instructions, cycles = np.array(calls).T
    return {
        "text_bytes": int(run("arm-none-eabi-size", hub).stdout.split(b"\n")[1].split()[0]),
        "deepest_frame_bytes": stack,
        "largest_error_newton": float(f"{error:.1g}"),
        "problems_reachable": int(reachable.sum()),
        "instructions_reachable": int(np.median(instructions[reachable])),
        "cycles_reachable": int(np.median(cycles[reachable])),
        "cycles_reachable_most": int(cycles[reachable].max()),
        "problems_out_of_reach": int((~reachable).sum()),
        "cycles_out_of_reach": int(np.median(cycles[~reachable])),
        "cycles_out_of_reach_most": int(cycles[~reachable].max()),
    }


if __name__ == "__main__":
    import json
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(measure(Path(folder)), indent=1))
