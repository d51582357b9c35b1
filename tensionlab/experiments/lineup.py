"""Which solvers take part in a comparison, and with which policies."""

from __future__ import annotations

from collections.abc import Sequence

from tensionlab.errors import MissingDependency
from tensionlab.solvers import SOLVERS, make, plugins
from tensionlab.solvers.contract import POLICIES, Nearest
from tensionlab.solvers.quadratic import BACKENDS, installed_backends

Run = tuple[str, Nearest | None]
"""A solver's name and its policy; None if it honours none."""


def every_solver() -> dict[str, bool]:
    """Which solvers there are, each variant by its own name, and whether it can be used.

    Returns
    -------
    dict of str to bool
        In the order of `SOLVERS`; ``qp`` with each backend, ``pseudoinverse`` with each start. Then those of
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
        else:
            names[name] = True
    return names


def lineup(solvers: Sequence[str] | None = None, nearest: str | None = None) -> tuple[list[Run], list[str]]:
    """Which solvers run with which policies, and which are not installed.

    Parameters
    ----------
    solvers : sequence of str, optional
        Names that `make` knows; None for every solver.
    nearest : str, optional
        Only this policy, and only solvers that honour it; None for all policies of each solver.

    Returns
    -------
    runs : list of (str, str or None)
        Solver and policy, in the order asked for.
    missing : list of str
        Solvers whose library is not installed, and broken ones of other distributions. Only where `solvers` is
        None: one asked for must be there.

    Raises
    ------
    ValueError
        If the policy does not exist, or a solver asked for does not honour it, or no solver is asked for.
    UnknownSolver, MissingDependency, PluginError
        If a solver asked for does not exist, or is not installed, or is another distribution's and broken.
    """
    if nearest is not None and nearest not in POLICIES:
        raise ValueError(f"nearest={nearest!r} is no policy; choose one of {', '.join(POLICIES)}")
    every = every_solver() if solvers is None else _house()
    names = list(every) if solvers is None else list(dict.fromkeys(solvers))
    if not names:
        raise ValueError(f"no solver asked for; choose of {', '.join(every)}")
    runs: list[Run] = []
    missing: list[str] = []
    for name in names:
        if solvers is None and not every[name]:
            missing.append(name)
            continue
        honoured = make(name).policies
        chosen = [policy for policy in honoured if nearest in (None, policy)]
        if not every.get(name, True):
            raise MissingDependency(f'{name} is not installed; pip install "tensionlab[solvers]" brings it')
        if nearest is None:
            runs += [(name, policy) for policy in chosen] or [(name, None)]
        elif chosen or solvers is None:
            runs += [(name, policy) for policy in chosen]
        else:
            can = f"it honours {', '.join(honoured)}" if honoured else "it promises no best substitute"
            raise ValueError(f"solver {name} cannot honour nearest={nearest!r}; {can}")
    return runs, missing
