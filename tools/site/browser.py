"""Headless Chromium, driven over its DevTools protocol: open pages, ask them things, take pictures of them."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.sync.connection import Connection

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-sync --disable-dev-shm-usage --hide-scrollbars --remote-debugging-port=0"
)
TIMEOUT_S = 60.0  # only what hangs takes so long
POLL_S = 0.02


def installed() -> str | None:
    """Return the path of a Chromium, if there is one."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Page:
    """Tab of the browser, and what it asked the network for and complained of since the last `open`."""

    def __init__(self, socket: Connection, session: str) -> None:
        self._socket, self._session, self._count = socket, session, 0
        self._loaded = False
        self.requests: list[str] = []
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol, and return its result.

        Raises
        ------
        RuntimeError
            If the browser refuses.
        """
        self._count += 1
        words = {"id": self._count, "method": method, "params": parameters, "sessionId": self._session}
        self._socket.send(json.dumps(words))
        while True:
            message = self._receive()
            if message.get("id") == self._count:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                result: dict[str, Any] = message["result"]
                return result

    def _receive(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self._socket.recv(timeout=TIMEOUT_S))
        match message.get("method"), message.get("params", {}):
            case "Page.loadEventFired", _:
                self._loaded = True
            case "Network.requestWillBeSent", {"request": {"url": url}}:
                self.requests.append(url)
            case "Runtime.exceptionThrown", {"exceptionDetails": details}:
                self.complaints.append(details.get("exception", {}).get("description", details["text"]))
            case "Log.entryAdded", {"entry": {"level": "error"} as entry}:
                self.complaints.append(f"{entry['text']} {entry.get('url', '')}")
        return message

    def open(self, url: str) -> None:
        """Open a page, and wait until it and all that it shows is there."""
        self.requests.clear()
        self.complaints.clear()
        self._loaded = False
        self.call("Page.navigate", url=url)
        while not self._loaded:
            self._receive()

    def width(self, pixels: int, height: int = 900) -> None:
        """Make the window so wide, as a phone below 600 pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=pixels,
            height=height,
            deviceScaleFactor=1,
            mobile=pixels < 600,
        )

    def ask(self, script: str) -> Any:
        """Return the value of an expression of JavaScript, or of its promise."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise RuntimeError(f"{script:.80}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def wait(self, script: str) -> Any:
        """Return the value of an expression as soon as it is true, on this page or the one that comes after it."""
        end = time.monotonic() + TIMEOUT_S
        while True:
            try:
                if value := self.ask(script):
                    return value
            except RuntimeError as error:
                if "navigated" not in str(error):
                    raise
            if time.monotonic() > end:
                raise TimeoutError(f"never true: {script}")
            time.sleep(POLL_S)

    def press(self, key: str, code: int, modifiers: int = 0) -> None:
        """Press a key; 2 is Ctrl."""
        for kind in ("rawKeyDown", "keyUp"):
            words = {
                "key": key,
                "code": f"Key{key.upper()}" if len(key) == 1 else key,
                "windowsVirtualKeyCode": code,
            }
            self.call("Input.dispatchKeyEvent", type=kind, modifiers=modifiers, **words)
            if kind == "rawKeyDown" and key == "Enter":
                self.call("Input.dispatchKeyEvent", type="char", text="\r", **words)

    def type(self, text: str) -> None:
        """Type text where the cursor is."""
        self.call("Input.insertText", text=text)

    def picture(self, path: Path, whole: bool = False) -> None:
        """Write a screenshot of what is in the window, or of the whole page."""
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))


@contextmanager
def browser() -> Iterator[Page]:
    """Start a browser, and give its page; it is gone at the end.

    Raises
    ------
    FileNotFoundError
        If there is no Chromium.
    """
    program = installed()
    if program is None:
        raise FileNotFoundError(f"no browser: install one of {', '.join(NAMES)}")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        command = [program, *OPTIONS.split(), f"--user-data-dir={folder}", "about:blank"]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
            try:
                address = _address(Path(folder) / "DevToolsActivePort")
                with connect(address, max_size=None, compression=None) as socket:
                    yield _page(socket)
            finally:
                running.terminate()


def _address(path: Path) -> str:
    """Return where the browser listens, which it writes into a file."""
    end = time.monotonic() + TIMEOUT_S
    while not (path.is_file() and path.read_text().count("\n") >= 1):
        if time.monotonic() > end:
            raise TimeoutError("the browser does not start")
        time.sleep(POLL_S)
    port, place = path.read_text().split("\n")[:2]
    return f"ws://127.0.0.1:{port}{place}"


def _page(socket: Connection) -> Page:
    """Attach to a new tab."""

    def ask(number: int, method: str, **parameters: Any) -> Any:
        socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (message := json.loads(socket.recv(timeout=TIMEOUT_S))).get("id") != number:
            pass
        return message["result"]

    target = ask(1, "Target.createTarget", url="about:blank")["targetId"]
    return Page(socket, ask(2, "Target.attachToTarget", targetId=target, flatten=True)["sessionId"])
