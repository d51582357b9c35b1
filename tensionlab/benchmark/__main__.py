"""The benchmark's own process, of `tensionlab.benchmark.run`: a plan as argument, and lines of JSON on stdout.

Each has the share that is done, or the error that ended it, or the folder with the results.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path

from tensionlab.benchmark.run import Plan, measure_here
from tensionlab.errors import TensionlabError


def main() -> None:
    """Run the benchmark of the first argument."""
    order = json.loads(sys.argv[1])
    plan = order["plan"]
    for key in ("sets", "solvers"):
        plan[key] = None if plan[key] is None else tuple(plan[key])
    # Backends print to stdout as well; only messages may reach the process that reads it.
    with os.fdopen(os.dup(1), "w") as messages, suppress(BrokenPipeError):
        os.dup2(2, 1)

        def send(key: str, value: object) -> None:
            print(json.dumps({key: value}), file=messages, flush=True)

        try:
            what, folder = Plan(**plan), Path(order["folder"])
            send("folder", str(measure_here(what, folder, order["call"], lambda done: send("share", done))))
        except TensionlabError as error:
            send("error", str(error))


if __name__ == "__main__":
    main()
