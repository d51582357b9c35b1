"""Headless Chromium of this machine, driven by Playwright: a page, and what it asks for and complains of."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from playwright.sync_api import ConsoleMessage, Page, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
SOFTWARE_WEBGL = (
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--disable-gpu-rasterization",  # Debian's Chromium would paint all text by WebGL, too
    "--no-sandbox",
    "--disable-dev-shm-usage",
)
TIMEOUT_S = 60.0  # only what hangs takes so long


class Seen(NamedTuple):
    """URLs that a page has asked for, and its errors, until they are cleared."""

    requests: list[str]
    complaints: list[str]


def installed() -> str | None:
    """Return the path of a Chromium, if there is one."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextmanager
def browser() -> Iterator[tuple[Page, Seen]]:
    """Start a browser, and give a page and what is seen of it; FileNotFoundError if there is no Chromium."""
    program, seen = installed(), Seen([], [])
    if program is None:
        raise FileNotFoundError(f"no browser: install one of {', '.join(NAMES)}")

    def note(message: ConsoleMessage) -> None:
        if message.type == "error":
            seen.complaints.append(f"{message.text} {message.location['url']}")

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=OPTIONS)
        page = chromium.new_page()
        page.set_default_timeout(1000.0 * TIMEOUT_S)
        page.on("request", lambda request: seen.requests.append(request.url))
        page.on("pageerror", lambda error: seen.complaints.append(str(error)))
        page.on("console", note)
        yield page, seen
        chromium.close()
