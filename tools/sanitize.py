"""Run tests of the native code under the thread, address and undefined-behaviour sanitizers (``make sanitize``).

Each has its own build of the extension in ``build/sanitize/``, compiled for this processor with GCC. In
the tests every Python process loads that one, through `sitecustomize`. Left out are tests that limit the memory or
fork a process with threads, as the sanitizers can do neither; and those that compare the kernels of several
instruction sets, as there is one here. It takes about seven minutes on two idle cores.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build" / "sanitize"
LEFT_OUT = "not realtime and not slow"
NOT_RUN = "not memory and not fork and not every_instruction_set"
COUPLED = ["tests/test_threads.py", "tests/hardware/simulation", "tests/hardware/client/test_endpoint.py"]
# Tests by the sanitizers that they run under.
TESTS = {
    "thread": [
        *COUPLED, "tests/test_allocation.py",
        *(f"tests/hardware/client/test_{name}.py" for name in ("link_reader", "group")),
    ],
    "address,undefined": [
        *COUPLED, "tests/solvers", "tests/firmware", "tests/haptics/rendering",
        "tests/hardware/runner",
        *(f"tests/test_{name}.py" for name in ("verification", "optimality", "gradients", "allocation")),
        "tests/support/test_arrays.py", "tests/workspace/certification", "tests/workspace/sweep",
        *(f"tests/workspace/test_{name}.py" for name in ("interference", "capacity_margin", "structure_metrics")),
    ],
}  # fmt: skip
# The C++ library is there before the address sanitizer, which looks for its exceptions as it starts.
LIBRARIES = {"thread": ["libtsan.so"], "address,undefined": ["libasan.so", "libstdc++.so"]}
OPTIONS = {"thread": "halt_on_error=0", "address,undefined": "detect_leaks=0"}
PRELOADED = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("tensionlab._native", {library!r})
module = sys.modules["tensionlab._native"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
"""


def build(flags: str, folder: Path, kind: str = "Debug") -> Path:
    """Compile the extension for this processor with flags of the compiler, and return it."""
    words = [sys.executable, "-m", "nanobind", "--cmake_dir"]
    nanobind = subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()
    options = {
        "CMAKE_BUILD_TYPE": kind,
        "CMAKE_CXX_COMPILER": "g++",
        "CMAKE_CXX_FLAGS": flags,
        "CMAKE_MODULE_LINKER_FLAGS": flags,
        "nanobind_DIR": nanobind,
        "Python_EXECUTABLE": sys.executable,
        "TENSIONLAB_BUILDS": "native",
        "TENSIONLAB_PYTHON": "ON",
    }
    words = [f"-D{name}={value}" for name, value in options.items()]
    subprocess.run(
        ["cmake", "-S", ROOT, "-B", folder, "-G", "Ninja", *words], check=True, stdout=subprocess.DEVNULL
    )
    subprocess.run(["ninja", "-C", folder, "--quiet"], check=True)
    return next(folder.glob("_native*"))


def run(sanitizers: str, folder: Path, library: Path) -> tuple[int, int, int]:
    """Run the tests; return how many there were, how many failed, and how many reports came."""
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
    results = folder / "results.xml"
    results.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "--capture=sys", f"--junit-xml={results}"]
    command += ["-m", LEFT_OUT, "-k", NOT_RUN, *TESTS[sanitizers]]
    # Without random addresses, which GCC's thread sanitizer does not expect.
    ended = subprocess.run(["setarch", "-R", *command], cwd=ROOT, env={**os.environ, **environment}, check=False)
    # Without a summary it is a remark, as on a program that changes its stack.
    reports = [text for path in folder.glob("report.*") if "SUMMARY: " in (text := path.read_text())]
    for text in reports:
        print(text[:4000])
    if not results.exists():  # a sanitizer ended it
        return 0, 1, len(reports)
    suite = next(ET.parse(results).iter("testsuite"))
    failed = int(suite.attrib["failures"]) + int(suite.attrib["errors"])
    return int(suite.attrib["tests"]), max(failed, int(ended.returncode != 0)), len(reports)


def main() -> int:
    """Build and test under each sanitizer, and print what ran; 1 if there is a finding."""
    findings, lines = 0, []
    for sanitizers in TESTS:
        begin, folder = time.monotonic(), FOLDER / sanitizers.partition(",")[0]
        library = build(f"-fsanitize={sanitizers} -fno-sanitize-recover=all -g1", folder)
        built = time.monotonic()
        tests, failed, reports = run(sanitizers, folder, library)
        times = f"{built - begin:5.0f} s {time.monotonic() - built:5.0f} s"
        lines.append(f"{sanitizers:18} {tests:6} {failed:7} {reports:8} {times}")
        findings += failed + reports
    print("sanitizers          tests  failed  reports   build     run", *lines, f"{findings} findings", sep="\n")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
