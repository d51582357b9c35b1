"""Who takes part: every solver of the house through the interface, and every peer on the plain program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from tensionlab.benchmark.daqp_direct import DirectDaqp
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers import make
from tensionlab.solvers.base import POLICIES, Nearest, Solver
from tensionlab.solvers.convex import PlainConvex
from tensionlab.solvers.newton import Newton
from tensionlab.solvers.peer import Peer
from tensionlab.solvers.quadratic import BACKENDS, TIGHT, PlainProgram
from tensionlab.solvers.selection import every_solver

Setting = Literal["proved", "default", "tight"]
LEAST_SQUARES = Newton.objective
"""The objective of all problem sets."""
PEERS = ("daqp", *(f"qpsolvers:{backend}" for backend in BACKENDS), "cvxpy:plain")
"""The peers by name: DAQP called directly, each backend through qpsolvers, and cvxpy."""
PROGRAMS = ("qp", "cvxpy")
"""Families of the house that wrap peers. They add a policy, so by default they run where it is needed."""
POLICY_PROGRAMS = ("qp:clarabel", "qp:daqp", "cvxpy")
"""Of those families, the ones that run by default where wrenches may be out of reach."""


@dataclass(frozen=True)
class Contestant:
    """A solver with a setting.

    Attributes
    ----------
    solver : str
        A name of `tensionlab.SOLVERS`, or of `PEERS`.
    setting : {"proved", "default", "tight"}
        Of the house: through the interface, the answer measured and proved. A peer: its defaults, or as
        accurate as its options make it.
    nearest : str or None
        The policy; None if it honours none.
    objective : str
        What it minimises.
    missing : str
        Why it cannot take part; empty if it can.
    """

    solver: str
    setting: Setting
    nearest: Nearest | None
    objective: str
    missing: str = ""

    @property
    def comparable(self) -> bool:
        """Whether it has the objective of the problem sets, so that it should find the optimum."""
        return self.objective == LEAST_SQUARES

    def make(self) -> Solver | Peer:
        """Make it."""
        return make(self.solver) if self.setting == "proved" else _peer(self.solver, self.setting)


def contestants(
    reachable: Literal["all", "none", "mixed"], solvers: Sequence[str] | None = None
) -> list[Contestant]:
    """Who takes part in a problem set?

    Where every wrench is within reach a solver runs once, with the policy that is its own; elsewhere it runs
    with each policy that it honours. Peers run at their defaults and, if they have such options, tight.

    Parameters
    ----------
    reachable : {"all", "none", "mixed"}
        Which wrenches of the set can be rendered.
    solvers : sequence of str, optional
        Names as in `tensionlab.SOLVERS` and `PEERS`; None for everyone. A family of the house by its bare name
        is its default variant.

    Raises
    ------
    UnknownSolver
        If there is no such name.
    """
    installed = every_solver()
    if solvers is None:
        programs = () if reachable == "all" else POLICY_PROGRAMS
        names = [name for name in installed if name.partition(":")[0] not in PROGRAMS or name in programs]
        names += PEERS
    else:
        names = list(dict.fromkeys(solvers))
    found: list[Contestant] = []
    for name in names:
        if name in PEERS:
            found += _peers(name)
            continue
        try:
            solver = make(name)
        except UnknownSolver as error:
            said = str(error).partition(";")[0]
            raise UnknownSolver(
                f"{said}; `tensionlab solvers` lists solvers, and peers are {', '.join(PEERS)}"
            ) from None
        missing = "" if installed.get(name, True) else "not installed"
        policies = solver.policies[: 1 if reachable == "all" else len(POLICIES)] or (None,)
        found += [Contestant(name, "proved", policy, solver.objective, missing) for policy in policies]
    return found


def _peers(name: str) -> list[Contestant]:
    """One peer at its defaults, and tight if it has such options."""
    settings: list[Setting] = ["default", "tight"]
    backend = name.partition(":")[2]
    if name.startswith("qpsolvers:") and backend not in TIGHT:
        settings = ["default"]
    missing = ""
    try:
        _peer(name, "default")
    except MissingDependency:
        missing = "not installed"
    return [Contestant(name, setting, None, LEAST_SQUARES, missing) for setting in settings]


def _peer(name: str, setting: Literal["default", "tight"]) -> Peer:
    if name == "daqp":
        return DirectDaqp(setting)
    if name == "cvxpy:plain":
        return PlainConvex(setting)
    return PlainProgram(name.partition(":")[2], setting)
