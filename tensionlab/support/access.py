"""Admission of clients by servers on this machine: host name, origin and token.

Any web page can make a browser send requests to this machine; these checks recognise them.
"""

from __future__ import annotations

import hmac
import re
from collections.abc import Callable, Sequence
from urllib.parse import parse_qs, urlsplit

Header = Callable[[str], Sequence[str]]  # returns the values of a header of a request, by its name

LOOPBACK = ("127.0.0.1", "localhost", "::1")
LOCAL = r"(localhost|127\.0\.0\.1|\[::1\])(:\d+)?"
# This machine as a browser names it, and its pages.
LOCAL_HOST, LOCAL_PAGES = re.compile(LOCAL), re.compile(f"https?://{LOCAL}")


def names_this_machine(header: Header) -> bool:
    """Return whether the requested host is this machine by its own name.

    Another page can have a name of its own lead here (DNS rebinding), but not this one.
    """
    return LOCAL_HOST.fullmatch("".join(header("Host"))) is not None


def loaded_by_other_page(header: Header) -> bool:
    """Return whether another site loads this as an image or a script; following a link is allowed."""
    elsewhere = "cross-site" in header("Sec-Fetch-Site") and "navigate" not in header("Sec-Fetch-Mode")
    return elsewhere and not header("Origin")


def knows_token(target: str, header: Header, token: str) -> bool:
    """Return whether a request has the token, in its query (``?token=``) or as ``Authorization: Bearer``."""
    bearer = "".join(header("Authorization")).removeprefix("Bearer ")
    given = parse_qs(urlsplit(target).query).get("token", [bearer])[0]
    # In constant time: the duration does not reveal how much of the token is right.
    return hmac.compare_digest(given.encode(errors="replace"), token.encode())
