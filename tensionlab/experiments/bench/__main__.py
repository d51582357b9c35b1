"""The measuring process of `tensionlab.experiments.bench.run`: a plan in, the share that is done on stdout."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TextIO

from tensionlab.experiments.bench.run import Plan, measure_all


def main() -> None:
    """Measure what the first argument says."""
    order = json.loads(sys.argv[1])
    asked = order["plan"]
    for key in ("sets", "solvers"):
        asked[key] = None if asked[key] is None else tuple(asked[key])
    # Backends print what they like; only the shares may reach the process that reads them.
    with os.fdopen(os.dup(1), "w") as shares:
        os.dup2(2, 1)
        measure_all(Plan(**asked), Path(order["folder"]), order["call"], lambda done: _tell(shares, done))


def _tell(shares: TextIO, done: float) -> None:
    print(done, file=shares, flush=True)


if __name__ == "__main__":
    main()
