"""Which modules are there? Ports that look like ours are asked; those in use are left alone."""

from __future__ import annotations

import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass

from tensionlab.errors import HardwareError, LinkTimeout
from tensionlab.hardware.client.links import SerialPort, serial_ports
from tensionlab.hardware.client.locks import holder
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import Hello, Info, printable

BRIDGES = {0x10C4: "CP210x", 0x1A86: "CH340", 0x0403: "FTDI", 0x303A: "Espressif"}
"""Makers of the chips by which an ESP32 hangs on USB."""
NAME = "tensionlab-"
"""What the Bluetooth name of a module begins with; its serial number follows."""
TIMEOUTS_S = (0.3, 0.5, 1.0)
"""How long each try waits for an answer, in s: a board that was reset by the opening needs a second."""
AT_ONCE = 8
"""Ports that are asked at the same time."""


@dataclass(frozen=True)
class Found:
    """What is at a port?

    Attributes
    ----------
    url : str
    about : str
        What the system says of the port.
    info : Info or None
        What the module says of itself.
    problem : str
        Why there is no `info`; empty if there is.
    in_use : bool
        Whether that is because somebody has it.
    """

    url: str
    about: str
    info: Info | None = None
    problem: str = ""
    in_use: bool = False


def ports(*, everything: bool = False) -> dict[str, str]:
    """Which ports could have a module, and what does the system say of them?

    Parameters
    ----------
    everything : bool
        Whether to take all serial ports, and not only those that look like a module's.
    """
    found = {port.url: printable(port.about) for port in serial_ports() if everything or looks_like_ours(port)}
    return {**found, **paired()}


def looks_like_ours(port: SerialPort) -> bool:
    """Whether a module may be there: by USB through one of the usual chips, or by Bluetooth."""
    bluetooth = "/dev/rfcomm" in port.url or port.hardware.startswith("BTHENUM")
    return port.vendor in BRIDGES or bluetooth or NAME in f"{port.url} {port.about}"


def paired() -> dict[str, str]:
    """Which modules does Linux know by Bluetooth? Elsewhere they are among the serial ports."""
    if shutil.which("bluetoothctl") is None:
        return {}
    with suppress(OSError, subprocess.SubprocessError):
        told = subprocess.run(
            ["bluetoothctl", "devices", "Paired"], capture_output=True, text=True, timeout=5.0, check=True
        ).stdout
        devices = re.findall(rf"Device ((?:[0-9A-F]{{2}}:){{5}}[0-9A-F]{{2}}) ({NAME}\S*)", told)
        return {f"bt://{address}/1": printable(name) for address, name in devices}
    return {}


def ask(url: str, about: str = "") -> Found:
    """Which module is at a port, if any?"""
    taken = holder(url)
    if taken is not None:
        return Found(url, about, problem=f"in use by {taken}", in_use=True)
    try:
        with ModuleClient(url, url) as client:
            return Found(url, about, client.request(Hello(), Info, TIMEOUTS_S))
    except LinkTimeout:
        return Found(url, about, problem="no answer")
    except HardwareError as error:
        return Found(url, about, problem=str(error))


def ask_all(urls: dict[str, str]) -> list[Found]:
    """Which module is at each of these ports? All are asked at the same time; what `ports` gave."""
    with ThreadPoolExecutor(AT_ONCE) as threads:
        return list(threads.map(lambda url: ask(url, urls[url]), urls))
