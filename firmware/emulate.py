"""Run the core and the allocator on emulated processors: ``python firmware/emulate.py``.

The core is fed a stream of commands, sensors and mishaps; the allocator solves problems in float, a tenth of them
random and the rest adversarial. Both do so on this computer, on a Cortex-M4F and on an Xtensa like the ESP32's,
the last two under QEMU; all must give the same bytes. The core's instructions and stack in `emulated.json` are its
budget: more than `check.MARGIN` beyond them is an error, until ``--write`` replaces them. Debian has the tools::

    apt install gcc-arm-none-eabi libnewlib-arm-none-eabi libstdc++-arm-none-eabi-newlib qemu-system-arm
    apt install clang-22 llvm-22 qemu-system-misc  # for the Xtensa, beside those
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from firmware.check import CORE, exceeded  # noqa: E402
from firmware.emulation.processors import EMULATION, PROCESSORS, figures_of, missing  # noqa: E402

FIGURES = ROOT / "firmware" / "emulated.json"
STEPS = 100_000
SHAPES = ((3, 4), (3, 8), (6, 8))
PROBLEMS, ITERATION_LIMIT = 100_000, 100
POLICIES = ("force", "tension", "direction")
# Ends of the names of figures that may not grow. The median of a command depends on how many of them are refused.
BUDGETED = ("step_median", "turn_median", "_p999", "_worst", "stack", "object")

Figures = dict[str, int]


def measure_core(processor: str, steps: int = STEPS, core: Sequence[Path] = tuple(CORE)) -> Figures:
    """Return what the bench of the core prints on a processor; only emulated ones count instructions."""
    found = figures_of(processor, (EMULATION / "module_bench.cpp", *core), "-Os", {"STEPS": steps})
    del found["flash"]  # most of it is the bench's; check.py has the core's
    counted = ("_median", "_p999", "_worst", "stack", "object")
    return {name: number for name, number in found.items() if processor != "host" or not name.endswith(counted)}


def measure_allocator(
    processor: str,
    shape: tuple[int, int],
    problems: int = PROBLEMS,
    iteration_limit: int = ITERATION_LIMIT,
    policy: str = "force",
    optimise: str = "-O2",
) -> Figures:
    """Return what the bench of the allocator prints on a processor, with the bytes of its code as ``flash``."""
    values = {"N_COMPONENTS": shape[0], "M_CABLES": shape[1], "PROBLEMS": problems,
              "ITERATION_LIMIT": iteration_limit, "POLICY": POLICIES.index(policy)}  # fmt: skip
    return figures_of(processor, (EMULATION / "allocator_bench.cpp",), optimise, values)


def over_budget(processor: str, found: Figures) -> list[str]:
    """Return the core's figures that exceed the committed ones, each as a sentence."""
    budget = json.loads(FIGURES.read_text(encoding="utf-8"))["core"][processor]
    named = {name: allowed for name, allowed in budget.items() if name.endswith(BUDGETED)}
    return exceeded(found, named)


def compare(what: str, measure: Callable[[str], Figures]) -> dict[str, Figures]:
    """Measure on every processor whose tools are there; exit where one gives other bytes than this computer."""
    table: dict[str, Figures] = {}
    for processor in PROCESSORS:
        if lacking := missing(processor):
            print(f"{what}, {processor}: left out, for want of {', '.join(lacking)}")
            continue
        found = table[processor] = measure(processor)
        print(
            f"{what}, {processor}: " + ", ".join(f"{name} {number}" for name, number in found.items()), flush=True
        )
        if found["hash"] != table["host"]["hash"]:
            raise SystemExit(f"{what}, {processor}: the bytes are not those of this computer")
    return table


def main() -> int:
    """Measure; 1 if the core exceeds its budget, or a processor gives other bytes than this computer."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", nargs="?", choices=("all", "core", "allocator"), default="all")
    parser.add_argument("--write", action="store_true", help=f"write the figures to {FIGURES.name}")
    options = parser.parse_args()
    figures: dict[str, Any] = json.loads(FIGURES.read_text(encoding="utf-8"))
    excess: list[str] = []
    if options.what != "allocator":
        core = compare("core", measure_core)
        if not options.write:
            excess = [
                f"{name}: {line}" for name in core if name != "host" for line in over_budget(name, core[name])
            ]
        figures["core"] = {"steps": STEPS, **core}
    if options.what != "core":
        allocator: dict[str, Any] = {"problems": PROBLEMS, "iteration_limit": ITERATION_LIMIT}
        for shape in SHAPES:
            name = f"{shape[0]} x {shape[1]}"
            table = compare(
                f"allocator, {name}", lambda processor, shape=shape: measure_allocator(processor, shape)
            )
            for processor, found in table.items():
                allocator.setdefault(processor, {})[name] = found
        figures["allocator"] = allocator
    if options.write:
        FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print("\n".join(excess), end="\n" if excess else "")
    return 1 if excess else 0


if __name__ == "__main__":
    sys.exit(main())
