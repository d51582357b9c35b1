"""Where bodies are, sent over OSC (UDP) as a tracker does: what `OscDoor` takes."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import suppress
from types import TracebackType
from typing import Self

from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError, MissingDependency


class OscTracker:
    """Sends places of bodies, whether or not anybody listens. A context manager, which closes the socket.

    Parameters
    ----------
    host, port : str, int
        Where to.

    Raises
    ------
    HardwareError
        If there is no such host.
    MissingDependency
        If python-osc is not installed.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            import pythonosc.osc_bundle_builder  # noqa: F401
        except ImportError as missing:
            raise MissingDependency(
                'OSC needs python-osc; pip install "tensionlab[haptics]" brings it'
            ) from missing
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise HardwareError(f"OSC cannot be sent to {host}, port {port}: {error.strerror}") from None
        family, kind, _, _, address = found[0]
        self._socket, self._address = socket.socket(family, kind), address
        self._socket.setblocking(False)

    def __enter__(self) -> Self:
        """Keep the socket open."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self._socket.close()

    def send(self, bodies: Mapping[str, Floats], when: float) -> None:
        """Send where bodies were, by name, in m: one bundle with a ``/body/NAME x y z`` for each.

        Its time tag is when they were there, in s since 1970: what is late on its way is not taken for slow.
        """
        from pythonosc.osc_bundle_builder import OscBundleBuilder
        from pythonosc.osc_message_builder import build_msg

        bundle = OscBundleBuilder(when)  # type: ignore[arg-type]  # which takes s, as its text says
        for name, place in bodies.items():
            bundle.add_content(build_msg(f"/body/{name}", place.tolist()))
        with suppress(OSError):  # nobody listens, or there is no room: the next one is soon
            self._socket.sendto(bundle.build().dgram, self._address)
