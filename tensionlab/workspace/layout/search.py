"""Search for layouts: where to put modules, and what each of them adds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count as count_from

import numpy as np

from tensionlab.errors import InputError
from tensionlab.support.arrays import Floats
from tensionlab.workspace.layout.objective import Objective, Targets, as_targets
from tensionlab.workspace.layout.polish import polish
from tensionlab.workspace.layout.problem import LayoutProblem
from tensionlab.workspace.layout.proof import proved_force
from tensionlab.workspace.layout.results import Layout, LayoutSearch
from tensionlab.workspace.layout.space import Placement, Space

GENERATIONS, STARTS = 30, 50  # of a thorough search
POPULATION_FACTOR = 10  # layouts in a generation, for each number that describes one
TOO_CLOSE = 1e6  # cost of a layout too close to a body, before its distance is counted: more than of any other
HOPS = 32  # places tried for a module that hops, until its cable stays clear of bodies

Progress = Callable[[float], None]


def search_layout(
    space: Space,
    target: Targets,
    objective: Objective,
    *,
    name: str = "layout",
    seed: int = 0,
    generations: int = GENERATIONS,
    starts: int = STARTS,
    certify: bool = False,
    progress: Progress | None = None,
) -> LayoutSearch:
    """Search for anchors of modules that are best for a target, by an objective.

    For each number of modules in turn, in three stages. Differential evolution spreads over all surfaces. The best
    layouts of its last generation, no two of which use the same surfaces equally often, are polished by gradients.
    Then the best of them hops: one or two of its modules are moved anywhere, the layout is polished, and kept if
    it is better. More starts are more likely to find the best there is. A short search that finds nothing is
    repeated with four times as many, up to the default. The same seed gives the same result. A layout whose cables
    come closer to a body than its margin, anywhere in a target, is never better than one that is clear.

    Source: Storn and Price, "Differential evolution: a simple and efficient heuristic for global optimization over
    continuous spaces", 1997, in SciPy's implementation; Wales and Doye, "Global optimization by basin-hopping",
    1997. ShapeError, InputError or RigError if target, surfaces and bodies do not suit each other, or a number is
    too small.

    Parameters
    ----------
    target : Grid, PoseList, (P, d) array, or several of the first two
        Positions of the hand, in m: a `box`, or a path as of `read_poses`.
    name : str
        Start of the names of the rigs, which end in their number of modules.
    generations, starts : int
        Generations of the evolution, and number of its layouts that are polished; as many hops follow.
    certify : bool
        Whether to prove what the layouts render between the points of the target, too: `Layout.proved`.
    progress : callable, optional
        Called with the share of the work that is done, from 0 to 1. An exception that it raises ends the search.

    Examples
    --------
    >>> import tensionlab as tl
    >>> space = tl.workspace.Space(tl.workspace.room([3.0, 2.4, 4.0]), counts=(4,))
    >>> hand = tl.workspace.box([-0.2, 0.2], [1.0, 1.4], [-0.2, 0.2], step=0.2)
    >>> objective = tl.workspace.Objective()
    >>> found = tl.workspace.search_layout(space, hand, objective, generations=2, starts=1)
    >>> bool(found.best.score > 1.0)  # N in every direction, everywhere in the target
    True
    """
    for what, number in (("generations", generations), ("starts", starts)):
        if number < 1:
            raise InputError(f"{what} is {number}; give 1 or more")
    problem = LayoutProblem.of(space, as_targets(target, space.dimension), objective)
    counts = sorted(space.counts)

    def search(count: int, done: int) -> Layout:
        """Return the best layout with a number of modules, after those of ``done`` other numbers."""
        rig, best, tried = f"{name}-{count + len(space.fixed)}", None, list[tuple[int, int]]()
        for share, effort in _efforts(generations, starts):

            def report(part: float, share: tuple[float, float] = share) -> None:
                if progress is not None:
                    progress((done + share[0] + part * (share[1] - share[0])) / len(counts))

            random = np.random.default_rng([seed, count, *([len(tried)] if tried else [])])
            tried.append(effort)
            found = _attempt(problem, count, random, effort, report)
            if best is None or found[0] > best[0]:
                best = found
            layout = replace(problem.evaluate(best[1], rig), tried=tuple(tried))
            if layout.clear and layout.score > 0:
                break
        if certify:
            most = layout.worst if objective.directions is None else layout.score
            if objective.force is not None:
                most = objective.force if objective.directions is not None else min(objective.force, layout.worst)
            layout = replace(layout, proved=proved_force(layout.rig, problem.targets, objective, most))
        return layout

    layouts = tuple(search(count, done) for done, count in enumerate(counts))
    if progress is not None:
        progress(1.0)
    return LayoutSearch(problem.objective, layouts)


def _efforts(generations: int, starts: int) -> Iterator[tuple[tuple[float, float], tuple[int, int]]]:
    """Yield the generations and starts to try in turn, each after where its progress begins and ends."""
    begin = 0.0
    while generations < GENERATIONS or starts < STARTS:
        yield (begin, (1.0 + begin) / 2), (generations, starts)
        begin = (1.0 + begin) / 2
        generations = max(generations, min(4 * generations, GENERATIONS))
        starts = max(starts, min(4 * starts, STARTS))
    yield (begin, 1.0), (generations, starts)


def _attempt(
    problem: LayoutProblem,
    count: int,
    random: np.random.Generator,
    effort: tuple[int, int],
    report: Progress,
) -> tuple[tuple[float, float, float], Placement]:
    """Return the rank and the places of the best layout of an evolution, polishing and hops."""
    generations, starts = effort
    ranked = _explore(problem, count, random, generations, lambda share: report(share / 3))
    candidates: dict[tuple[int, ...], Placement] = {}  # the first that use the surfaces equally often
    for places in ranked:
        candidates.setdefault(tuple(np.sort(places.surfaces)), places)
    queue = list(candidates.values())[:starts]
    best, rank = ranked[0], (-np.inf, -np.inf, -np.inf)
    for number in range(2 * starts):
        start = queue[number] if number < len(queue) else _hop(problem, best, random)
        polished, values = polish(problem, start)
        if (found := problem.rank(polished, values)) > rank:
            best, rank = polished, found
        report(1 / 3 + (number + 1) / (3 * starts))
    return rank, best


def _explore(
    problem: LayoutProblem,
    count: int,
    random: np.random.Generator,
    generations: int,
    report: Progress,
) -> list[Placement]:
    """Return the last generation of an evolution, the best layout first."""
    from scipy.optimize import Bounds, differential_evolution

    size = count * (problem.space.dimension + 1)

    def layouts(genes: Floats) -> Placement:
        return problem.space.decode(genes.reshape(-1, count, problem.space.dimension + 1))

    def cost(genes: Floats) -> Floats:
        places = layouts(genes.T)
        too_close = -problem.spare(places).clip(max=0.0).sum(axis=-1)
        found = TOO_CLOSE * (1.0 + too_close)
        clear = too_close == 0.0
        anchors = problem.space.anchors(Placement(places.surfaces[clear], places.along[clear]))
        if clear.any():
            found[clear] = -problem.objective.merit(problem.values(anchors).min(axis=-2))
        return np.asarray(found)

    passed = count_from(1)
    found = differential_evolution(
        cost,  # type: ignore[arg-type]  # the stubs know no vectorized functions
        Bounds(np.zeros(size), np.ones(size)),
        vectorized=True,
        updating="deferred",
        maxiter=generations,
        popsize=POPULATION_FACTOR,
        rng=random,
        tol=0.0,
        polish=False,
        callback=lambda *_: report(next(passed) / generations),
    )
    everyone = layouts(found.population)
    order = np.argsort(found.population_energies, kind="stable")
    return [Placement(everyone.surfaces[index], everyone.along[index]) for index in order]


def _hop(problem: LayoutProblem, places: Placement, random: np.random.Generator) -> Placement:
    """Return the layout with one or two modules moved anywhere, to where their cables stay clear of bodies."""
    surfaces, along = places.surfaces.copy(), places.along.copy()
    count = len(surfaces)
    for index in random.permutation(count)[: random.integers(1, 3)]:
        for _ in range(HOPS):
            surfaces[index] = random.integers(len(problem.space.surfaces))
            along[index] = random.random(problem.space.dimension)
            if problem.spare(Placement(surfaces[[index]], along[[index]]))[0] >= 0.0:
                break
    return Placement(surfaces, along)
