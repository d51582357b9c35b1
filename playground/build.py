"""Build the playground: one page with the solver, every committed rig and no need of a network.

``python playground/build.py`` writes out/playground.html. The kernels are compiled to WebAssembly by the C++
compiler of the Python package ``ziglang``; objects are kept in build/playground and compiled again where a source
is newer.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import tensionlab as tl
from tensionlab import datasets

HERE = Path(__file__).parent
ROOT = HERE.parent
NATIVE, INCLUDE = ROOT / "tensionlab" / "native", ROOT / "include"
OBJECTS = ROOT / "build" / "playground"
PAGE = ROOT / "out" / "playground.html"
MAX_BYTES = 600_000
SCRIPTS = ("geometry", "rig", "scene", "share", "panel", "app")  # each uses those before it
KERNELS = (
    "solvers/sweep_kernel.cpp",
    "solvers/newton_kernel.cpp",
    "verification/certificates.cpp",
    "workspace/workspace_kernel.cpp",
)
FLAGS = (
    "-target", "wasm32-wasi", "-msimd128", "-O2", "-std=c++17",
    "-fno-exceptions", "-fno-rtti", "-fno-math-errno", "-fno-trapping-math",
)  # fmt: skip


def compile_source(source: Path, defines: list[str]) -> Path:
    """Compile a source to an object, unless a newer one is there."""
    made = OBJECTS / f"{source.stem}.o"
    newest = max(path.stat().st_mtime for path in (source, *NATIVE.rglob("*.hpp"), *INCLUDE.rglob("*.hpp")))
    if not made.exists() or made.stat().st_mtime < newest:
        run_zig("c++", *FLAGS, *defines, f"-I{NATIVE}", f"-I{INCLUDE}", "-c", str(source), "-o", str(made))
    return made


def run_zig(*arguments: str) -> None:
    """Run the compiler or the linker; RuntimeError with its message if it fails."""
    run = subprocess.run(
        [sys.executable, "-m", "ziglang", *arguments], capture_output=True, text=True, check=False
    )
    if run.returncode:
        raise RuntimeError(run.stderr)


def build_kernels() -> bytes:
    """Return the kernels as a WebAssembly module."""
    OBJECTS.mkdir(parents=True, exist_ok=True)
    inside = ["-DTENSIONLAB_BUILD=baseline", "-DTENSIONLAB_LANES=2"]
    jobs = [(NATIVE / name, inside) for name in KERNELS] + [(HERE / "kernels.cpp", [])]
    with ThreadPoolExecutor(2) as pool:
        objects = list(pool.map(lambda job: str(compile_source(*job)), jobs))
    module = OBJECTS / "kernels.wasm"
    run_zig("wasm-ld", "--no-entry", "--strip-all", "-o", str(module), *objects)  # no library: a minute's work
    return module.read_bytes()


def rig_entry(rig: tl.Rig) -> dict[str, Any]:
    """Return a rig as the page keeps it; body frames are at rest, and anchors in world axes."""
    if rig.pulleys is not None or rig.required.box is not None or rig.required.wrenches is not None:
        raise ValueError(f"{rig.name}: the page knows neither pulleys nor sets of required wrenches")
    cables = rig.cables(rig.home, frames=rig.at_rest)
    ends = rig.home if cables.arms is None else rig.home + cables.arms
    anchors = ends + cables.lengths[:, None] * cables.directions
    up = rig.up or "y"
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    turns = rig.home_orientation is not None
    platform = rig.platform
    return {
        "name": rig.name,
        "kind": rig.kind,
        "dimension": rig.dimension,
        "turns": turns,
        "upAxis": up,
        "up": axis.tolist(),
        "home": rig.home.tolist(),
        "homeRotation": np.zeros(2 * rig.dimension - 3).tolist()
        if rig.home_rotation is None
        else rig.home_rotation.tolist(),
        "length": rig.required.length_for(rig),
        "required": (np.zeros(rig.n) if rig.required.wrench is None else rig.required.wrench).tolist(),
        "weighs": rig.required.gravity,
        "mass": None if platform is None else platform.mass,
        "com": None if platform is None or platform.com is None else platform.com.tolist(),
        "modules": [
            {
                "name": module.name,
                "anchor": anchor.round(12).tolist(),
                "lower": module.lower,
                "upper": module.upper,
            }
            | ({"attachment": module.attachment.tolist()} if turns and module.attachment is not None else {})
            for module, anchor in zip(rig.modules, anchors, strict=True)
        ],
    }


def bundle() -> str:
    """Return all scripts as one, without what joins them as modules."""
    text = "\n".join((HERE / f"{name}.js").read_text() for name in SCRIPTS)
    return re.sub(r"^import .*\n|^export ", "", text, flags=re.M)


def report(made: Path, most: int) -> None:
    """Print the size of a file that was made; RuntimeError if it is too large."""
    size = made.stat().st_size
    if size > most:
        raise RuntimeError(f"{made} has {size:,} bytes; {most:,} is the most")
    print(f"{made.relative_to(ROOT)}: {size:,} bytes")


def main() -> None:
    """Write the page, and print its size."""
    packed = base64.b64encode(gzip.compress(build_kernels(), 9, mtime=0)).decode()
    rigs = {rig.name: rig_entry(rig) for rig in map(datasets.load, datasets.names("rigs"))}
    page = (HERE / "page.html").read_text()
    for mark, text in (("@KERNELS@", packed), ("@RIGS@", json.dumps(rigs)), ("@SCRIPT@", bundle())):
        page = page.replace(mark, text)
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page)
    report(PAGE, MAX_BYTES)


if __name__ == "__main__":
    main()
