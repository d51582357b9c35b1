"""Server of a page: viser's, behind a gate with a token."""

from __future__ import annotations

import contextlib
import io
import os
import secrets
import socket
import tempfile
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tensionlab.errors import InputError
from tensionlab.support.access import LOOPBACK
from tensionlab.viewer.gate import Gate, start

PANEL_PIXELS = 410.0
_starting = threading.Lock()


class PageServer:
    """Server of a page, ``viser``, behind its ``gate``; ``url`` is its address with the token."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen at an address, at a free port for 0; InputError if nothing can listen there."""
        _require_free(host, port)
        self._opened: Path | None = None
        self.gate = Gate(secrets.token_urlsafe(16), local=host in LOOPBACK)
        with _starting, contextlib.redirect_stdout(io.StringIO()):  # viser says where it is
            self.viser = start(host, port, self.gate)
        self.viser.scene.configure_default_lights(cast_shadow=False)  # half of the work without a graphics card
        name = f"[{host}]" if ":" in host else socket.gethostname() if host in ("0.0.0.0", "::") else host
        self.url = f"http://{name}:{self.viser.get_port()}/?token={self.gate.token}"

    def open_browser(self) -> None:
        """Open a browser at the page, by a file that only this user can read; it goes when a browser connects.

        All users see what programs are called with, so no browser is called with the token. The file is not in a
        hidden or temporary folder, which browsers in containers cannot read.
        """
        handle, name = tempfile.mkstemp(".html", "tensionlab-view-", Path.home())
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f'<meta http-equiv="refresh" content="0;url={self.url}">\n')
        self._opened = Path(name)
        self.viser.on_client_connect(lambda _: self._forget_opened())
        webbrowser.open(self._opened.as_uri())

    def _forget_opened(self) -> None:
        if self._opened is not None:
            self._opened.unlink(missing_ok=True)

    def close(self) -> None:
        """Close all connections, and listen no longer."""
        self._forget_opened()
        with contextlib.redirect_stdout(io.StringIO()):  # viser says so
            self.viser.stop()


def lay_out(gui: Any) -> None:
    """Put the panel next to the picture, so that neither hides the other."""
    gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(PANEL_PIXELS)


def entered(field: Any, act: Callable[[], None]) -> Any:
    """Call a function when something is entered in a browser, but not when the page shows it there."""

    async def changed(event: Any) -> None:
        if event.client is not None:
            act()

    field.on_update(changed)
    return field


def pressed(button: Any, act: Callable[[], None]) -> None:
    """Call a function when a button is pressed in a browser."""

    async def pressed(event: Any) -> None:
        act()

    button.on_click(pressed)


def _require_free(host: str, port: int) -> None:
    """Refuse an address at which nothing can listen; viser would take another port, or wait endlessly."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        socket.create_server((host, port), family=family).close()
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the page cannot be served at {host}, port {port} ({reason}); give another --host or --port"
        ) from None
