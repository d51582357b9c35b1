"""Rigs as models of MuJoCo: `rig_to_mjcf`."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as Xml

import numpy as np

from tensionlab.errors import RigError
from tensionlab.model import pose
from tensionlab.model.kinematics import in_space
from tensionlab.model.module import GRAVITY_M_S2, KINDS, WORLD, Module
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

MASS = 1.0  # mass held by the cables of a rig without a platform, in kg
RIM_SHARE = 0.2  # half the width of a pulley, of its radius
# Distance of the anchor's site before its pulley, as a share of the radius: MuJoCo accepts none on the rim itself.
OFF_RIM_SHARE = 1e-6
# The sliding joints of each kind of rig; a platform is free.
JOINTS = {"planar-point": "xy", "point": "xyz", "planar": "xy"}


def rig_to_mjcf(rig: Rig) -> str:
    """Return a rig as a model of MuJoCo.

    - Each cable is a spatial tendon from the site ``<module> anchor`` to the site ``<module> attachment``.
    - A pulley is a cylinder, over which the tendon runs, on the body ``<module> pulley``, which is turned to where
      the cable is at home: on a hinge, MuJoCo's tendons would slip off it, since its cylinders have no groove.
      `tensionlab.interop.mujoco.RigBody` turns it. Arcs are of less than half a round.
    - Each module is a motor on its tendon. Its control is the tension in N, within the limits of the module; the
      gear of -1 lets it only pull.
    - What the cables hold is the body ``platform``, with sliding joints for a point, a hinge as well in the plane,
      and a free joint in space. It starts at home, and the coordinates of its joints are those of the world.
    - Body frames are mocap bodies, ``frame <name>``, where they are at rest until you move them.

    Gravity is 9.81 m/s² against ``Rig.up``; none where the rig does not say which axis that is. Where it knows no
    mass, it is 1 kg; where it knows no inertia, it is that of a solid ball through the attachments.

    Source: Todorov, Erez and Tassa, "MuJoCo: A physics engine for model-based control", 2012, and the reference of
    its XML. RigError for a module whose limits are equal, or an inertia that no body has: MuJoCo takes neither.
    """
    rig.require_position("MuJoCo models")
    size = 0.005 * float(np.ptp(np.concatenate([rig.anchors, [rig.home]]), axis=0).max()) or 0.005
    root = Xml.Element("mujoco", model=rig.name)
    weightless = "" if rig.up else "No gravity: the rig does not say which axis is up."
    for text in (rig.description, rig.source, weightless):
        if text:
            root.append(Xml.Comment(f" {text.replace('--', '- -')} "))
    Xml.SubElement(root, "compiler", angle="radian")
    Xml.SubElement(root, "option", gravity=_row(in_space(-GRAVITY_M_S2 * rig.upward) if rig.up else np.zeros(3)))
    world = Xml.SubElement(root, "worldbody")
    frames = {WORLD: world}
    for name in rig.frames:
        frames[name] = Xml.SubElement(world, "body", name=f"frame {name}", mocap="true")
    for rest in rig.rest:
        frames[rest.name].set("pos", _row(in_space(rest.position)))
        _turn(frames[rest.name], rest.rotation)
    platform = _platform(world, rig, size)
    placed = pose.place_anchors(rig.modules, rig.anchors, rig.at_rest)
    away = pose.to_module_frames(rig.modules, rig.home + rig.attachments @ rig.home_matrix.T - placed, rig.at_rest)
    tendons = Xml.SubElement(root, "tendon")
    motors = Xml.SubElement(root, "actuator")
    for number, (module, attachment) in enumerate(zip(rig.modules, rig.attachments, strict=True)):
        if module.lower == module.upper:
            raise RigError(
                f'module "{module.name}": "lower" equals "upper", {module.lower}; MuJoCo needs a range, give one'
            )
        ends = {"anchor": (frames[module.frame], module.anchor), "attachment": (platform, attachment)}
        cable = Xml.SubElement(tendons, "spatial", name=module.name, width=_row([size / 3]))
        for end, (body, place) in ends.items():
            name = f"{module.name} {end}"
            site = Xml.SubElement(body, "site", name=name, pos=_row(in_space(place)), size=_row([size]))
            Xml.SubElement(cable, "site", site=name)
            if end == "anchor" and module.pulley_radius is not None:
                _pulley(body, site, cable, module, away[number])
        motor = Xml.SubElement(motors, "motor", name=module.name, tendon=module.name, gear="-1")
        motor.attrib.update(ctrllimited="true", ctrlrange=_row([module.lower, module.upper]))
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode") + "\n"


def _turn(body: Xml.Element, rotation: Floats | None) -> None:
    """Turn a body by axis times angle, (3,), or by an angle, (1,), in rad."""
    if rotation is not None:
        turn = rotation if rotation.size == 3 else np.array([0.0, 0.0, rotation[0]])
        angle = float(np.linalg.norm(turn))
        axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
        body.set("axisangle", _row([*axis, angle]))


def _platform(world: Xml.Element, rig: Rig, size: float) -> Xml.Element:
    """Add the body that the cables hold."""
    body = Xml.SubElement(world, "body", name="platform", pos=_row(in_space(rig.home)))
    _turn(body, rig.home_rotation)
    if rig.kind == "platform":
        Xml.SubElement(body, "freejoint", name="pose")
    else:
        for axis, place in zip(JOINTS[rig.kind], rig.home, strict=True):
            pointing = _row(float(axis == other) for other in "xyz")
            Xml.SubElement(body, "joint", name=axis, type="slide", axis=pointing, ref=_row([place]))
    if rig.kind == "planar":
        angle = 0.0 if rig.home_rotation is None else rig.home_rotation[0]
        Xml.SubElement(body, "joint", name="turn", type="hinge", axis="0 0 1", ref=_row([angle]))
    mass, com, inertia = _inertia(rig)
    moments = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    Xml.SubElement(body, "inertial", mass=_row([mass]), pos=_row(com), fullinertia=_row(moments))
    Xml.SubElement(body, "geom", type="sphere", size=_row([2 * size]), contype="0", conaffinity="0")
    return body


def _pulley(body: Xml.Element, site: Xml.Element, cable: Xml.Element, module: Module, away: Floats) -> None:
    """Add a pulley after the site of the anchor, turned to ``away``, (d,) in the body's axes."""
    radius, axis = float(module.pulley_radius or 0.0), in_space(np.asarray(module.pulley_axis))
    axis = axis / np.linalg.norm(axis)
    outward = in_space(away) - (in_space(away) @ axis) * axis
    if not outward.any():  # in line with the axis: any side will do
        outward = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    outward = outward / np.linalg.norm(outward)
    centre, name = radius * outward, f"{module.name} pulley"
    anchor = in_space(module.anchor)
    site.set("pos", _row(anchor - OFF_RIM_SHARE * radius * axis))
    swivel = Xml.SubElement(body, "body", name=name, pos=_row(anchor))
    across = np.cross(axis, outward)
    ends = np.concatenate([centre - RIM_SHARE * radius * across, centre + RIM_SHARE * radius * across])
    shape = {"type": "cylinder", "size": _row([radius]), "fromto": _row(ends)}
    Xml.SubElement(swivel, "geom", shape, name=name, contype="0", conaffinity="0")
    side = f"{module.name} rim"
    Xml.SubElement(swivel, "site", name=side, pos=_row(centre + 1.5 * radius * (axis - outward)))
    Xml.SubElement(cable, "geom", geom=name, sidesite=side)


def _inertia(rig: Rig) -> tuple[float, Floats, Floats]:
    """Return mass, centre of mass and inertia in space; assumed where the rig has none."""
    held = rig.platform
    mass = MASS if held is None else held.mass
    com = np.zeros(rig.dimension) if held is None or held.com is None else held.com
    if held is not None and held.inertia is not None:
        inertia = held.inertia if held.inertia.shape == (3, 3) else np.eye(3) * held.inertia
    else:
        radius = (
            float(np.linalg.norm(rig.attachments - com, axis=1).max()) if KINDS[rig.kind].has_orientation else 0.0
        )
        inertia = 0.4 * mass * (radius or 0.1) ** 2 * np.eye(3)
    moments = np.linalg.eigvalsh(inertia)
    if moments[2] > moments[0] + moments[1]:
        raise RigError(
            f'[platform]: key "inertia" has the principal moments {_row(moments)} kg·m²; no body has one '
            "above the sum of the others, so correct it"
        )
    return mass, in_space(com), inertia


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)  # no -0.0
