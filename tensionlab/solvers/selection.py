"""Which solvers take part in a comparison, and with which policies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from tensionlab.errors import MissingDependency
from tensionlab.solvers import SOLVERS, make, plugins
from tensionlab.solvers.base import POLICIES, Nearest, refusal
from tensionlab.solvers.polygon import Goal
from tensionlab.solvers.quadratic import BACKENDS, installed_backends

Run = tuple[str, Nearest | None]
"""A solver's name and its policy; None if it honours none."""


def every_solver() -> dict[str, bool]:
    """Which solvers there are, each variant by its own name, and whether it can be used.

    Returns
    -------
    dict of str to bool
        In the order of `SOLVERS`; ``qp``, ``pseudoinverse`` and ``polygon`` in all their variants. Then those of
        other distributions. False where a library is not installed, or another distribution's solver is broken.
    """
    others = {name: isinstance(found, type) for name, found in plugins.find_all(SOLVERS).items()}
    return _house() | {name: usable for name, usable in others.items() if name not in SOLVERS}


def _house() -> dict[str, bool]:
    """Solvers of the house, and whether their libraries are installed."""
    there = installed_backends()
    names: dict[str, bool] = {}
    for name in SOLVERS:
        if name == "qp":
            names |= {f"qp:{backend}": backend in there for backend in BACKENDS}
        elif name == "pseudoinverse":
            names |= {"pseudoinverse:reference": True, "pseudoinverse:middle": True}
        elif name == "polygon":
            names |= {f"polygon:{goal}": True for goal in get_args(Goal)}
        else:
            names[name] = True
    return names


def lineup(
    solvers: Sequence[str] | None = None, nearest: str | None = None, size: tuple[int, int] | None = None
) -> tuple[list[Run], dict[str, str]]:
    """Which solvers run with which policies, and which are left out.

    Parameters
    ----------
    solvers : sequence of str, optional
        Names that `make` knows; None for every solver.
    nearest : str, optional
        Only this policy, and only solvers that honour it; None for all policies of each solver.
    size : (int, int), optional
        Wrench components n and cables m of the rig, for solvers that don't serve every size.

    Returns
    -------
    runs : list of (str, str or None)
        Solver and policy, in the order asked for.
    missing : dict of str to str
        Solvers left out, and why: the library is not installed, or another distribution's is broken, or the
        solver does not serve this size. Only where `solvers` is None: one asked for must be there.

    Raises
    ------
    ValueError
        If the policy does not exist, or a solver asked for does not honour it or does not serve this size, or
        no solver is asked for.
    UnknownSolver, MissingDependency, PluginError
        If a solver asked for does not exist, or is not installed, or is another distribution's and broken.
    """
    if nearest is not None and nearest not in POLICIES:
        raise ValueError(f"nearest={nearest!r} is no policy; choose one of {', '.join(POLICIES)}")
    every = every_solver() if solvers is None else _house()
    if isinstance(solvers, str):
        raise ValueError(f"solvers is {solvers!r}; give a list of names, such as [{solvers!r}]")
    names = list(every) if solvers is None else list(dict.fromkeys(solvers))
    if not names:
        raise ValueError("no solver is named; leave the option out for all, or see `tensionlab solvers`")
    runs: list[Run] = []
    missing: dict[str, str] = {}
    for name in names:
        if solvers is None and not every[name]:
            missing[name] = "not installed" if name.partition(":")[0] in SOLVERS else "broken"
            continue
        solver = make(name)
        honoured = solver.policies
        chosen = [policy for policy in honoured if nearest in (None, policy)]
        if not every.get(name, True):
            raise MissingDependency(f'{name} is not installed; pip install "tensionlab[solvers]" brings it')
        if size is not None and (reason := refusal(solver, *size)):
            if solvers is not None:
                raise ValueError(f"solver {name} does not serve this rig: {reason}")
            missing[name] = reason
        elif nearest is None:
            runs += [(name, policy) for policy in chosen] or [(name, None)]
        elif chosen or solvers is None:
            runs += [(name, policy) for policy in chosen]
        else:
            can = f"it honours {', '.join(honoured)}" if honoured else "it promises no best substitute"
            raise ValueError(f"solver {name} cannot honour nearest={nearest!r}; {can}")
    return runs, missing
