"""What force to ask for: pure functions of how the hand moves.

contact: wall, magnet. texture: rough surfaces. shape: solids from distance fields. friction. ambient: viscous,
spring, water, vibration. tools: weight, recoil, bow. compose: sums and ramps. on_module: what a module renders by
itself.
"""

from tensionlab.haptics.effects.ambient import Spring, Vibration, Viscous, Water
from tensionlab.haptics.effects.compose import Ramp, Sum, WhileFresh
from tensionlab.haptics.effects.contact import Magnet, Plane, Wall
from tensionlab.haptics.effects.effect import Effect, Memory, Motion, Rendered, relative
from tensionlab.haptics.effects.fields import Box, Distance, Field, HalfSpace, Sphere
from tensionlab.haptics.effects.friction import Friction
from tensionlab.haptics.effects.on_module import (
    AxisImpedance,
    ModuleLimits,
    OnModule,
    along_cable,
    divide,
)
from tensionlab.haptics.effects.shape import Shape, VirtualCoupling
from tensionlab.haptics.effects.texture import Ripples, Texture
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
}
"""Every effect by the name that files and clients use."""
SOLIDS = {"sphere": Sphere, "box": Box, "half-space": HalfSpace}
"""What a shape may be, by the name that files and clients use; a sphere if they name none."""

__all__ = [
    "EFFECTS",
    "SOLIDS",
    "AxisImpedance",
    "Bow",
    "Box",
    "Distance",
    "Effect",
    "Field",
    "Friction",
    "HalfSpace",
    "Magnet",
    "Memory",
    "ModuleLimits",
    "Motion",
    "OnModule",
    "Plane",
    "Ramp",
    "Recoil",
    "Rendered",
    "Ripples",
    "Shape",
    "Sphere",
    "Spring",
    "Sum",
    "Texture",
    "Vibration",
    "VirtualCoupling",
    "Viscous",
    "Wall",
    "Water",
    "Weight",
    "WhileFresh",
    "along_cable",
    "divide",
    "relative",
]
