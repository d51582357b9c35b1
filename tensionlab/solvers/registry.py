"""Solvers by name: the table of built-in ones, plug-ins, classes of modules, and the selection for a comparison.

Plug-ins are solvers of other distributions, in the entry point group ``tensionlab.solvers``. None of their code
runs before one is wanted by its name, or all solvers are listed.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import Field, fields, is_dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple, cast, get_args

from tensionlab.errors import InputError, MissingDependency, PluginError, UnknownSolver
from tensionlab.solvers.base import POLICIES, Policy, Solver, refusal, resolve_policy
from tensionlab.solvers.closed_form import ImprovedClosedForm, Polygon, PolygonGoal, Pseudoinverse, Puncture, Start
from tensionlab.solvers.compiled import CompiledSolver
from tensionlab.solvers.convex import ConvexProgram
from tensionlab.solvers.least_squares import Dykstra, Newton
from tensionlab.solvers.linear_program import LeastSum, Minimax, OptimallySafe
from tensionlab.solvers.penalty import AnalyticCentre, SlackNorm, Spidar
from tensionlab.solvers.quadratic import BACKENDS, QuadraticProgram, installed_backends
from tensionlab.support import registry

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

SOLVERS: dict[str, type[Any]] = {
    "newton": Newton,
    "dykstra": Dykstra,
    "pseudoinverse": Pseudoinverse,
    "closed-form": ImprovedClosedForm,
    "least-sum": LeastSum,
    "minimax": Minimax,
    "safe": OptimallySafe,
    "puncture": Puncture,
    "polygon": Polygon,
    "analytic-centre": AnalyticCentre,
    "slack": SlackNorm,
    "spidar": Spidar,
    "qp": QuadraticProgram,
    "cvxpy": ConvexProgram,
}  # built-in solvers by name

PLUGIN_GROUP = "tensionlab.solvers"


def make(name: str) -> Solver:
    """Return a solver by its name in `SOLVERS`, that of a plug-in, or ``module:Class``.

    What follows a colon sets the solver's first hyper-parameter: ``"qp:osqp"`` is
    ``QuadraticProgram(backend="osqp")``, ``"my_solver:MySolver:200"`` the class of a module with its first set.
    The module is one that Python can import; the working directory is not added to Python's path.

    Raises
    ------
    UnknownSolver, PluginError, ValueError
        If there is no such name, if what another distribution or module offers under it cannot be used, or if the
        solver refuses the hyper-parameter.
    """
    family, _, rest = name.partition(":")
    solver_class = SOLVERS.get(family)
    names: Iterable[str] = SOLVERS
    if solver_class is None:
        from importlib.metadata import EntryPoint

        offered = offered_plugins()
        names = [*SOLVERS, *offered, *(f"qp:{backend}" for backend in BACKENDS)]
        if family in offered:
            solver_class = _load_only(offered[family])
        elif rest and _is_module(family):
            class_name = rest.partition(":")[0]
            solver_class, name = _load(EntryPoint(class_name, f"{family}:{class_name}", PLUGIN_GROUP)), rest
        elif rest[:1].isupper():
            raise UnknownSolver(
                f"no solver is called {family!r}, and Python can import no module of that name; install the "
                "module of module:Class, or name its folder in the variable PYTHONPATH"
            )
    solver: Solver = registry.create_by_name(name, solver_class, names, "solver", UnknownSolver)
    return solver


def is_built_in(name: str) -> bool:
    """Return whether a solver of this name comes with tensionlab."""
    return name.partition(":")[0] in SOLVERS


def title_of(solver: Solver) -> str:
    """Return what an instance is called: its class, or built-in name, and hyper-parameters other than defaults."""
    kind = type(solver)
    name = next((family for family, known in SOLVERS.items() if known is kind), kind.__name__)
    settings: tuple[Field[Any], ...] = fields(kind) if is_dataclass(kind) else ()
    changed = [f"{field.name}={value!r}" for field in settings
               if field.init and repr(value := getattr(solver, field.name)) != repr(field.default)]  # fmt: skip
    return f"{name}({', '.join(changed)})" if changed else name


def as_fused_solver(solver: Solver) -> CompiledSolver | None:
    """Return a solver that also verifies its answers, in one pass; None where `tensionlab.verification` has to.

    Only built-in solvers may: the statuses of others are never believed.
    """
    return solver if type(solver) in SOLVERS.values() and isinstance(solver, CompiledSolver) else None


# Selection


def every_solver() -> dict[str, bool]:
    """Return the names of all solvers, and whether each can be used: its library is there, the plug-in not broken.

    In the order of `SOLVERS`, with ``qp``, ``pseudoinverse`` and ``polygon`` in all their variants; then plug-ins.
    """
    others = {name: isinstance(plugin, type) for name, plugin in find_plugins().items() if name not in SOLVERS}
    return _built_in() | others


def _built_in() -> dict[str, bool]:
    """Return the names of the built-in solvers, and whether their libraries are installed."""
    installed = installed_backends()
    variants = {
        "cvxpy": {"cvxpy": find_spec("cvxpy") is not None},
        "qp": {f"qp:{backend}": backend in installed for backend in BACKENDS},
        "pseudoinverse": {f"pseudoinverse:{start}": True for start in get_args(Start)},
        "polygon": {f"polygon:{goal}": True for goal in get_args(PolygonGoal)},
    }
    names = [variants.get(name, {name: True}) for name in SOLVERS]
    return {name: usable for family in names for name, usable in family.items()}


class Selected(NamedTuple):
    """A solver with its name and a policy, which is None if it supports none."""

    name: str
    policy: Policy | None
    solver: Solver


def name_solvers(solvers: Sequence[str | Solver]) -> dict[str, Solver | None]:
    """Return the solvers by what they are called, in their order, each once: instances; None for a name.

    InputError if there is none, or something is neither a name nor an instance.
    """
    if isinstance(solvers, str) or not isinstance(solvers, Sequence):
        raise InputError(f"solvers is {solvers!r:.60}; give a list of names and instances, such as ['newton']")
    if not solvers:
        raise InputError("no solver is named; leave the option out for all, or see `tensionlab solvers`")
    named: dict[str, Solver | None] = {}
    for solver in solvers:
        if isinstance(solver, type):
            raise InputError(f"solvers has the class {solver.__name__}; give an instance, {solver.__name__}()")
        if not isinstance(solver, str) and (lacks := _lacks(solver)):
            raise InputError(
                f"solvers has {solver!r:.60}, which lacks {', '.join(lacks)}; give names, or instances of "
                "solvers, as tensionlab.solvers.Solver says"
            )
        named |= {solver: None} if isinstance(solver, str) else {title_of(solver): solver}
    return named


def select_solvers(
    solvers: Sequence[str | Solver] | None = None, policy: str | None = None, size: tuple[int, int] | None = None
) -> tuple[list[Selected], dict[str, str]]:
    """Choose which solvers run with which policies.

    Left out, solvers are all by name, and policies all that a solver supports. ``size`` is n wrench components and
    m cables, for solvers that do not support every size.

    Returns every run, in the order given; and the solvers left out, with the reason: a library is not installed, a
    plug-in is broken, or the solver does not support this size. Given solvers are left out only if they lack the
    policy, unless all do; other problems raise InputError, `UnknownSolver`, `MissingDependency` or `PluginError`.
    """
    if policy is not None and policy not in POLICIES:
        raise InputError(f"policy={policy!r} is unknown; choose one of {', '.join(POLICIES)}")
    usable = every_solver() if solvers is None else _built_in()
    wanted = dict.fromkeys(usable) if solvers is None else name_solvers(solvers)
    runs: list[Selected] = []
    missing: dict[str, str] = {}
    for name, instance in wanted.items():
        if solvers is None and not usable[name]:
            missing[name] = "not installed" if is_built_in(name) else "broken"
            continue
        solver = instance or make(name)
        if not usable.get(name, True):
            extra = "reference" if name == "cvxpy" else "solvers"
            raise MissingDependency(f'{name} is not installed: pip install "tensionlab[{extra}]"')
        if size is not None and (reason := refusal(solver, *size)):
            if solvers is not None:
                raise InputError(f"solver {name} does not support this rig: {reason}")
            missing[name] = reason
        elif policy is None:
            runs += [Selected(name, policy, solver) for policy in solver.policies or (None,)]
        elif solvers is not None or policy in solver.policies:
            try:
                runs.append(Selected(name, resolve_policy(solver, policy, f"solver {name}"), solver))
            except InputError as error:
                if len(wanted) == 1:
                    raise
                missing[name] = str(error).removeprefix(f"solver {name} ")
    if not runs:
        raise InputError(f"no solver is left: {'; '.join(f'{name} {reason}' for name, reason in missing.items())}")
    return runs, missing


# Plug-ins


def offered_plugins() -> dict[str, list[EntryPoint]]:
    """Return what other distributions offer, by the name of the solver; none of their code is run."""
    from importlib.metadata import entry_points

    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=PLUGIN_GROUP):
        found.setdefault(entry.name, []).append(entry)
    return found


def find_plugins() -> dict[str, type[Any] | PluginError]:
    """Return the solvers of other distributions by name; in place of one that cannot be used, what is wrong."""
    found: dict[str, type[Any] | PluginError] = {}
    for name, entries in offered_plugins().items():
        try:
            found[name] = _load_only(entries)
        except PluginError as error:
            found[name] = error
    return found


def _load_only(entries: list[EntryPoint]) -> type[Any]:
    """Return the solver of an entry point whose name no other has."""
    entry, *others = entries
    offer = f"{' and '.join(map(_origin, entries))} offers a solver {entry.name!r}"
    if others:
        raise PluginError(f"{offer}; uninstall all but one")
    if entry.name in SOLVERS:
        raise PluginError(f"{offer}; tensionlab has its own of that name")
    if ":" in entry.name:
        raise PluginError(f"{offer}; no name has a colon, it sets a variant")
    return _load(entry)


def _origin(entry: EntryPoint) -> str:
    """Return name and version of the distribution that an entry point belongs to."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "none"


def _is_module(name: str) -> bool:
    """Return whether Python can import a module of this name."""
    try:
        return all(part.isidentifier() for part in name.split(".")) and find_spec(name) is not None
    except (ModuleNotFoundError, ValueError):  # of the package that it would be in; __main__
        return False


@functools.cache
def _load(entry: EntryPoint) -> type[Any]:
    """Load the class of an entry point, once, and check that it is a solver."""
    where = f"solver {entry.name!r}" + (f" of {_origin(entry)}" if entry.dist else "") + f" ({entry.value})"
    try:
        found = entry.load()
        if isinstance(found, type):
            found()
    except Exception as error:  # the code of others may raise anything
        raise PluginError(f"{where} cannot be loaded: {type(error).__name__}: {error}") from error
    faults = [f"lacks {', '.join(lacks)}"] if (lacks := _lacks(found)) else []
    if not (isinstance(found, type) and is_dataclass(found)):
        faults.append("is no dataclass")
    if not faults and (unknown := [each for each in found.policies if each not in POLICIES]):
        faults.append(f"has a policy {unknown[0]!r}; there are {', '.join(POLICIES)}")
    if faults:
        raise PluginError(f"{where} {' and '.join(faults)}; docs/how-to/add-a-solver.md has one to copy")
    return cast("type[Any]", found)


def _lacks(solver: object) -> list[str]:
    """Return what a class or an instance lacks to be a solver."""
    required: dict[str, Any] = {"objective": str, "policies": tuple, "solve": Callable}
    return [name for name, kind in required.items() if not isinstance(getattr(solver, name, None), kind)]
