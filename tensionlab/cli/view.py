"""``tensionlab view``: a rig in the browser, to be designed."""

from __future__ import annotations

import threading
import webbrowser
from typing import Annotated

import typer

from tensionlab.cli.common.options import RigArgument
from tensionlab.cli.common.output import if_interrupted
from tensionlab.model.files import load_rig
from tensionlab.view.page import DesignPage
from tensionlab.view.server import PageServer


@if_interrupted("what was saved from the page is kept; the same command shows the file's rig again")
def view(
    rig: RigArgument,
    port: Annotated[int, typer.Option(help="Of the page; 0 takes a free one.", min=0, max=65535)] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Whether to open a browser.")] = True,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen at. Beyond this computer, the page's address has a token, which browsers need."
        ),
    ] = "127.0.0.1",
) -> None:
    """Design a rig in the browser.

    Modules, hand and force can be dragged; tensions, what is feasible and the workspace follow. Ctrl-C ends it.
    """
    page = DesignPage(load_rig(rig), PageServer(host, port), rig)
    try:
        typer.echo(f"{page.server.url} shows {page.loaded.name}; Ctrl-C ends it")
        if browser:
            webbrowser.open(page.server.url)
        threading.Event().wait()
    finally:
        page.close()
