"""The measuring process of `tensionlab.benchmark.run`: a plan in, and lines of JSON on stdout.

Each tells the share that is done, or the error that ended it, or the folder with the results.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path

from tensionlab.benchmark.run import Plan, measure_all
from tensionlab.errors import TensionlabError


def main() -> None:
    """Measure what the first argument says."""
    order = json.loads(sys.argv[1])
    asked = order["plan"]
    for key in ("sets", "solvers"):
        asked[key] = None if asked[key] is None else tuple(asked[key])
    # Backends print what they like; only what is told may reach the process that reads it.
    with os.fdopen(os.dup(1), "w") as told, suppress(BrokenPipeError):
        os.dup2(2, 1)

        def tell(key: str, value: object) -> None:
            print(json.dumps({key: value}), file=told, flush=True)

        try:
            folder = measure_all(
                Plan(**asked), Path(order["folder"]), order["call"], lambda done: tell("share", done)
            )
            tell("folder", str(folder))
        except TensionlabError as error:
            tell("error", str(error))


if __name__ == "__main__":
    main()
