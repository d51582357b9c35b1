"""Statuses checked in exact rational arithmetic, by nothing but their definitions (`tensionlab.Allocation`)."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal
from fractions import Fraction

import numpy as np

from tensionlab.solvers.base import GRAZING, TOLERANCE, Policy, Status
from tensionlab.support.arrays import Floats

Exact = list[Fraction]
Matrix = list[Exact]

DIGITS = Context(prec=60)
ROUNDING = Fraction(1, 10**6)  # share of a tolerance that its own computation in floating point may move
ULP = Fraction(2) ** -52
FARTHER = "NEAREST, and a nearer wrench may be feasible"
# Least singular value over largest, below which the metric of the tension policy is not recomputed: its rank is a
# matter of rounding.
SINGULAR = 1e-6


def flaw(
    structure: Floats,
    wrench: Floats,
    limits: tuple[Floats, Floats],
    policy: Policy,
    found: tuple[int, Floats, Floats, float],
    feasible: Floats | None = None,
) -> str | None:
    """Say what is wrong with one verdict; None where it is right.

    Parameters
    ----------
    structure, wrench, limits : arrays
        Of one problem, (n, m), (n,) and two of (m,), in N. All numbers are taken as they are.
    policy : {"force", "tension", "direction"}
    found : (status, tensions, separation, scale)
        Of its allocation.
    feasible : (m,) array or None
        Tensions that may render the wrench; where they do exactly, NEAREST is wrong.
    """
    status, tensions, separation, scale = found
    lower, upper = limits
    if status not in (Status.EXACT, Status.NEAREST):
        return None
    if not ((lower <= tensions) & (tensions <= upper)).all():
        return "tensions beyond their limits"
    W, w, t = [_exact(row) for row in structure], _exact(wrench), _exact(tensions)
    a, b = _exact(lower), _exact(upper)
    rendered = [_dot(row, t) for row in W]
    error = [x - y for x, y in zip(w, rendered, strict=True)]
    # What a sum in double precision may be off by.
    size = sum((abs(x * y) for row in W for x, y in zip(row, t, strict=True)), sum(map(abs, w), Fraction(0)))
    slack = (len(w) + len(t)) * ULP * size
    tolerance = _tolerance(w) + slack
    if status == Status.EXACT:
        return None if _dot(error, error) <= tolerance**2 else "EXACT, and the wrench is missed"
    if feasible is not None and [_dot(row, _exact(feasible)) for row in W] == w:
        return "NEAREST, and the wrench is feasible"
    d = _exact(separation)
    reach = _support(W, d, a, b)
    if not _dot(d, w) > reach:
        return "NEAREST, and the direction does not separate"
    near = _tolerance(rendered) + slack
    if policy == "tension":
        return _tension_flaw(structure, W, d, _dot(d, w) - reach, error, rendered, slack)
    length = _root(_dot(d, d))
    if policy == "direction":
        line = _dot(d, w) / length, reach / length
        size = sum(
            (abs(x) * max(abs(p), abs(q)) for row in W for x, p, q in zip(row, a, b, strict=True)), Fraction(0)
        )
        allowed = Fraction(TOLERANCE) * max(Fraction(1), min(_root(_dot(w, w)), size))
        if not np.isnan(scale):
            off = [_dot(rendered, w) / _dot(w, w) * y - x for x, y in zip(rendered, w, strict=True)]
            another = _cleaned(structure, tensions, limits, off)
            grazed = _grazes(W, another, d, a, b, w, rendered, allowed)
            return _direction_flaw(line, w, rendered, near, allowed, grazed)
        along, beyond = _moved(line, allowed * (1 - ROUNDING))
        if not (beyond < 0 and beyond < along):
            return "NEAREST without a scale, and one may be feasible"
        # The nearest wrench has a proof of its own, the error without what free cables could still render of it.
        own = [error, _cleaned(structure, tensions, limits, error)]
        return None if any(_policy(W, x, a, b, w, error) <= near for x in own) else FARTHER
    return None if _policy(W, d, a, b, w, error) <= near else FARTHER


def _policy(W: Matrix, d: Exact, a: Exact, b: Exact, w: Exact, error: Exact) -> Fraction:
    """By how much may another wrench be nearer, as d shows."""
    length = _root(_dot(d, d))
    if not length:
        return Fraction(10**100)
    return _root(_dot(error, error)) - (_dot(d, w) - _support(W, d, a, b)) / length


def _cleaned(structure: Floats, tensions: Floats, limits: tuple[Floats, Floats], error: Exact) -> Exact:
    play = 1e-6 * np.abs(tensions).max()
    free = structure[:, (tensions - limits[0] > play) & (limits[1] - tensions > play)]
    d = np.array([float(x) for x in error])
    for _ in range(2):
        d -= free @ np.linalg.lstsq(free, d, rcond=1e-8)[0]
    return _exact(d)


def _tension_flaw(
    structure: Floats, W: Matrix, d: Exact, gap: Fraction, error: Exact, rendered: Exact, slack: Fraction
) -> str | None:
    sigma = np.linalg.svd(structure, compute_uv=False)
    if len(sigma) < len(W) or not sigma[-1] > SINGULAR * sigma[0]:
        return None
    gram = [[_dot(row, other) for other in W] for row in W]
    distance = _root(_dot(error, _solved(gram, error)))
    pull = [_dot(d, column) for column in zip(*W, strict=True)]
    tolerance = Fraction(TOLERANCE) * max(Fraction(1), _root(_dot(rendered, _solved(gram, rendered))))
    slack *= Fraction(float(1 / sigma[-1]))
    if distance - gap / _root(_dot(pull, pull)) <= tolerance * (1 + ROUNDING) + slack:
        return None
    return "NEAREST, and tensions nearer to equilibrium may be feasible"


def _moved(line: tuple[Fraction, Fraction], allowed: Fraction) -> tuple[Fraction, Fraction]:
    """``s along <= reach``, where s w may be missed by what is allowed at s = 1, and by nine tenths of it at 0."""
    return line[0] - allowed / 10, line[1] + allowed * 9 / 10


def _grazes(
    W: Matrix, normal: Exact, d: Exact, a: Exact, b: Exact, w: Exact, rendered: Exact, allowed: Fraction
) -> bool:
    """Whether w grazes the face of a normal, at which the rendered wrench is, too; d makes no difference to it."""
    length = _root(_dot(w, w))
    excess = _dot(normal, w) - Fraction(999, 1000) * Fraction(GRAZING) * _root(_dot(normal, normal)) * length
    if excess > 0:
        normal = [x - excess / _dot(d, w) * y for x, y in zip(normal, d, strict=True)]
    size = _root(_dot(normal, normal))
    gap = _support(W, normal, a, b) - _dot(normal, rendered)
    return gap <= allowed * size and abs(_dot(normal, w)) <= Fraction(GRAZING) * (1 + ROUNDING) * size * length


def _direction_flaw(
    line: tuple[Fraction, Fraction], w: Exact, rendered: Exact, near: Fraction, allowed: Fraction, grazed: bool
) -> str | None:
    """Say what is wrong with the largest scale; more may be missed if w grazes the separating face or another."""
    length = _root(_dot(w, w))
    scale = _dot(rendered, w) / _dot(w, w)
    share = min(Fraction(1), max(Fraction(0), 2 - 2 * line[0] / length / Fraction(GRAZING)))
    off = [x - scale * y for x, y in zip(rendered, w, strict=True)]
    if _root(_dot(off, off)) > max(near, allowed * (1 + ROUNDING) if share or grazed else near):
        return "NEAREST, and the direction is not kept"
    along, reach = _moved(line, share * allowed * Fraction(98, 100) * (1 - ROUNDING))
    more = scale + (near + _root(_dot(off, off)) * line[0] / length) / length
    if more * along >= reach * (1 - ROUNDING):
        return None
    return "NEAREST, and more of the direction may be feasible"


def _exact(numbers: Floats) -> Exact:
    return [Fraction(float(x)) for x in numbers]


def _dot(x: Sequence[Fraction], y: Sequence[Fraction]) -> Fraction:
    terms = [(p.numerator * q.numerator, p.denominator * q.denominator) for p, q in zip(x, y, strict=True)]
    common = max((below for _, below in terms), default=1)
    if any(common % below for _, below in terms):
        return sum((Fraction(*term) for term in terms), Fraction(0))
    # Denominators of floats are powers of two: one fraction is made at the end, not one for each term.
    return Fraction(sum(above * (common // below) for above, below in terms), common)


def _support(W: Matrix, d: Exact, lower: Exact, upper: Exact) -> Fraction:
    """Most of ``d·W t`` inside the limits."""
    pulls = [_dot(d, column) for column in zip(*W, strict=True)]
    return sum((max(p * a, p * b) for p, a, b in zip(pulls, lower, upper, strict=True)), Fraction(0))


def _tolerance(wrench: Exact) -> Fraction:
    return Fraction(TOLERANCE) * max(Fraction(1), _root(_dot(wrench, wrench))) * (1 + ROUNDING)


def _root(square: Fraction) -> Fraction:
    """Square root to 60 digits."""
    quotient = DIGITS.divide(Decimal(square.numerator), Decimal(square.denominator))
    return Fraction(DIGITS.sqrt(quotient))


def _solved(matrix: Matrix, right: Exact) -> Exact:
    """Solution of ``matrix x = right``, by elimination; the matrix is positive definite."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k, pivot in enumerate(rows):
        for row in rows[k + 1 :]:
            factor = row[k] / pivot[k]
            row[:] = [x - factor * y for x, y in zip(row, pivot, strict=True)]
    found: Exact = []
    for k in reversed(range(len(rows))):
        found.insert(0, (rows[k][-1] - _dot(rows[k][k + 1 : -1], found)) / rows[k][k])
    return found
