"""Run tests of the native code under the thread, address and undefined-behaviour sanitizers (``make sanitize``).

Each has its own build of the extension in ``build/sanitize/``, compiled for this processor with GCC. In
the tests every Python process loads that one, through `sitecustomize`. Tests that limit the memory or fork
a process with threads are left out: the sanitizers can do neither.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build" / "sanitize"
LEFT_OUT = "not realtime and not slow"
NOT_RUN = "not memory and not fork"
COUPLED = ["tests/test_threads.py", "tests/hardware/simulation", "tests/hardware/client/test_endpoint.py"]
TESTS = {
    "thread": [
        *COUPLED, "tests/test_allocation.py",
        *(f"tests/hardware/client/test_{name}.py" for name in ("link_reader", "group")),
    ],
    "address,undefined": [
        *COUPLED, "tests/solvers", "tests/firmware", "tests/test_verification.py", "tests/test_optimality.py",
        "tests/workspace/certification",
        *(f"tests/workspace/test_{name}.py" for name in ("margin", "structure_metrics")),
    ],
}  # fmt: skip
"""Tests by the sanitizers that they run under."""
# The C++ library is there before the address sanitizer, which looks for its exceptions as it starts.
LIBRARIES = {"thread": ["libtsan.so"], "address,undefined": ["libasan.so", "libstdc++.so"]}
OPTIONS = {"thread": "halt_on_error=0", "address,undefined": "detect_leaks=0"}
PRELOADED = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("tensionlab._native", {library!r})
module = sys.modules["tensionlab._native"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
"""


def build(sanitizers: str, folder: Path) -> Path:
    """Compile the extension, and return it."""
    flags = f"-fsanitize={sanitizers} -fno-sanitize-recover=all -g1"
    words = [sys.executable, "-m", "nanobind", "--cmake_dir"]
    nanobind = subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()
    options = {
        "CMAKE_BUILD_TYPE": "Debug",
        "CMAKE_CXX_COMPILER": "g++",
        "CMAKE_CXX_FLAGS": flags,
        "CMAKE_MODULE_LINKER_FLAGS": flags,
        "nanobind_DIR": nanobind,
        "Python_EXECUTABLE": sys.executable,
        "TENSIONLAB_BUILDS": "native",
    }
    words = [f"-D{name}={value}" for name, value in options.items()]
    subprocess.run(
        ["cmake", "-S", ROOT, "-B", folder, "-G", "Ninja", *words], check=True, stdout=subprocess.DEVNULL
    )
    subprocess.run(["ninja", "-C", folder, "--quiet"], check=True)
    return next(folder.glob("_native*"))


def run(sanitizers: str, folder: Path, library: Path) -> int:
    """Run the tests; return how many processes reported something, or failed."""
    (folder / "sitecustomize.py").write_text(PRELOADED.format(library=str(library)))
    for report in folder.glob("report.*"):
        report.unlink()
    paths = [
        subprocess.run(
            ["g++", f"-print-file-name={name}"], check=True, capture_output=True, text=True
        ).stdout.strip()
        for name in LIBRARIES[sanitizers]
    ]
    options = f"log_path={folder / 'report'}:{OPTIONS[sanitizers]}"
    environment = {
        **{f"{name}SAN_OPTIONS": options for name in ("T", "A", "UB")},
        "LD_PRELOAD": " ".join(paths),
        "PYTHONPATH": str(folder),
        "TENSIONLAB_NUM_THREADS": "4",
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-n",
        "0",
        "--capture=sys",
        "-m",
        LEFT_OUT,
        "-k",
        NOT_RUN,
        *TESTS[sanitizers],
    ]
    # Without random addresses, which GCC's thread sanitizer does not expect.
    ended = subprocess.run(["setarch", "-R", *command], cwd=ROOT, env={**os.environ, **environment}, check=False)
    reports = list(folder.glob("report.*"))
    for report in reports:
        print(report.read_text()[:4000])
    return len(reports) + (ended.returncode != 0)


def main() -> int:
    """Build and test under each sanitizer; 1 if there is a finding."""
    findings = 0
    for sanitizers in TESTS:
        begin, folder = time.monotonic(), FOLDER / sanitizers.partition(",")[0]
        library = build(sanitizers, folder)
        built = time.monotonic()
        found = run(sanitizers, folder, library)
        print(f"{sanitizers}: {found} findings; {built - begin:.0f} + {time.monotonic() - built:.0f} s")
        findings += found
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
