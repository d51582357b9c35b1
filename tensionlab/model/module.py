"""Parts of a rig: `Module`, `Platform` and `TensionLimits`, and the `KINDS` of rig."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import RigError, ShapeError
from tensionlab.support.arrays import Floats, as_floats, readonly_copy, tension_limits
from tensionlab.support.files.reading import MAX_NAME, brief
from tensionlab.support.formatting import format_range, format_vector

WORLD = "world"  # the frame that never moves
# Maximum coordinate of anything on a rig, in m: ten times the largest cable robot there is, and far from where
# squares and products of lengths, forces and torques lose digits that count.
MAX_LENGTH = 1e4
# Maximum tension and holding force, in N. Telescopes hang on cables of 1e6 N, and models of CASPR have 1e10 N
# where they mean no limit.
MAX_TENSION = 1e11
MAX_MASS = 1e8  # maximum mass of a platform, in kg: that of a large ship
OPTIONAL_NUMBERS = (
    ("brake", MAX_TENSION, "N"), ("newton_per_ampere", MAX_TENSION, "N/A"),
    ("spool_radius", MAX_LENGTH, "m"), ("pulley_radius", MAX_LENGTH, "m"),
    ("friction_coulomb", MAX_TENSION, "N"), ("friction_viscous", MAX_TENSION, "N s/m"),
    ("cable_stiffness", MAX_TENSION, "N"),
)  # fmt: skip
GRAVITY_M_S2 = 9.81  # acceleration by gravity, in m/s²
STANDARD_GRAVITY_M_S2 = 9.80665  # for weighing; the local value differs by up to 0.4 %


class Kind(NamedTuple):
    """Kind of rig: the dimension d of space and the degrees of freedom n of what the cables hold."""

    dimension: int
    dof: int
    has_position: bool = True  # or it turns about a fixed point

    @property
    def turns(self) -> int:
        """Number of components of a torque."""
        return self.dof - self.dimension * self.has_position

    @property
    def has_orientation(self) -> bool:
        """Whether the cables hold a body that can turn, rather than a point."""
        return self.turns > 0

    @property
    def force_unit(self) -> str:
        """Unit of forces and margins, which are torques where the platform turns alone."""
        return "N" if self.has_position else "N·m"

    @property
    def wrench_unit(self) -> str:
        """Units of all components of a wrench."""
        return "N and N·m" if self.dof > self.dimension else self.force_unit


KINDS = {
    "planar-point": Kind(dimension=2, dof=2),
    "point": Kind(dimension=3, dof=3),
    "planar": Kind(dimension=2, dof=3),
    "platform": Kind(dimension=3, dof=6),
    "spherical": Kind(dimension=3, dof=3, has_position=False),
}
"""The kinds of rig. A wrench is a force; "planar" adds the torque about z, "platform" three torques. "spherical"
has these alone, since its platform turns about a fixed point, which takes any force."""


class ArrayRecord:
    """Base of dataclasses that hold arrays: equal where all entries are."""

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return False
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]  # those of the subclass
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True, eq=False)
class Module(ArrayRecord):
    """Winch module with one cable: its position and tension limits. RigError names the module and the wrong key.

    Attributes
    ----------
    anchor : (d,) read-only array
        Point where the cable leaves the module or reaches its pulley, in the axes of ``frame``, in m.
    lower, upper : float
        Tension limits, in N; a cable cannot push, so ``0 <= lower <= upper``.
    attachment : (d,) read-only array
        End of the cable in platform axes, in m; zeros by default, and always for a point rig.
    frame : str
        "world", or the name of a body frame whose pose is given at run time.
    brake : float or None
        Largest tension that the one-way brake holds, in N; None without a brake.
    newton_per_ampere : float or None
        Tension per motor current, in N/A; None if not known.
    spool_radius : float or None
        Radius of the spool in m; None if not known.
    pulley_radius : float or None
        Radius of the swivelling pulley in m; None if the cable leaves from a fixed point.
    pulley_axis : (d,) read-only array or None
        Swivel axis of the pulley, along the incoming cable towards the anchor, in the axes of ``frame``. Any
        length; only with ``pulley_radius``.
    friction_coulomb, friction_viscous : float or None
        Friction of winch and pulley against the cable's motion, in N, and per speed in N s/m; None if not known.
    cable_stiffness : float or None
        Stiffness of the cable per strain, EA, in N: tension over relative stretch; None if not known.
    vibration_gain : (K, 2) read-only array or None
        Amplitude of a vibration at the end of the cable per commanded amplitude: rows of frequency in Hz, rising,
        and gain, as ``tensionlab characterise`` measures them; None if not known.

    Examples
    --------
    >>> import tensionlab as tl
    >>> module = tl.Module("floor-left", anchor=[-1.5, 0.0, 0.0], lower=0.5, upper=6.0, brake=186.0)
    >>> module.anchor
    array([-1.5,  0. ,  0. ])
    >>> tl.Module("floor-left", anchor=[-1.5, 0.0, 0.0], lower=7.0, upper=6.0)
    Traceback (most recent call last):
        ...
    tensionlab.errors.RigError: module "floor-left": key "lower" is 7.0, above "upper", which is 6.0
    """

    name: str
    anchor: Floats
    lower: float
    upper: float
    attachment: Floats | None = None
    frame: str = WORLD
    brake: float | None = None
    newton_per_ampere: float | None = None
    spool_radius: float | None = None
    pulley_radius: float | None = None
    pulley_axis: Floats | None = None
    friction_coulomb: float | None = None
    friction_viscous: float | None = None
    cable_stiffness: float | None = None
    vibration_gain: Floats | None = None

    def __post_init__(self) -> None:
        require_name(self.name, "module", "name", "give every module a name")
        here = f'module "{self.name}"'
        require_name(self.frame, here, "frame", f'give "{WORLD}" or the name of a body frame')
        anchor = vector(self.anchor, here, "anchor")
        attachment = vector(
            np.zeros(anchor.size) if self.attachment is None else self.attachment, here, "attachment"
        )
        if attachment.shape != anchor.shape:
            sizes = f'"attachment" has {attachment.size} coordinates and "anchor" {anchor.size}'
            raise RigError(f"{here}: key {sizes}; give both the same number")
        object.__setattr__(self, "anchor", anchor)
        object.__setattr__(self, "attachment", attachment)
        for key in ("lower", "upper"):  # a cable cannot push
            require_number(getattr(self, key), here, key, MAX_TENSION, "N")
        if self.lower > self.upper:
            raise RigError(f'{here}: key "lower" is {self.lower}, above "upper", which is {self.upper}')
        for key, highest, unit in OPTIONAL_NUMBERS:
            if getattr(self, key) is not None:
                require_number(getattr(self, key), here, key, highest, unit, above_zero=True)
        if self.vibration_gain is not None:
            object.__setattr__(self, "vibration_gain", vibration_gain(self.vibration_gain, here))
        if self.pulley_axis is None:
            if self.pulley_radius is not None:
                give = "give the direction in which the cable comes to the pulley"
                raise RigError(f'{here}: key "pulley_axis" is missing; {give}')
            return
        if self.pulley_radius is None:
            raise RigError(f'{here}: key "pulley_radius" is missing; give the radius of the pulley in m')
        axis = vector(self.pulley_axis, here, "pulley_axis")
        if axis.shape != anchor.shape or not axis.any():
            give = f"give a direction with {anchor.size} coordinates, not all zero"
            raise RigError(f'{here}: key "pulley_axis" is {brief(axis.tolist())}; {give}')
        object.__setattr__(self, "pulley_axis", axis)

    def __repr__(self) -> str:
        anchor = f"{format_vector(self.anchor)} m" + (f" on {self.frame}" if self.frame != WORLD else "")
        return f"<Module {self.name}: {anchor}, {format_range(self.lower, self.upper)} N>"

    def gain_at(self, frequency: float) -> float:
        """Return the gain of a vibration in Hz by ``vibration_gain``, interpolated; 1 if that is not known."""
        return 1.0 if self.vibration_gain is None else float(np.interp(frequency, *self.vibration_gain.T))

    def check_kind(self, kind: str) -> None:
        """Refuse coordinates that do not suit a kind of rig."""
        dimension, turns = KINDS[kind].dimension, KINDS[kind].has_orientation
        if self.anchor.size != dimension:
            needs = f"{self.anchor.size} coordinates; a {kind} rig needs {dimension}"
            raise RigError(f'module "{self.name}": key "anchor" has {needs}')
        if not turns and np.any(self.attachment):
            ends = f"in a {kind} rig all cables end at one point, so leave it out"
            raise RigError(f'module "{self.name}": key "attachment" is {self.attachment}; {ends}')


@dataclass(frozen=True, eq=False)
class Platform(ArrayRecord):
    """Platform that the cables hold: mass in kg, centre of mass and inertia. RigError names the wrong key.

    Attributes
    ----------
    com : (d,) read-only array or None
        Centre of mass in platform axes, in m; None for the reference point.
    inertia : (k, k) read-only array or None
        Inertia about the centre of mass in platform axes, in kg·m²; k = 3 in space, 1 in the plane. None if
        not known, and always for a point.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.Platform(mass=0.2).com is None
    True
    """

    mass: float
    com: Floats | None = None
    inertia: Floats | None = None

    def __repr__(self) -> str:
        com = "" if self.com is None else f", centre of mass at {format_vector(self.com)} m"
        inertia = "" if self.inertia is None else f", inertia {format_vector(np.diag(self.inertia))} kg·m²"
        return f"<Platform of {self.mass:g} kg{com}{inertia}>"

    def __post_init__(self) -> None:
        require_number(self.mass, "[platform]", "mass", MAX_MASS, "kg", above_zero=True)
        if self.com is not None:
            object.__setattr__(self, "com", vector(self.com, "[platform]", "com"))
        if self.inertia is not None:
            here = '[platform]: key "inertia"'
            try:
                inertia = readonly_copy(as_floats("inertia", self.inertia))
            except ShapeError as error:
                raise RigError(f"{here}: {error}") from None
            if inertia.size and np.abs(inertia).max() > MAX_MASS * MAX_LENGTH**2:
                raise RigError(f"{here} has an entry that no body has; correct it (kg·m²)")
            square = inertia.ndim == 2 and inertia.shape[0] == inertia.shape[1]
            if not (square and np.isfinite(inertia).all() and np.array_equal(inertia, inertia.T)):
                raise RigError(f"{here} must be a finite, square and symmetric matrix in kg·m²")
            if np.linalg.eigvalsh(inertia)[0] <= 0:
                raise RigError(f"{here} has a moment of zero or less; correct its entries (kg·m²)")
            object.__setattr__(self, "inertia", inertia)

    def check_kind(self, kind: str) -> None:
        """Refuse a centre of mass or an inertia that does not suit a kind of rig."""
        dimension, k = KINDS[kind].dimension, KINDS[kind].turns
        if self.com is not None and (not KINDS[kind].has_orientation or self.com.size != dimension):
            raise RigError(f'[platform]: key "com" does not suit a {kind} rig; give {dimension} numbers, or none')
        if self.inertia is not None and self.inertia.shape != (k, k):
            needs = f"needs ({k}, {k})" if k else "has none, so leave it out"
            raise RigError(f'[platform]: key "inertia" has shape {self.inertia.shape}; a {kind} rig {needs}')


def require_name(value: object, where: str, key: str, remedy: str) -> None:
    """Refuse what names nothing, or would not be one line on a terminal, in a picture, or in a file."""
    if not isinstance(value, str) or not value:
        raise RigError(f'{where}: key "{key}" is {"empty" if value == "" else brief(value)}; {remedy}')
    if not value.isprintable() or len(value) > MAX_NAME:
        raise RigError(f'{where}: key "{key}" is {brief(value)}; give at most {MAX_NAME} printable characters')


def require_number(
    value: float, where: str, key: str, highest: float, unit: str, *, above_zero: bool = False
) -> None:
    """Refuse what is not from zero, or above it, to a highest value."""
    if not (np.isfinite(value) and 0 <= value <= highest and (value or not above_zero)):
        lowest = "above zero" if above_zero else "0 or more"
        raise RigError(f'{where}: key "{key}" is {brief(value)}; give {lowest}, at most {highest:g} {unit}')


def require_up(up: object, dimension: int) -> None:
    """Refuse what is no axis of space, or of the plane, that can point up."""
    known = [*"xyz"[:dimension], *(f"-{axis}" for axis in "xyz"[:dimension])]
    if up not in known:
        raise RigError(f'key "up" is {brief(up)}; give the axis that points up: {", ".join(known)}')


def upward(up: str, dimension: int) -> Floats:
    """Return the unit vector (d,) along an axis that points up."""
    vector = np.zeros(dimension)
    vector["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    return vector


def vector(values: ArrayLike, where: str, key: str) -> Floats:
    """Turn the coordinates of one point into a read-only array, or say what is wrong with them."""
    try:
        point = readonly_copy(as_floats(key, values))
    except (TypeError, ValueError):
        raise RigError(f'{where}: key "{key}" is {brief(values)}; give a list of coordinates in m') from None
    if point.ndim != 1 or not np.isfinite(point).all():
        raise RigError(f'{where}: key "{key}" is {brief(values)}; give a flat list of finite coordinates in m')
    if point.size and np.abs(point).max() > MAX_LENGTH:
        raise RigError(f'{where}: key "{key}" is {brief(values)}; coordinates are in m, within {MAX_LENGTH:g}')
    return point


def vibration_gain(values: ArrayLike, where: str) -> Floats:
    """Turn rows of frequency and gain into a read-only array (K, 2), or say what is wrong with them."""
    try:
        rows = readonly_copy(as_floats("vibration_gain", values))
    except (TypeError, ValueError):
        rows = np.empty(0)
    table = rows.ndim == 2 and rows.shape[1] == 2 and len(rows) > 0 and np.isfinite(rows).all()
    if table and (rows > 0.0).all() and (np.diff(rows[:, 0]) > 0.0).all():
        return rows
    give = "give rows of frequency in Hz and gain, all above zero, by rising frequency"
    raise RigError(f'{where}: key "vibration_gain" is {brief(values)}; {give}')


@dataclass(frozen=True, eq=False)
class TensionLimits:
    """Minimum and maximum tension of each cable, (m,), in N. Read-only.

    ``lower == upper`` is allowed: the tension of such a cable is fixed.

    Examples
    --------
    >>> import tensionlab as tl
    >>> limits = tl.load_rig("bartels2026-validation").limits
    >>> limits.lower, limits.upper
    (array([0.5, 0.5, 0.5, 0.5]), array([6., 6., 6., 6.]))
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]

    def __post_init__(self) -> None:
        lower, upper = as_floats("lower", self.lower), as_floats("upper", self.upper)
        if lower.ndim != 1 or lower.shape != upper.shape:
            raise ShapeError(f"tension limits: lower has shape {lower.shape} and upper {upper.shape}; give (m,)")
        if lower.size == 0:
            raise ShapeError("tension limits: no cable; give at least one lower and one upper limit")
        lower, upper = tension_limits((lower, upper))
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    def __repr__(self) -> str:
        if np.ptp(self.lower) == np.ptp(self.upper) == 0.0:
            return f"<TensionLimits of {self.lower.size} cables: {self.lower[0]:.4g} to {self.upper[0]:.4g} N>"
        ends = f"lower {format_vector(self.lower)} N, upper {format_vector(self.upper)} N"
        return f"<TensionLimits of {self.lower.size} cables: {ends}>"

    def only(self, part: NDArray[np.bool_]) -> TensionLimits:
        """Return limits that leave all cables without tension, but those of ``part``, (m,) bool."""
        return TensionLimits(np.where(part, self.lower, 0.0), np.where(part, self.upper, 0.0))
