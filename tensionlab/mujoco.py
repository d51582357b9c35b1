"""MuJoCo: the public names of `tensionlab.interop.mujoco`."""

from tensionlab.interop.mujoco import RigBody, TendonAllocator, gravity, structure_matrix

__all__ = ["RigBody", "TendonAllocator", "gravity", "structure_matrix"]
