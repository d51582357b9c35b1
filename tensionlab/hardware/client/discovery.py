"""Discovery of modules: ports that may have one, who answers there, and a gentle pulse to tell which it is."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass

from tensionlab.errors import HardwareError, LinkTimeout, ModuleFault
from tensionlab.hardware.client.links import SerialPort, serial_ports
from tensionlab.hardware.client.locks import holder
from tensionlab.hardware.client.module import ModuleClient, require_ready
from tensionlab.hardware.protocol.codes import Code
from tensionlab.hardware.protocol.messages import Hello, Info, printable

# Makers of the chips that connect an ESP32 to USB.
USB_VENDORS = {0x10C4: "CP210x", 0x1A86: "CH340", 0x0403: "FTDI", 0x303A: "Espressif"}
NAME_PREFIX = "tensionlab-"  # start of a module's Bluetooth name; its serial number follows
# Wait for an answer per try, in s: a board that was reset by opening its port needs a second.
TIMEOUTS_S = (0.3, 0.5, 1.0)
PARALLEL_PORTS = 8
PULSES = 3
PULSE_TENSION_N = 0.5  # above the minimum tension
PULSE_S = 0.4  # duration of each pulse and of each pause
SET_POINT_PERIOD_S = 0.05


@dataclass(frozen=True)
class Found:
    """Port and what is there: the module's `info`, or else the `problem`, perhaps that it is `in_use`.

    `about` is the system's description of the port.
    """

    url: str
    about: str
    info: Info | None = None
    problem: str = ""
    in_use: bool = False


def ports(*, everything: bool = False) -> dict[str, str]:
    """Return the URLs of ports that may have a module, or of all, with the system's description of each."""
    found = {port.url: printable(port.about) for port in serial_ports() if everything or looks_like_ours(port)}
    return {**found, **paired()}


def looks_like_ours(port: SerialPort) -> bool:
    """Return whether a module may be at a port: by USB through one of the usual chips, or by Bluetooth."""
    return port.vendor in USB_VENDORS or port.bluetooth or NAME_PREFIX in f"{port.url} {port.about}"


def paired() -> dict[str, str]:
    """Return the modules that Linux has paired by Bluetooth; elsewhere they are among the serial ports."""
    if shutil.which("bluetoothctl") is None:
        return {}
    with suppress(OSError, subprocess.SubprocessError):
        printed = subprocess.run(
            ["bluetoothctl", "devices", "Paired"], capture_output=True, text=True, timeout=5.0, check=True
        ).stdout
        devices = re.findall(rf"Device ((?:[0-9A-F]{{2}}:){{5}}[0-9A-F]{{2}}) ({NAME_PREFIX}\S*)", printed)
        return {f"bt://{address}/1": printable(name) for address, name in devices}
    return {}


def find(url: str, about: str = "") -> Found:
    """Return the module at a port, if any; a port in use is left alone."""
    user = holder(url)
    if user is not None:
        return Found(url, about, problem=f"in use by {user}", in_use=True)
    try:
        with ModuleClient(url, url) as client:
            return Found(url, about, client.request(Hello(), Info, TIMEOUTS_S))
    except LinkTimeout:
        return Found(url, about, problem="no answer")
    except HardwareError as error:
        return Found(url, about, problem=str(error))


def find_all(urls: dict[str, str]) -> list[Found]:
    """Return the module at each port, as `ports` gives them; all are tried at the same time."""
    with ThreadPoolExecutor(PARALLEL_PORTS) as threads:
        return list(threads.map(lambda url: find(url, urls[url]), urls))


def identify(client: ModuleClient, begun: Callable[[], None]) -> None:
    """Arm a module, let its cable pulse three times, and stop it; `begun` is called once it is armed.

    A `HardwareError` if it is not ready (see `require_ready`) or has a fault, releases its cable meanwhile, or its
    link breaks.
    """
    info = client.hello()
    require_ready(client, info)
    client.stop()  # one that timed out in an earlier run is still in it
    strong = min(info.tension_lower + PULSE_TENSION_N, info.tension_upper)
    try:
        client.arm()
    except ModuleFault as fault:
        if fault.code is not Code.FAULT_PRESENT:
            raise
        advice = f"something is wrong with it, see `tensionlab module monitor {client.link.url}`"
        raise ModuleFault(f"{fault}; {advice}", fault.module, fault.code) from None
    try:
        begun()
        for _ in range(PULSES):
            _pull(client, info.tension_lower)
            _pull(client, strong)
    finally:
        client.stop()


def _pull(client: ModuleClient, tension: float) -> None:
    end = client.link.clock() + PULSE_S
    while client.link.clock() < end:
        client.set_tension(tension)
        client.wait(SET_POINT_PERIOD_S)
        client.check()
