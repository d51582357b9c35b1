"""``tensionlab view``: a rig in the browser, to be designed; or a run in progress, to be watched."""

from __future__ import annotations

import time
from contextlib import closing
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.output import if_interrupted, open_page
from tensionlab.cli.common.verbs import flag, option
from tensionlab.hardware.sharing import RunWatcher, find_runs
from tensionlab.model.files import load_rig
from tensionlab.support.files.named import is_path
from tensionlab.viewer.design_page import DesignPage
from tensionlab.viewer.live import LivePage
from tensionlab.viewer.server import PageServer

WAKE_PERIOD_S = 0.2  # a Ctrl-C that the system hands to another thread does not end a wait of this one


def view(
    rig: Annotated[str | None, options.rig_argument("; with --live, that of the run if there are several")] = None,
    live: Annotated[bool, flag("--live", "Show the run in progress, and a button that stops it.")] = False,
    port: options.PagePort = 0,
    browser: options.Browser = True,
    host: Annotated[str, option("HOST", "Address to listen at. Browsers need the page's token.")] = "127.0.0.1",
) -> None:
    """Design a rig in the browser, or watch a run there.

    Modules, hand and force can be dragged; tensions, what is feasible and the workspace follow. Ctrl-C ends it.
    """
    if live:
        watcher, name = _watcher(rig)
        shown = LivePage(watcher, PageServer(host, port))
        with if_interrupted("the run continues; the same command shows it again"), closing(shown):
            open_page(shown.server, f"the run of {name}", browser=browser)
            shown.serve(lambda: False)
        return
    if rig is None:
        raise typer.BadParameter("give a rig to design, or --live for a run in progress")
    page = DesignPage(load_rig(rig), PageServer(host, port), rig)
    kept = "what was saved from the page is kept; the same command shows the file's rig again"
    with if_interrupted(kept), closing(page):
        open_page(page.server, page.rig.name, browser=browser)
        while True:
            time.sleep(WAKE_PERIOD_S)


def _watcher(rig: str | None) -> tuple[RunWatcher, str]:
    """Return the watcher of the run in progress, or of the one with that rig, and the name of its rig."""
    name = load_rig(rig).name if rig is not None and is_path(rig, ".toml") else rig
    runs = {watcher: watcher.info for watcher in find_runs() if watcher.info is not None}
    selected = [watcher for watcher, info in runs.items() if name in (None, info.rig.name)]
    for watcher in runs:
        if watcher not in selected or len(selected) > 1:
            watcher.close()
    if not selected:
        rigs = ", ".join(sorted({info.rig.name for info in runs.values()}))
        what = f' of "{name}"; there are runs of {rigs}' if rigs else "; `run` and `serve` begin one"
        output.print_error(f"none of your processes has a run in progress{what}")
        raise typer.Exit(1)
    if len(selected) > 1:
        programs = "; ".join(f"{runs[watcher].rig.name}: {runs[watcher].program}" for watcher in selected)
        raise typer.BadParameter(f"{len(selected)} runs are in progress; name the rig of one of them ({programs})")
    return selected[0], runs[selected[0]].rig.name
