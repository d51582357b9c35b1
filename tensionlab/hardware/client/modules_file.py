"""Which module is reached where: a TOML file, written by `tensionlab simulate` or by hand.

::

    [modules]
    floor-1 = "socket://127.0.0.1:40001"         # a simulated one, over TCP
    floor-2 = "/dev/rfcomm0"                      # Bluetooth, bound on Linux
    top     = "/dev/cu.tensionlab-1a2b3c4d"       # Bluetooth on macOS; "COM5" on Windows

Names are those of the rig's modules; the links are what pyserial's ``serial_for_url`` opens.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from tensionlab.errors import HardwareError
from tensionlab.files.reading import brief, read_toml


def modules_to_toml(links: Mapping[str, str]) -> str:
    """Which file says where these modules are reached?"""
    import tomli_w

    return tomli_w.dumps({"modules": dict(links)})


def load_modules(path: str | Path) -> dict[str, str]:
    """Where is each module reached?

    Raises
    ------
    HardwareError
        Naming the file and the key: what is wrong and what to do.
    """
    document = read_toml(path, "a modules file (*.toml)", HardwareError)
    for key in document:
        if key != "modules":
            raise HardwareError(f'{path}: unknown key "{key:.40}"; the file has one table, [modules]')
    links = document.get("modules")
    if not isinstance(links, dict) or not links:
        raise HardwareError(f'{path}: no modules; write [modules] and lines such as name = "/dev/rfcomm0"')
    for name, link in links.items():
        if not isinstance(link, str) or not link:
            raise HardwareError(f'{path}: modules: "{name:.40}" is {brief(link)}; give a link as text, as "COM5"')
    repeated = [link for link, count in Counter(links.values()).items() if count > 1]
    if repeated:
        raise HardwareError(f"{path}: modules: {repeated[0]:.60} is there twice; give each its own")
    return dict(links)
