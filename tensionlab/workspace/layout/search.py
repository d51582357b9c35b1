"""Search for layouts: where to put modules, and what each of them adds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count as count_from

import numpy as np

from tensionlab.errors import InputError
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, pad_last_axis
from tensionlab.workspace.certification import certify as prove
from tensionlab.workspace.interference import with_bodies
from tensionlab.workspace.layout.objective import Objective, Target, Targets, as_targets
from tensionlab.workspace.layout.problem import LayoutProblem, polish
from tensionlab.workspace.layout.results import Layout, LayoutSearch
from tensionlab.workspace.layout.space import Placement, Space
from tensionlab.workspace.poses import Grid

GENERATIONS, STARTS = 30, 50  # of a thorough search
POPULATION_FACTOR = 10  # layouts in a generation, for each number that describes one
TOO_CLOSE = 1e6  # cost of a layout too close to a body, before its distance is counted: more than of any other
HOPS = 32  # places tried for a module that hops, until its cable stays clear of bodies
PROOF_CELLS = 64  # number of finest cells of a proof along the longest edge of a target
BISECTIONS = 8  # of a proved force, down to half a percent

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
    """Search for anchors of modules, and attachments on a platform, that are best for a target, by an objective.

    For each number of modules in turn, in three stages. Differential evolution spreads over all surfaces. The best
    layouts of its last generation, no two of which use the same surfaces equally often, are polished by gradients.
    Then the best of them hops: one or two of its modules are moved anywhere, the layout is polished, and kept if
    it is better. More starts are more likely to find the best layout. The same seed gives the same result. A
    layout whose cables come closer to a body than its margin, anywhere in a target, is never better than one that
    is clear.

    Source: Storn and Price, "Differential evolution: a simple and efficient heuristic for global optimization over
    continuous spaces", 1997, in SciPy's implementation; Wales and Doye, "Global optimization by basin-hopping",
    1997. ShapeError, InputError or RigError if target, surfaces and bodies do not suit each other, or a number is
    too small.

    Parameters
    ----------
    target : Grid, PoseList, (P, d) array, or several of the first two
        Positions of the hand, in m: a `box`, or a path as of `read_poses`; of a platform also its orientations.
    name : str
        Start of the names of the rigs, which end in their number of modules.
    generations, starts : int
        Generations of the evolution, and number of its layouts that are polished; as many hops follow.
    certify : bool
        Whether to prove what the layouts render between the points of the target as well: `Layout.proved`.
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
    targets = as_targets(target, space.dimension, turns=bool(space.attachments))
    if certify and any(not isinstance(poses, Grid) and poses.rotation is not None for poses in targets):
        raise InputError("certify: a path with orientations cannot be proved; give a box, or leave certify out")
    problem = LayoutProblem.of(space, targets, objective)
    counts = sorted(space.counts)

    def search(number: int) -> Layout:
        """Return the best layout with a number of modules, after those of other numbers."""
        count = counts[number]

        def report(share: float) -> None:
            if progress is not None:
                progress((number + share) / len(counts))

        places = _best_places(
            problem, count // len(space.images), np.random.default_rng([seed, count]), generations, starts, report
        )
        layout = problem.evaluate(places, f"{name}-{count + len(space.fixed)}")
        if certify:
            desired_force = layout.worst if objective.directions is None else layout.score
            if objective.force is not None:
                desired_force = (
                    objective.force if objective.directions is not None else min(objective.force, layout.worst)
                )
            layout = replace(layout, proved=proved_force(layout.rig, targets, objective, desired_force))
        return layout

    layouts = tuple(search(number) for number in range(len(counts)))
    if progress is not None:
        progress(1.0)
    return LayoutSearch(problem.objective, layouts)


def _best_places(
    problem: LayoutProblem,
    count: int,
    random: np.random.Generator,
    generations: int,
    starts: int,
    report: Progress,
) -> Placement:
    """Return the places of the best layout of an evolution, polishing and hops."""
    ranked = _explore(problem, count, random, generations, lambda share: report(share / 3))
    candidates: dict[tuple[int, ...], Placement] = {}  # the first that use the surfaces equally often
    for places in ranked:
        candidates.setdefault(tuple(np.sort(places.surfaces, axis=0).ravel()), places)
    queue = list(candidates.values())[:starts]
    best, rank = ranked[0], (-np.inf, -np.inf, -np.inf)
    for number in range(2 * starts):
        start = queue[number] if number < len(queue) else _hop(problem, best, random)
        polished, values = polish(problem, start)
        if (polished_rank := problem.rank(polished, values)) > rank:
            best, rank = polished, polished_rank
        report(1 / 3 + (number + 1) / (3 * starts))
    return best


def _explore(
    problem: LayoutProblem,
    count: int,
    random: np.random.Generator,
    generations: int,
    report: Progress,
) -> list[Placement]:
    """Return the last generation of an evolution, the best layout first."""
    from scipy.optimize import Bounds, differential_evolution

    shape = (count, len(problem.space.ends), problem.space.dimension + 1)
    size = int(np.prod(shape))

    def layouts(genes: Floats) -> Placement:
        return problem.space.decode(genes.reshape(-1, *shape))

    def cost(genes: Floats) -> Floats:
        places = layouts(genes.T)
        too_close = -problem.spare(places).clip(max=0.0).sum(axis=-1)
        costs = TOO_CLOSE * (1.0 + too_close)
        clear = too_close == 0.0
        if clear.any():
            cables = problem.space.cables(Placement(places.surfaces[clear], places.along[clear]))
            costs[clear] = -problem.objective.merit(problem.values(cables).min(axis=-2))
        return np.asarray(costs)

    passed = count_from(1)
    result = differential_evolution(
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
    everyone = layouts(result.population)
    order = np.argsort(result.population_energies, kind="stable")
    return [Placement(everyone.surfaces[index], everyone.along[index]) for index in order]


def _hop(problem: LayoutProblem, places: Placement, random: np.random.Generator) -> Placement:
    """Return the layout with one or two cables moved anywhere, to where they stay clear of bodies."""
    surfaces, along = places.surfaces.copy(), places.along.copy()
    for index in random.permutation(len(surfaces))[: random.integers(1, 3)]:
        for _ in range(HOPS):
            for end, choice in enumerate(problem.space.ends):
                surfaces[index, end] = random.integers(choice.start, choice.stop)
                along[index, end] = random.random(problem.space.dimension)
            if problem.spare(Placement(surfaces[[index]], along[[index]]))[0] >= 0.0:
                break
    return Placement(surfaces, along)


def proved_force(rig: Rig, targets: tuple[Target, ...], objective: Objective, highest: float) -> float:
    """Return the force in N, up to ``highest``, that is proved in the objective's directions throughout targets.

    Of a grid it is proved in its box, of a path along the straight lines between its positions. It is counted from
    the required wrenches of the rig; NaN if not even those are proved.
    """
    rig = with_bodies(rig, ())  # the search has proved the clearance
    around = rig.required.at(rig) - rig.required.middle(rig)

    def proved(force: float) -> bool:
        if objective.directions is None:
            required = replace(rig.required, ball=rig.required.ball + force)
        else:
            pushed = np.array(objective.directions)[:, None] * force
            pushed = around + pad_last_axis(pushed, rig.n)
            wrenches = np.concatenate([around, pushed.reshape(-1, rig.n)])
            required = replace(rig.required, box=None, acceleration=None, wrenches=wrenches)
        intact = all(_holds(rig, poses, required) for poses in targets)
        return intact and (
            not objective.losses or all(_holds(rig, poses, required, losses=1) for poses in targets)
        )

    survives = rig.m > rig.n or not objective.losses
    if not highest >= 0 or not survives or not proved(0.0):
        return float("nan")
    if proved(highest):
        return highest
    low, high = 0.0, highest
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if proved(middle) else (low, middle)
    return low


def _holds(rig: Rig, target: Target, required: Requirement, losses: int = 0) -> bool:
    """Whether it is proved that all that is required is feasible throughout a target."""
    points, rotations = target.arrays()
    finest = float(np.ptp(points, axis=0).max()) / PROOF_CELLS
    if not finest and rotations is None:  # the search itself evaluates a single position
        return True
    if isinstance(target, Grid):
        region = np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
        return prove(rig, region, required, finest, rotations=target.rotations, losses=losses).proved
    return _holds_along(rig, points, required, finest, losses)


def _holds_along(rig: Rig, path: Floats, required: Requirement, finest: float, losses: int) -> bool:
    """Whether it is proved for the box around a path or, down to the finest, those around its halves."""
    region = np.stack([path.min(axis=0), path.max(axis=0)], axis=1)
    longest = float(np.ptp(path, axis=0).max())
    if not longest or prove(rig, region, required, 2 * longest, losses=losses).proved:
        return True
    if len(path) == 2:
        if longest <= finest:
            return False
        path = np.stack([path[0], path.mean(axis=0), path[1]])
    middle = len(path) // 2
    halves = (path[: middle + 1], path[middle:])
    return all(_holds_along(rig, part, required, finest, losses) for part in halves)
