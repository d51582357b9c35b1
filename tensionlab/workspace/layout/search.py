"""Where to put the modules: `search_layout`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError
from tensionlab.model import pose
from tensionlab.workspace.layout import place
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.place import Places
from tensionlab.workspace.layout.polish import polish
from tensionlab.workspace.layout.result import LayoutSearch, judge
from tensionlab.workspace.layout.space import Space
from tensionlab.workspace.sweep.pose_sets import Grid

POPULATION = 10
"""Layouts in a generation, for each number that describes one."""

Told = Callable[[float], None]


def search_layout(
    space: Space,
    target: Grid | ArrayLike,
    objective: Objective,
    *,
    name: str = "layout",
    seed: int = 0,
    generations: int = 30,
    starts: int = 50,
    progress: Told | None = None,
) -> LayoutSearch:
    """Where should the modules stand, so that a hand can be pulled as hard as possible everywhere in a target?

    For each number of modules in turn, in three stages. Differential evolution spreads over all surfaces, with a
    whole generation in one call of the compiled capacity margin. The best layouts of its last generation, no two
    of which use the same surfaces equally often, are polished by gradients. Then the best of them hops: one or two
    of its modules are put anywhere, the layout is polished, and kept if it is better. What is found is a local
    optimum, often the best there is; more starts make that more likely. The same seed gives the same result.

    Source: Storn and Price, "Differential evolution: a simple and efficient heuristic for global optimization over
    continuous spaces", 1997, in SciPy's implementation; Wales and Doye, "Global optimization by basin-hopping",
    1997.

    Parameters
    ----------
    space : Space
        The surfaces, and how many modules to put on them.
    target : Grid, as made by `box`, or (P, d) array
        Positions of the hand, in m.
    objective : Objective
    name : str
        Rigs are named after it and their number of modules.
    seed : int
    generations : int
        Of the differential evolution.
    starts : int
        How many layouts of the evolution are polished; as many hops follow.
    progress : callable, optional
        Told the share of the work that is done.

    Returns
    -------
    LayoutSearch

    Raises
    ------
    ShapeError
        If the target has no point or other coordinates than the surfaces, or a number is too small.
    """
    positions = target.arrays()[0] if isinstance(target, Grid) else target
    points = pose.points(positions, space.dimension, "target").reshape(-1, space.dimension)
    if not len(points):
        raise ShapeError("target has no points; give at least one position of the hand")
    for what, number in (("generations", generations), ("starts", starts)):
        if number < 1:
            raise ShapeError(f"{what} is {number}; give 1 or more")
    layouts = []
    counts = sorted(space.counts)
    for done, count in enumerate(counts):

        def tell(share: float, done: int = done) -> None:
            if progress is not None:
                progress((done + share) / len(counts))

        random = np.random.default_rng([seed, count])
        ranked = _explore(space, points, objective, count, random, generations, lambda share: tell(share / 3))
        limits = place.limits(space, count)
        best, rank = ranked[0], (-np.inf, -np.inf)
        candidates = _different(ranked, starts)
        for number in range(2 * starts):
            start = candidates[number] if number < len(candidates) else _hop(space, best, random)
            polished, margins = polish(space, points, objective, start, limits)
            found = float(objective.score(margins)), float(objective.merit(margins))
            if found > rank:
                best, rank = polished, found
            tell(1 / 3 + (number + 1) / (3 * starts))
        layouts.append(judge(space, points, objective, best, f"{name}-{count + len(space.fixed)}"))
    return LayoutSearch(objective, tuple(layouts))


def _explore(
    space: Space,
    target: Floats,
    objective: Objective,
    count: int,
    random: np.random.Generator,
    generations: int,
    tell: Told,
) -> list[Places]:
    """The last generation of an evolution, the best layout first."""
    from scipy.optimize import Bounds, OptimizeResult, differential_evolution

    limits = place.limits(space, count)
    size = count * (space.dimension + 1)

    def layouts(genes: Floats) -> Places:
        return place.decode(space, genes.reshape(-1, count, space.dimension + 1))

    def cost(genes: Floats) -> Floats:
        return -objective.merit(place.margins(place.anchors(space, layouts(genes.T)), limits, target))

    passed = 0

    def callback(intermediate_result: OptimizeResult) -> None:
        nonlocal passed
        passed += 1
        tell(passed / generations)

    found = differential_evolution(
        cost,  # type: ignore[arg-type]  # the stubs know no vectorized functions
        Bounds(np.zeros(size), np.ones(size)),
        vectorized=True,
        updating="deferred",
        maxiter=generations,
        popsize=POPULATION,
        rng=random,
        tol=0.0,
        polish=False,
        callback=callback,
    )
    everyone = layouts(found.population)
    order = np.argsort(found.population_energies, kind="stable")
    return [Places(everyone.surfaces[index], everyone.along[index]) for index in order]


def _different(ranked: list[Places], most: int) -> list[Places]:
    """The first layouts that differ in how often they use each surface."""
    seen: dict[tuple[int, ...], Places] = {}
    for places in ranked:
        seen.setdefault(tuple(np.sort(places.surfaces)), places)
    return list(seen.values())[:most]


def _hop(space: Space, places: Places, random: np.random.Generator) -> Places:
    """The same layout with one or two modules anywhere."""
    surfaces, along = places.surfaces.copy(), places.along.copy()
    count = len(surfaces)
    for index in random.permutation(count)[: random.integers(1, 3)]:
        surfaces[index] = random.integers(len(space.surfaces))
        along[index] = random.random(space.dimension)
    return Places(surfaces, along)
