"""Tensions of four cables for a force, by the library in C: `python allocate_ctypes.py libtensionlab.so`."""

import ctypes
import sys

Array3, Array4, Array6, Array12 = (ctypes.c_double * size for size in (3, 4, 6, 12))


class Result(ctypes.Structure):
    """What is proved of the tensions: `tensionlab_result` of tensionlab.h."""

    _fields_ = (
        ("wrench", Array6),
        ("separation", Array6),
        ("residual", ctypes.c_double),
        ("scale", ctypes.c_double),
        ("iterations", ctypes.c_int),
    )


library = ctypes.CDLL(sys.argv[1])
side, front = 0.615457, 0.492366
structure = Array12(-side, side, -side, side, -side, -side, side, side, -front, -front, -front, -front)
tensions, result = Array4(), Result()
for wrench in (Array3(1.0, 0.5, -5.0), Array3(6.0, 0.0, -4.0)):
    limits = Array4(0.5, 0.5, 0.5, 0.5), Array4(6.0, 6.0, 6.0, 6.0)
    status = library.tensionlab_allocate(
        3, 4, structure, wrench, *limits, None, None, 0, tensions, ctypes.byref(result)
    )
    print(["exact", "nearest"][status], *(f"{tension:.3f}" for tension in tensions))
