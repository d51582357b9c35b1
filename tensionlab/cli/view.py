"""``tensionlab view``: a rig in the browser, to be designed; or a run in progress, to be watched."""

from __future__ import annotations

import threading
from contextlib import closing
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import Browser, PagePort
from tensionlab.cli.common.output import if_interrupted, open_page
from tensionlab.errors import RigError
from tensionlab.hardware.sharing import RunWatcher, find_runs
from tensionlab.model.files import load_rig
from tensionlab.support.files.named import is_path
from tensionlab.viewer.design_page import DesignPage
from tensionlab.viewer.live import LivePage
from tensionlab.viewer.server import PageServer


def view(
    rig: Annotated[
        str | None, options.rig_argument("; with --live, that of the run, if there are several")
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Show the run in progress on this computer, and a button that stops it.")
    ] = False,
    port: PagePort = 0,
    browser: Browser = True,
    host: Annotated[
        str, typer.Option(help="Address to listen at. Browsers need the token that the page's address has.")
    ] = "127.0.0.1",
) -> None:
    """Design a rig in the browser, or watch a run there.

    Modules, hand and force can be dragged; tensions, what is feasible and the workspace follow. A run whose
    modules are simulated in its own process is shown by its --view. Ctrl-C ends it.
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
    with (
        if_interrupted("what was saved from the page is kept; the same command shows the file's rig again"),
        closing(page),
    ):
        open_page(page.server, page.rig.name, browser=browser)
        threading.Event().wait()


def _watcher(name: str | None) -> tuple[RunWatcher, str]:
    """Return the watcher of the run in progress, or of the one with that rig, and the name of its rig."""
    wanted = _names(name)
    runs = {each: each.info for each in find_runs() if each.info is not None}
    found = [each for each, info in runs.items() if not wanted or info.rig.name in wanted]
    for each in runs:
        if each not in found or len(found) > 1:
            each.close()
    if not found:
        what = "on modules that are not simulated in it" if name is None else f'with the rig "{name}"'
        output.print_error(
            f"none of your processes has a run in progress {what}; --view shows a run from its start"
        )
        raise typer.Exit(1)
    if len(found) > 1:
        programs = "; ".join(f"{runs[each].rig.name}: {runs[each].program}" for each in found)
        raise typer.BadParameter(f"{len(found)} runs are in progress; name the rig of one of them ({programs})")
    return found[0], runs[found[0]].rig.name


def _names(rig: str | None) -> set[str]:
    """Return the names of rigs that a word may mean: itself, and the name in the rig file."""
    if rig is None:
        return set()
    try:
        return {rig, load_rig(rig).name}
    except RigError:
        if is_path(rig, ".toml"):
            raise
        return {rig}  # of a rig that only its program knows
