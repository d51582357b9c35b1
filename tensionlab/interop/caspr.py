"""Robots of CASPR, the MATLAB library for cable-driven robots, as rigs: `load_caspr`.

A model of CASPR is a file of bodies and a file of cables; the latter holds one or more sets of cables.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import NamedTuple, NoReturn, cast
from xml.etree import ElementTree

import numpy as np

from tensionlab.errors import RigError
from tensionlab.model.module import KINDS, Module, Platform
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import brief, read_bytes
from tensionlab.support.formatting import format_count


class Element(ElementTree.Element):
    """Element of an XML file; ``source`` names the file in errors."""

    source: str

    def fail(self, problem: str) -> NoReturn:
        """Raise a RigError about this element."""
        name = self.get("name") or self.get("id")
        raise RigError(f"{self.source}: <{self.tag:.40}>{f' {brief(name)}' if name else ''}: {problem:.180}")

    def attribute(self, name: str) -> str:
        """Read an attribute that must be there."""
        if not self.get(name):
            self.fail(f'attribute "{name}" is missing; give it a value')
        return self.attrib[name]

    def all(self, tag: str = "*") -> list[Element]:
        """Return the children, or those of one tag."""
        return cast("list[Element]", self.findall(tag))

    def only(self, tag: str) -> Element:
        """Get the child of which there must be one."""
        elements = self.all(tag)
        if len(elements) != 1:
            self.fail(f"has {len(elements) or 'no'} elements <{tag}>; give it one")
        return elements[0]

    def number(self, tag: str) -> float:
        """Read the number in the child of a tag."""
        return float(self.only(tag).numbers(1)[0])

    def numbers(self, count: int, name: str | None = None) -> Floats:
        """Read ``count`` finite numbers from the text, or from an attribute."""
        text = self.text or "" if name is None else self.attribute(name)
        what = "its text" if name is None else f'attribute "{name}"'
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.empty(0)
        if values.size != count or not np.isfinite(values).all():
            self.fail(f"{what} is {brief(text.strip())}; give {format_count(count, 'finite number')}")
        return values


def read_xml(path: str | PathLike[str], root: str) -> Element:
    """Read an XML file as a tree of elements; RigError if it is not well-formed. No other file is read."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(Element))
    content = read_bytes(path, "an XML file", RigError)
    try:
        parser.feed(content)
        top = cast("Element", parser.close())
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the last two for encodings
        raise RigError(f"{path}: not well-formed XML: {error}; correct that line") from None
    for element in top.iter():
        cast("Element", element).source = str(path)
    if top.tag != root:
        top.fail(f"the root element must be <{root}>; give the file that has it")
    return top


class _Joint(NamedTuple):
    """Kind of rig that a joint of CASPR makes, the axes that it lies in, and that of its turns, if any."""

    kind: str
    axes: str
    normal: str = ""


JOINTS = {
    "P_XY": _Joint("planar-point", "xy"),
    "P_XZ": _Joint("planar-point", "xz"),
    "T_XYZ": _Joint("point", "xyz"),
    "PLANAR_XY": _Joint("planar", "xy", "+z"),
    "PLANAR_YZ": _Joint("planar", "yz", "+x"),
    "PLANAR_XZ": _Joint("planar", "xz", "-y"),
    "SPATIAL_EULER_XYZ": _Joint("platform", "xyz"),
    "S_EULER_XYZ": _Joint("spherical", "xyz"),
}  # the joints of CASPR whose bodies are rigs

STIFF = "cable_ideal"
ELASTIC = ("cable_linear_spring", "cable_vsd_torsion_spring", "cable_vsd_flexure_linear", "cable_vsd_polynomial")
PASSIVE = "cable_passive_linear_spring"
PULLEY = "base_rotating_pulley"


class _Cable(NamedTuple):
    element: Element
    name: str
    anchor: Floats
    attachment: Floats
    lower: float
    upper: float
    pulley_radius: float | None = None
    pulley_axis: Floats | None = None


def load_caspr(bodies: str | PathLike[str], cables: str | PathLike[str], cable_set: str | None = None) -> Rig:
    """Read a rig from two XML files of CASPR.

    A robot with one body, which moves in a plane or in space, or turns about a fixed point. The reference point is
    CASPR's, the origin of the body's joint; home is its initial position. The cables must hold its weight, as in
    CASPR, where its z is an axis of the rig. Elastic cables become stiff, and passive springs are left out: the
    description of the rig says so.

    Source: Lau, Eden, Tan and Oetomo, "CASPR: a comprehensive cable-robot analysis and simulation platform for the
    research of cable-driven parallel robots", 2016; what the elements mean is read off its program.

    The files are such as ``IPAnema_2_bodies.xml`` and ``IPAnema_2_cables.xml``; ``cable_set`` is the id of a
    ``<cable_set>``, the file's own default if left out. RigError names the file, the element and the attribute;
    also for robots that are no rig: several bodies, pulleys on screw drives, cables that run past several points.
    """
    links = read_xml(bodies, "bodies_system").only("links").all()
    if len(links) != 1:
        raise RigError(f"{bodies}: {len(links)} bodies; a rig has one, so give a model with one <link_rigid>")
    element = links[0].only("joint")
    joint = JOINTS.get(element.attribute("type"))
    if joint is None:
        element.fail(f'attribute "type" is {element.attribute("type")!r}; only {", ".join(JOINTS)} make a rig')
    kind, axes = KINDS[joint.kind], ["xyz".index(axis) for axis in joint.axes]
    initial = element.numbers(kind.dof, "q_initial")  # coordinates, then angles if it turns
    moved, angles = np.split(initial, [kind.dof - kind.turns])
    physical = links[0].only("physical")
    com = physical.only("com_location").numbers(3)
    chosen = _choose(read_xml(cables, "cables"), cable_set)
    parts = [_cable(cable, com) for cable in chosen.all() if cable.tag != PASSIVE]
    if not parts:
        chosen.fail("has no cables; give a set that has some")
    parent = links[0].only("parent").only("location").numbers(3)
    for part in parts:
        if not kind.has_orientation and not np.array_equal(part.attachment, parts[0].attachment):
            part.element.fail("ends elsewhere than the first cable, but the body can't turn; no rig is like that")
        away = [part.anchor - parent - part.attachment, *([] if part.pulley_axis is None else [part.pulley_axis])]
        if np.delete(away, axes, axis=1).any():
            part.element.fail(f"leaves the {joint.axes} plane in which the body moves; no rig is like that")
    point = np.zeros(3) if kind.has_orientation else parts[0].attachment
    up = {"xyz": "z", "xz": "y", "yz": "y"}.get(joint.axes)  # its z, if that is an axis of the rig
    return Rig(
        name=Path(bodies).stem.removesuffix("_bodies"),
        kind=joint.kind,
        modules=tuple(
            Module(
                name,
                part.anchor[axes],
                part.lower,
                part.upper,
                (part.attachment - point)[axes],
                pulley_radius=part.pulley_radius,
                pulley_axis=None if part.pulley_axis is None else part.pulley_axis[axes],
            )
            for name, part in zip(_names(parts), parts, strict=True)
        ),
        home=(parent + point)[axes] + (moved if kind.has_position else 0.0),
        home_rotation=None if kind.has_position else _turn(angles),
        platform=_platform(physical, com, joint),
        description=_describe(links[0], chosen, joint, kind.has_position and bool(angles.any())),
        up=up,
        required=Requirement(gravity=up is not None),
        source=f"CASPR (github.com/darwinlau/CASPR), {Path(bodies).name} and {Path(cables).name}",
    )


def _turn(angles: Floats) -> Floats | None:
    """Return axis times angle, (3,), of turns about the body's own x, y and z in a row; None without a turn."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("XYZ", angles).as_rotvec()) if angles.any() else None


def _choose(root: Element, wanted: str | None) -> Element:
    """Find a set of cables, or the default one."""
    name = root.attribute("default_cable_set") if wanted is None else wanted
    sets = {element.attribute("id"): element for element in root.all("cable_set")}
    if name not in sets:
        root.fail(f"has no <cable_set> with the id {name!r}; the ids are {', '.join(sets) or 'none'}")
    return sets[name]


def _cable(element: Element, com: Floats) -> _Cable:
    """Read a cable from the frame to the body; its attachment relative to the joint."""
    if element.tag not in (STIFF, *ELASTIC):
        element.fail(f"no cable of a rig; only {', '.join([STIFF, *ELASTIC])} are read")
    reference = element.attribute("attachment_reference")
    if reference not in ("joint", "com"):
        element.fail(f'attribute "attachment_reference" is {reference!r}; give "joint" or "com"')
    ends = {}
    radius, axis = None, None
    attachments = element.only("attachments")
    for end in attachments.all():
        if end.tag == PULLEY:
            ends[0.0] = end.only("fixed_location").numbers(3)
            radius, axis = end.number("pulley_radius"), end.only("cable_entry_vector").numbers(3)
        elif end.tag == "attachment":
            ends[end.number("link")] = end.only("location").numbers(3)
        else:
            end.fail(
                f"no attachment of a rig; only attachment and {PULLEY} are read, so choose another set of cables"
            )
    if len(attachments) != 2 or sorted(ends) != [0, 1]:
        attachments.fail("a cable of a rig has two attachments, to the links 0 and 1; no other is read")
    properties = element.only("properties")
    lower, upper = properties.number("force_min"), properties.number("force_max")
    attachment = ends[1] + com if reference == "com" else ends[1]
    return _Cable(element, element.attribute("name"), ends[0], attachment, lower, upper, radius, axis)


def _names(parts: list[_Cable]) -> list[str]:
    """Return names that differ: CASPR's, with the number of the cable where another one has it already."""
    names: list[str] = []
    for number, part in enumerate(parts, start=1):
        names.append(f"{part.name} ({number})" if part.name in names else part.name)
    return names


def _platform(physical: Element, com: Floats, joint: _Joint) -> Platform:
    """Read the mass and, of a body that turns, the centre of mass and the inertia about it; zeros are unknown."""
    mass = physical.number("mass")
    if not KINDS[joint.kind].has_orientation:
        return Platform(mass)
    table = physical.only("inertia")
    xx, yy, zz, xy, xz, yz = (table.number(f"I{name}") for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    about = table.attribute("ref")
    if about not in ("joint", "com"):
        table.fail(f'attribute "ref" is {about!r}; give "joint" or "com"')
    if about == "joint":  # Steiner
        inertia -= mass * (com @ com * np.eye(3) - np.outer(com, com))
    if joint.normal:
        turn = "xyz".index(joint.normal[1])
        inertia = inertia[turn : turn + 1, turn : turn + 1]
    axes = ["xyz".index(axis) for axis in joint.axes]
    return Platform(mass, com[axes] if com.any() else None, inertia if inertia.any() else None)


def _describe(link: Element, chosen: Element, joint: _Joint, turned: bool) -> str:
    """Say in a line what the rig is, and what of the model it leaves out."""
    notes = [f'{link.get("name") or "A robot"}, cable set "{chosen.attribute("id")}" of CASPR.']
    if len(joint.axes) == 2:
        torque = f"; torques are about {joint.normal}" if joint.normal else ""
        notes.append(f"X and Y are CASPR's {joint.axes[0]} and {joint.axes[1]}{torque}.")
    else:
        notes.append("Z is up.")
    if turned:
        notes.append("CASPR's initial pose is turned as well.")
    if any(cable.tag in ELASTIC for cable in chosen.all()):
        notes.append("Its elastic cables are stiff here.")
    if left_out := [cable.attribute("name") for cable in chosen.all(PASSIVE)]:
        notes.append(f"Without its passive springs ({', '.join(left_out)}): add their forces to the wrench.")
    return " ".join(notes)
