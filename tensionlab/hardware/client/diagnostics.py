"""Which modules are connected, which of them is which, and how fast their links are."""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tensionlab.errors import HardwareError, LinkTimeout
from tensionlab.hardware.client.links import has_bluetooth, serial_ports
from tensionlab.hardware.client.locks import holder
from tensionlab.hardware.client.module import ModuleClient, require_ready
from tensionlab.hardware.protocol.messages import Hello, Info, Ping, Pong, printable
from tensionlab.support.arrays import Floats

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
PING_TIMEOUT_S = 1.0  # a later answer counts as lost
MIN_SET_POINTS = 3  # sent within the time to live of one
MAX_LOSS = 1e-6  # largest probability that all of them are lost
MAX_RATE_HZ, MAX_BLUETOOTH_RATE_HZ = 1000.0, 100.0
# Start of the URL of a Bluetooth link; of a COM port, only the description tells.
BLUETOOTH_PREFIXES = ("bt://", "/dev/rfcomm", "/dev/cu.tensionlab-", "/dev/tty.tensionlab-")


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
    """Return the system's description of each port that may have a module, or of all ports, by URL.

    A module may be at a port by USB through one of the usual chips, or by Bluetooth.
    """
    descriptions = {}
    for port in serial_ports():
        about = "" if port.description == "n/a" else printable(port.description)
        is_module = port.vid in USB_VENDORS or has_bluetooth(port) or NAME_PREFIX in f"{port.device} {about}"
        if everything or is_module:
            descriptions[port.device] = about
    return descriptions | paired()


def paired() -> dict[str, str]:
    """Return the modules that Linux has paired by Bluetooth; other systems list them as serial ports."""
    printed = ""
    with suppress(OSError, subprocess.SubprocessError):  # also where there is no such program
        printed = subprocess.run(
            ["bluetoothctl", "devices", "Paired"], capture_output=True, text=True, timeout=5.0, check=True
        ).stdout
    devices = re.findall(rf"Device ((?:[0-9A-F]{{2}}:){{5}}[0-9A-F]{{2}}) ({NAME_PREFIX}\S*)", printed)
    return {f"bt://{address}/1": printable(name) for address, name in devices}


def find_all(urls: dict[str, str]) -> list[Found]:
    """Return the module at each of the `ports`; all are tried at once, but those in use are not opened."""

    def find(url: str) -> Found:
        if (user := holder(url)) is not None:
            return Found(url, urls[url], problem=f"in use by {user}", in_use=True)
        try:
            with ModuleClient(url, url) as client:
                return Found(url, urls[url], client.request(Hello(), Info, TIMEOUTS_S))
        except HardwareError as error:
            return Found(url, urls[url], problem="no answer" if isinstance(error, LinkTimeout) else str(error))

    with ThreadPoolExecutor(PARALLEL_PORTS) as threads:
        return list(threads.map(find, urls))


def identify(client: ModuleClient, begun: Callable[[], None]) -> None:
    """Arm a module, pulse its cable three times, and stop it; `begun` is called once it is armed.

    A `HardwareError` if it is not ready (`require_ready`), has a fault, releases its cable, or its link breaks.
    """
    info = client.hello()
    require_ready(client, info)
    client.stop()  # it may still be in TIMEOUT from an earlier run
    strong = min(info.tension_lower + PULSE_TENSION_N, info.tension_upper)
    client.arm()
    try:
        begun()
        for tension in (info.tension_lower, strong) * PULSES:
            end = client.link.clock() + PULSE_S
            while client.link.clock() < end:
                client.set_tension(tension)
                client.wait(SET_POINT_PERIOD_S)
                client.check()
    finally:
        client.stop()


def measure(client: ModuleClient, count: int, progress: Callable[[int], bool]) -> Floats:
    """Return the round-trip times in s of pings sent one after another; NaN of those that were lost.

    `progress` gets their number after each, and returns whether to continue.
    """
    times: list[float] = []
    for done in range(1, count + 1):
        began, trip = client.link.clock(), math.nan
        with suppress(LinkTimeout):
            client.request(Ping(done), Pong, (PING_TIMEOUT_S,))
            trip = client.link.clock() - began
        times.append(trip)
        if not progress(done):
            break
    return np.array(times)


def percentile(times: Floats, percent: float) -> float:
    """Return a percentile of the times of the pings that came back, in s; NaN if none did."""
    came = times[np.isfinite(times)]
    return float(np.percentile(came, percent, method="higher")) if came.size else math.nan


def safe_rates(times: Floats, ttl: float, *, bluetooth: bool) -> tuple[float, float] | None:
    """Return the lowest and highest safe rate of set-points, in Hz; None if no rate is safe.

    At least three set-points are sent within the time to live `ttl`, in s, less the 99th percentile of the one-way
    time (half the trip); more where the probability that all of them are lost would exceed 1e-6. At most 100 are
    sent per second over Bluetooth, and 1000 over other links.
    """
    available = ttl - percentile(times, 99.0) / 2
    if not available > 0.0:  # or NaN: no ping came back
        return None
    needed = MIN_SET_POINTS
    if (loss := float(np.isnan(times).mean())) > 0.0:
        needed = max(needed, math.ceil(math.log(MAX_LOSS) / math.log(loss)))
    lowest, highest = needed / available, MAX_BLUETOOTH_RATE_HZ if bluetooth else MAX_RATE_HZ
    return (lowest, highest) if lowest <= highest else None


def is_bluetooth(url: str) -> bool:
    """Return whether a link is by Bluetooth, as far as its URL or the system tells."""
    if url.upper().startswith("COM"):
        return any(has_bluetooth(port) for port in serial_ports() if port.device.upper() == url.upper())
    return url.startswith(BLUETOOTH_PREFIXES)
