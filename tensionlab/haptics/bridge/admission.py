"""Admission to the bridge: who may connect, and the documents for a browser."""

from __future__ import annotations

from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

from tensionlab.support.access import LOCAL_PAGES, Header, knows_token, loaded_by_other_page, names_this_machine
from tensionlab.support.files.reading import brief

COMMAND_PATH, EVENTS_PATH, STATE_PATH = "/command", "/events", "/state"
PAGE_PATH, SCHEMA_PATH = "/", "/schema.json"
MAX_CLIENTS = 32  # simultaneous connections, to command or to watch
STATE_PAGE = Path(__file__).with_name("page.html")
# Headers of documents: they load nothing from elsewhere, and no other page reads or frames them.
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Connection": "close",
}


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
        JSON Schema of the messages, for a browser.
    """

    token: str | None = None
    pages: tuple[str, ...] = ()
    schema: str = ""

    def refuse(self, target: str, values: Header, clients: int) -> tuple[HTTPStatus, str] | None:
        """Return why a request is refused; None if it is not.

        Without a token, a page must be of this machine and must call it by its own name: another page can neither
        connect itself nor have its name lead here (DNS rebinding). ``target`` is path and query, ``values``
        returns the values of a header, ``clients`` is the number of connections.
        """
        for origin in values("Origin"):
            if not LOCAL_PAGES.fullmatch(origin) and origin not in self.pages:
                problem = f"pages of {brief(origin)} may not connect, unless it is given to --page"
                return HTTPStatus.FORBIDDEN, problem
        if loaded_by_other_page(values):
            return HTTPStatus.FORBIDDEN, "other pages may not load this; open it by its address"
        if self.token is not None:
            if not knows_token(target, values, self.token):
                return HTTPStatus.UNAUTHORIZED, "the token is missing or wrong"
        elif not names_this_machine(values):
            problem = f"the host {brief(''.join(values('Host')))} is not this machine; connect to 127.0.0.1"
            return HTTPStatus.FORBIDDEN, f"{problem}, or serve with a token"
        known = (PAGE_PATH, COMMAND_PATH, EVENTS_PATH, STATE_PATH, SCHEMA_PATH)
        if (path := urlsplit(target).path) not in known:
            return HTTPStatus.NOT_FOUND, f"nothing is at {brief(path)}; there are {', '.join(known)}"
        if clients >= MAX_CLIENTS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f"{MAX_CLIENTS} clients are connected already"
        return None

    def document(self, target: str) -> tuple[str, bytes] | None:
        """Return the type and content of the state page or the schema; None for other targets."""
        path = urlsplit(target).path
        if path == PAGE_PATH:
            return "text/html; charset=utf-8", STATE_PAGE.read_bytes()
        return ("application/schema+json", self.schema.encode()) if path == SCHEMA_PATH else None
