"""PyTorch: the public names of `tensionlab.interop.torch`."""

from tensionlab.interop.torch import allocate

__all__ = ["allocate"]
