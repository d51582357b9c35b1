"""Command of a bridge: one client at a time, over all doors."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from tensionlab.errors import TensionlabError

SILENCE_S = 5.0
"""A commander that says nothing valid for so long, in s, loses its place."""


class FrameRefused(TensionlabError):  # noqa: N818 - what it is
    """A frame that is not taken: of a client that does not command, or of bodies that the rig does not have."""


@dataclass(eq=False)
class Commander:
    """A client that commands, or did.

    Attributes
    ----------
    who : str
        As others are told.
    heard : float
        When its latest valid message came, in s.
    dismissed : str
        Why it lost its place; empty while it has it.
    tell : callable
        Hears that, from any thread.
    """

    who: str
    heard: float
    tell: Callable[[str], None]
    dismissed: str = ""


@dataclass
class Command:
    """The place of who commands. Used by several threads."""

    _lock: threading.Lock = field(default_factory=threading.Lock)
    _holder: Commander | None = None

    def take(self, who: str, now: float, tell: Callable[[str], None]) -> Commander:
        """Give the place to a client, unless another one has it and is not silent.

        Raises
        ------
        FrameRefused
            Another one has it.
        """
        with self._lock:
            self.require_free(now)
            holder = self._holder
            taken = self._holder = Commander(who, now, tell)
        if holder is not None:
            self._send_away(holder, f"silent for {SILENCE_S:g} s: {who} commands now")
        return taken

    def require_free(self, now: float) -> None:
        """Refuse whoever does not command, while somebody else does.

        Raises
        ------
        FrameRefused
        """
        holder = self._holder
        if holder is not None and now - holder.heard < SILENCE_S:
            raise FrameRefused(
                f"another client commands; watch at /events, or wait until {holder.who} has gone or been "
                f"silent for {SILENCE_S:g} s"
            )

    def leave(self, commander: Commander) -> None:
        """Free the place, if it is this client's."""
        with self._lock:
            if self._holder is commander:
                self._holder = None

    def dismiss(self, reason: str) -> None:
        """Take the place from whoever has it, who is told the reason."""
        with self._lock:
            holder, self._holder = self._holder, None
        if holder is not None:
            self._send_away(holder, reason)

    @staticmethod
    def _send_away(holder: Commander, reason: str) -> None:
        holder.dismissed = reason
        holder.tell(reason)
