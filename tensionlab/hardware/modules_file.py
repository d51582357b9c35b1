"""Which module is reached where: a TOML file, written by `tensionlab simulate` or by hand.

::

    [modules]
    floor-1 = "socket://127.0.0.1:40001"         # a simulated one, over TCP
    floor-2 = "/dev/rfcomm0"                      # Bluetooth, bound on Linux
    top     = "/dev/cu.tensionlab-1a2b3c4d"       # Bluetooth on macOS; "COM5" on Windows

Names are those of the rig's modules; the links are what pyserial's ``serial_for_url`` opens.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

from tensionlab.errors import HardwareError


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
    try:
        document = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise HardwareError(f"{path}: cannot be read ({error}); give a modules file (*.toml)") from None
    except tomllib.TOMLDecodeError as error:
        raise HardwareError(f"{path}: not valid TOML: {error}; correct that line") from None
    for key in document:
        if key != "modules":
            raise HardwareError(f'{path}: unknown key "{key}"; the file has one table, [modules]')
    links = document.get("modules")
    if not isinstance(links, dict) or not links:
        raise HardwareError(f'{path}: no modules; write [modules] and lines such as name = "/dev/rfcomm0"')
    for name, link in links.items():
        if not isinstance(link, str) or not link:
            raise HardwareError(f'{path}: modules: "{name}" is {link!r}; give its link as text, such as "COM5"')
    repeated = {link for link in links.values() if list(links.values()).count(link) > 1}
    if repeated:
        raise HardwareError(f"{path}: modules: {', '.join(sorted(repeated))} is there twice; give each its own")
    return dict(links)
