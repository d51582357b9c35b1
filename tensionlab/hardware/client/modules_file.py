"""File that names the links of modules.

A modules file is written by ``tensionlab simulate`` or by hand::

    [modules]
    floor-1 = "socket://127.0.0.1:40001"         # a simulated one, over TCP
    floor-2 = "/dev/rfcomm0"                      # Bluetooth, bound on Linux
    top     = "/dev/cu.tensionlab-1a2b3c4d"       # Bluetooth on macOS; "COM5" on Windows

Names are those of the rig's modules; the links are as `tensionlab.hardware.client.links.URL_KINDS` has them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from tensionlab.errors import HardwareError
from tensionlab.support.files.reading import MAX_NAME, brief, read_toml


def modules_to_toml(links: Mapping[str, str]) -> str:
    """Return the text of a modules file."""
    import tomli_w

    return tomli_w.dumps({"modules": dict(links)})


def load_modules(path: str | Path) -> dict[str, str]:
    """Return the link of each module of a modules file, by name.

    Parameters
    ----------
    path : path
        A TOML file; ``tensionlab simulate`` prints one.

    Raises
    ------
    HardwareError
        Naming the file and the key.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensionlab.hardware import load_modules
    >>> _ = Path("modules.toml").write_text('modules = {left = "socket://127.0.0.1:7000"}')
    >>> load_modules("modules.toml")
    {'left': 'socket://127.0.0.1:7000'}
    """
    document = read_toml(path, "a modules file (*.toml)", HardwareError)
    for key in document:
        if key != "modules":
            raise HardwareError(f'{path}: unknown key "{key:.40}"; the file has one table, [modules]')
    links = document.get("modules")
    if not isinstance(links, dict) or not links:
        raise HardwareError(f'{path}: no modules; write [modules] and lines such as name = "/dev/rfcomm0"')
    for name, link in links.items():
        if not name or not name.isprintable() or len(name) > MAX_NAME:
            raise HardwareError(
                f"{path}: modules: a name is {brief(name)}; give 1 to {MAX_NAME} characters, all of them printable"
            )
        if not isinstance(link, str) or not link:
            raise HardwareError(f'{path}: modules: "{name:.40}" is {brief(link)}; give a link as text, as "COM5"')
    repeated = [link for link, count in Counter(links.values()).items() if count > 1]
    if repeated:
        raise HardwareError(f"{path}: modules: {repeated[0]:.60} is there twice; give each its own")
    return dict(links)
