"""Error model of a rig: how far its hardware is from what the host believes.

Gain and play act in the plant, the bias where the cable meets the sensor, tilt and noise in the sensor; the host
works with the nominal positions. Cogging of the motor, which no publication gives, is left out. Cables are damped
critically: a spool that rings passes its dry friction again and again and stops anywhere within it, which is not a
play.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tensionlab.errors import InputError, RigError
from tensionlab.hardware.simulation.world import plant_parameters
from tensionlab.model.kinematics import exponential
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

# Hardware without errors; its spool and cable swing least with 23 N s/m.
IDEAL_PLANT = {"dry_friction": 0.0, "cogging": 0.0, "damping": 25.0}


@dataclass(frozen=True)
class ErrorModel:
    """Sizes of the errors of a kind of rig; all are standard deviations, but gain and play."""

    gain: float = 1.0  # true tension per commanded one, the same in all modules
    gain_spread: float = 0.0  # of its logarithm, from module to module
    # In N: a tension that the motor adds while it is driven, as with a wrong zero of the current sensor (0.12 N
    # are 0.04 A). Zeroing the force sensor with all motors off does not take it away.
    bias: float = 0.0
    position: float = 0.0  # of each coordinate of anchors and sensor, in m
    tilt: float = 0.0  # of the force sensor about each level axis, in degrees
    # In N: dry friction between motor and cable. A tension stops short of its set-point by the play, on the side
    # that it came from, and does not follow smaller changes.
    play: float = 0.0
    # Of each axis of the sensor, in N: a slow drift, because white noise would average to nothing in a second.
    noise: float = 0.0


PRESETS = {
    "ideal": ErrorModel(),
    "paper-like": ErrorModel(
        gain=1.28, gain_spread=0.08, bias=0.12, position=0.025, tilt=3.0, play=0.10, noise=0.03
    ),
}  # no errors; and errors of a size that makes a rig like the published one


def find_preset(name: str) -> ErrorModel:
    """Return one of `PRESETS`; raise `InputError` if there is none of that name."""
    if name not in PRESETS:
        raise InputError(f"no preset {name!r}; there are {', '.join(PRESETS)}")
    return PRESETS[name]


@dataclass(frozen=True, eq=False)
class RigErrors:
    """Errors of one rig; play and noise as in `ErrorModel`."""

    gains: Floats  # true tensions per commanded ones, (m,)
    biases: Floats  # (m,) in N
    anchors: Floats  # true less nominal, (m, 3) in m
    position: Floats  # of the sensor, true less nominal, (3,) in m
    tilt: Floats  # rotation (3, 3) from world axes into those that the sensor takes for them
    play: float = 0.0
    noise: float = 0.0


def draw_errors(model: ErrorModel, modules: int, seed: int) -> RigErrors:
    """Return random errors of a rig of `modules` modules; a seed draws the same ones, whatever their size."""
    random = np.random.default_rng(seed)
    gains = model.gain * np.exp(model.gain_spread * random.standard_normal(modules))
    biases = model.bias * random.standard_normal(modules)
    anchors = model.position * random.standard_normal((modules, 3))
    position = model.position * random.standard_normal(3)
    about_x, about_z = np.radians(model.tilt) * random.standard_normal(2)
    tilt = exponential(np.array([about_x, 0.0, about_z]))
    return RigErrors(gains, biases, anchors, position, tilt, model.play, model.noise)


def true_rig(rig: Rig, errors: RigErrors) -> Rig:
    """Return the rig with modules and sensor where they really are."""
    pairs = zip(rig.modules, errors.anchors, strict=True)
    modules = tuple(replace(module, anchor=module.anchor + offset) for module, offset in pairs)
    return replace(rig, modules=modules, home=rig.home + errors.position)


def true_plants(rig: Rig, errors: RigErrors) -> dict[str, dict[str, float]]:
    """Return the hardware parameters of each module, by its name."""
    plants = {}
    for module, gain in zip(rig.modules, errors.gains.tolist(), strict=True):
        torque_constant = gain * plant_parameters(module)["torque_constant"]
        plants[module.name] = IDEAL_PLANT | {"dry_friction": errors.play, "torque_constant": torque_constant}
    return plants


def require_point(rig: Rig) -> None:
    """Raise `RigError`, naming the rig and its kind, if it holds anything but a point in space."""
    if rig.kind != "point":
        wanted = 'the validation takes a point in space, kind "point"'
        raise RigError(f'rig "{rig.name}" is of kind "{rig.kind}"; {wanted}')
