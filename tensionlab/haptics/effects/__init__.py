"""Haptic effects: pure functions from how the hand moves to the force on it.

Defaults are choices of this project unless a docstring names a source.
"""

from tensionlab.haptics.effects.ambient import Spring, Vibration, Viscous, Water
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
from tensionlab.haptics.effects.shape import SOLIDS, Box, Field, HalfSpace, Shape, Sphere, VirtualCoupling
from tensionlab.haptics.effects.tools import Bow, Recoil, Weight

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
    "HalfSpace",
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
