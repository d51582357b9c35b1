"""Lab Streaming Layer: the public names of `tensionlab.interop.lsl`."""

from tensionlab.interop.lsl import LslStreams, require_lsl

__all__ = ["LslStreams", "require_lsl"]
