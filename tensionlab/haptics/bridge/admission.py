"""Who may connect to the bridge, and what a browser finds there: its state page, and the messages' schema."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

from tensionlab.support.access import LOCAL_PAGES, Header, knows_token, loaded_by_other_page, names_this_machine
from tensionlab.support.files.reading import brief

COMMAND_PATH, EVENTS_PATH, STATE_PATH = "/command", "/events", "/state"
PAGE_PATH, SCHEMA_PATH = "/", "/schema.json"
MAX_CLIENTS = 32  # connections at a time, to command or to watch
STATE_PAGE = Path(__file__).with_name("page.html")
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Connection": "close",
}
"""Of what a browser gets: it loads nothing from elsewhere, and no other page reads or frames it."""


@dataclass(frozen=True)
class Admission:
    """Rules by which clients are admitted.

    Attributes
    ----------
    token : str or None
        What a client must know.
    pages : tuple of str
        Origins of web pages, besides those of this machine, that may connect.
    schema : str
        Of the messages, as a browser gets it.
    """

    token: str | None = None
    pages: tuple[str, ...] = ()
    schema: str = ""

    def refuse(self, target: str, values: Header, clients: int) -> tuple[HTTPStatus, str] | None:
        """Return why a request is refused; None if it is not.

        Without a token, a page must be of this machine and must call it by its own name: another page can neither
        connect itself nor have its name lead here (DNS rebinding).

        Parameters
        ----------
        target : str
            Path and query.
        values : callable
            Returns the values of a header.
        clients : int
            How many there are already.
        """
        path = urlsplit(target).path
        for origin in values("Origin"):
            if not LOCAL_PAGES.fullmatch(origin) and origin not in self.pages:
                return (
                    HTTPStatus.FORBIDDEN,
                    f"pages of {brief(origin)} may not connect, unless it is given to --page",
                )
        if loaded_by_other_page(values):
            return HTTPStatus.FORBIDDEN, "other pages may not load this; open it by its address"
        if self.token is not None:
            if not knows_token(target, values, self.token):
                return HTTPStatus.UNAUTHORIZED, "the token is missing or wrong"
        elif not names_this_machine(values):
            host = brief("".join(values("Host")))
            return (
                HTTPStatus.FORBIDDEN,
                f"the host {host} is not this machine; connect to 127.0.0.1, or serve with a token",
            )
        if path not in (COMMAND_PATH, EVENTS_PATH, STATE_PATH, PAGE_PATH, SCHEMA_PATH):
            there = ", ".join((COMMAND_PATH, EVENTS_PATH, STATE_PATH, SCHEMA_PATH))
            return (
                HTTPStatus.NOT_FOUND,
                f"nothing is at {brief(path)}; there are {PAGE_PATH}, {there}",
            )
        if clients >= MAX_CLIENTS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f"{MAX_CLIENTS} clients are here already"
        return None

    def document(self, target: str) -> tuple[str, bytes] | None:
        """Return the state page or the schema, with its type, if a browser asks for it; else None."""
        path = urlsplit(target).path
        if path == PAGE_PATH:
            return "text/html; charset=utf-8", STATE_PAGE.read_bytes()
        return ("application/schema+json", self.schema.encode()) if path == SCHEMA_PATH else None
