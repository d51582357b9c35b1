"""Haptic effects: pure functions from how the hand moves to the force on it.

`Effect.render` takes a `Motion` and returns a `Rendered`. The stiff part of a `SplitEffect` is an `AxisImpedance`
for a module; `relative` is the motion between two hands. Defaults are choices of this project unless a docstring
names a source.

Examples
--------
>>> import numpy as np
>>> from tensionlab.haptics.effects import *
>>> hand = Motion(position=np.array([0.3, 0.0, -0.01]), velocity=np.array([0.1, 0.0, 0.0]), time=0.005)
>>> wall = Wall(Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)), stiffness=300.0)
>>> wall.module_side(hand).compression  # m, for the module whose cable lies along the normal
0.01
>>> rough = Texture(wall, Friction(dynamic=0.3), Ripples(period=0.008))
>>> soft = VirtualCoupling(stiffness=100.0)
>>> solids = Shape(Box(size=(1.0, 1.0, 0.1)), soft), Shape(Sphere(radius=0.32), soft)
>>> others = Magnet(), Vibration(), Water(), Weight(mass=0.5), Bow(), Recoil(shots=(0.0,)), Spring(), Viscous()
>>> for effect in (wall, rough, *solids, *others):
...     print(type(effect).__name__, effect.render(hand).force.round(2) + 0.0)  # N
Wall [0. 0. 3.]
Texture [0.71 0.   3.  ]
Shape [ 0.  0. -4.]
Shape [ 1.98  0.   -0.07]
Magnet [-0.1  0.   3. ]
Vibration [0.   0.   0.95]
Water [-0.12  0.    0.5 ]
Weight [ 0.   0.  -4.9]
Bow [-1.83  0.    0.06]
Recoil [ 0.  -5.5  0. ]
Spring [-9.   0.   0.3]
Viscous [-0.2  0.   0. ]
"""

from tensionlab.haptics.effects.ambient import Bow, Recoil, Spring, Vibration, Viscous, Water, Weight
from tensionlab.haptics.effects.contact import Friction, Magnet, Plane, Ripples, Texture, Wall
from tensionlab.haptics.effects.effect import (
    AxisImpedance,
    Effect,
    Memory,
    Motion,
    Rendered,
    SplitEffect,
    relative,
)
from tensionlab.haptics.effects.shape import SOLIDS, Box, Field, Shape, Sphere, VirtualCoupling

EFFECTS = {
    "wall": Wall,
    "magnetic": Magnet,
    "textured": Texture,
    "shaped": Shape,
    "vibrating": Vibration,
    "water": Water,
    "friction": Friction,
    "weight": Weight,
    "recoil": Recoil,
    "bow": Bow,
    "spring": Spring,
    "viscous": Viscous,
}  # every effect by the name that files and clients use

__all__ = [
    "EFFECTS",
    "SOLIDS",
    "AxisImpedance",
    "Bow",
    "Box",
    "Effect",
    "Field",
    "Friction",
    "Magnet",
    "Memory",
    "Motion",
    "Plane",
    "Recoil",
    "Rendered",
    "Ripples",
    "Shape",
    "Sphere",
    "SplitEffect",
    "Spring",
    "Texture",
    "Vibration",
    "VirtualCoupling",
    "Viscous",
    "Wall",
    "Water",
    "Weight",
    "relative",
]
