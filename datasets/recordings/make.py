"""Record the simulated validations of this folder again: ``python datasets/recordings/make.py [NAME ...]``."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
RIG = "datasets/rigs/bartels2026-validation.toml"
RECORDINGS = {
    "paper-like-simulated": [RIG],
    "paper-like-closed-form-simulated": [RIG, "--solver", "closed-form"],
    "paper-like-0.3m-simulated": ["datasets/rigs/bartels2026-validation-0.3m.toml"],
    "paper-like-floor-3-simulated": ["datasets/rigs/floor-3.toml"],
    "ideal-simulated": [RIG, "--preset", "ideal"],
}
"""What `tensionlab validate` is called with, by name."""


def main() -> None:
    """Run all, then take their recordings, so that each is of the same, unchanged commit."""
    names = sys.argv[1:] or list(RECORDINGS)
    (ROOT / "out").mkdir(exist_ok=True)
    for name in names:
        out = Path("out") / name
        shutil.rmtree(ROOT / out, ignore_errors=True)
        call = [sys.executable, "-m", "tensionlab", "validate", *RECORDINGS[name], "--out", str(out)]
        subprocess.run(call, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    for name in names:
        shutil.copyfile(ROOT / "out" / name / "forces-simulated.parquet", FOLDER / f"{name}.parquet")
        print(FOLDER / f"{name}.parquet")


if __name__ == "__main__":
    main()
