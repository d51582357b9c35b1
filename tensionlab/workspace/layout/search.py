"""Search for layouts: where to put modules, and what each of them adds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, ShapeError
from tensionlab.model import pose
from tensionlab.model.module import Module, TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace.certification import certify as prove
from tensionlab.workspace.layout.results import Layout, LayoutSearch, Objective, target_margins, target_slopes
from tensionlab.workspace.layout.space import Placement, Space
from tensionlab.workspace.poses import Grid

POPULATION_FACTOR = 10  # layouts in a generation, for each number that describes one
INITIAL_STEP, MIN_STEP, MAX_STEP = 0.1, 1e-4, 0.3  # trust region: how far a module may move, as a share of an edge
MAX_STEPS = 80  # in a trust region; 30 are usual
MIN_GAIN = 1e-9  # of the objective, for a step to be kept
CLOUD_POINTS = 100  # points that surround a small target
CLOUD_RADIUS_M = 1e-3  # distance of the cloud from the target
DECIMALS = 6  # coordinates are rounded to micrometres
SHARPNESS = (1.0, 0.1, 0.01)  # how closely shares are followed: blunt ones lead further, sharp ones count right
PROOF_CELLS = 64  # number of finest cells of a proof along the longest edge
BISECTIONS = 8  # of a proved force, down to half a percent

Progress = Callable[[float], None]


def search_layout(
    space: Space,
    target: Grid | ArrayLike,
    objective: Objective,
    *,
    name: str = "layout",
    seed: int = 0,
    generations: int = 30,
    starts: int = 50,
    certify: bool = False,
    progress: Progress | None = None,
    on_improvement: Callable[[Layout], None] | None = None,
) -> LayoutSearch:
    """Search for anchors of modules that are best for a target, by an objective.

    For each number of modules in turn, in three stages. Differential evolution spreads over all surfaces. The best
    layouts of its last generation, no two of which use the same surfaces equally often, are polished by gradients.
    Then the best of them hops: one or two of its modules are moved anywhere, the layout is polished, and kept if
    it is better. The result is a local optimum; more starts are more likely to find the best there is. The same
    seed gives the same result.

    Source: Storn and Price, "Differential evolution: a simple and efficient heuristic for global optimization over
    continuous spaces", 1997, in SciPy's implementation; Wales and Doye, "Global optimization by basin-hopping",
    1997. ShapeError or InputError if the target does not suit the surfaces, or a number is too small.

    Parameters
    ----------
    space, objective
        Where modules may be, and how layouts are compared.
    target : Grid, as made by `box`, or (P, d) array
        Positions of the hand, in m.
    name : str
        Start of the names of the rigs, which end in their number of modules.
    generations, starts : int
        Generations of the evolution, and number of its layouts that are polished; as many hops follow.
    certify : bool
        Whether to prove what the layouts render between the points of the target, too: `Layout.proved`.
    progress : callable, optional
        Called with the share of the work that is done, from 0 to 1.
    on_improvement : callable, optional
        Called with each layout that is better than those before with as many modules, as soon as it is found. An
        exception that either of the two raises ends the search.

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
    positions = target.arrays()[0] if isinstance(target, Grid) else target
    points = pose.points(positions, space.dimension, "target").reshape(-1, space.dimension)
    objective = objective.over(target) if isinstance(target, Grid) else objective
    if not len(points):
        raise ShapeError("target has no points; give at least one position of the hand")
    for what, number in (("generations", generations), ("starts", starts)):
        if number < 1:
            raise InputError(f"{what} is {number}; give 1 or more")

    def search(count: int, done: int) -> Layout:
        """Return the best layout with a number of modules, after those of ``done`` other numbers."""

        def report(share: float) -> None:
            if progress is not None:
                progress((done + share) / len(space.counts))

        def finish(places: Placement) -> Layout:
            return evaluate(space, points, objective, places, f"{name}-{count + len(space.fixed)}")

        def show(places: Placement) -> None:
            if on_improvement is not None:
                on_improvement(finish(places))

        random = np.random.default_rng([seed, count])
        ranked = _explore(
            space, points, objective, count, random, generations, lambda share: report(share / 3), show
        )
        candidates: dict[tuple[int, ...], Placement] = {}  # the first that use the surfaces equally often
        for places in ranked:
            candidates.setdefault(tuple(np.sort(places.surfaces)), places)
        queue = list(candidates.values())[:starts]
        best, rank = ranked[0], (-np.inf, -np.inf)
        for number in range(2 * starts):
            start = queue[number] if number < len(queue) else _hop(space, best, random)
            polished, values = polish(space, points, objective, start, space.tension_limits(count))
            found = float(objective.score(values)), float(objective.merit(values))
            if found > rank:
                best, rank = polished, found
                show(best)
            report(1 / 3 + (number + 1) / (3 * starts))
        layout = finish(best)
        most = layout.worst if objective.force is None else min(objective.force, layout.worst)
        return replace(layout, proved=proved_force(layout.rig, points, most)) if certify else layout

    return LayoutSearch(objective, tuple(search(count, done) for done, count in enumerate(sorted(space.counts))))


def _explore(
    space: Space,
    target: Floats,
    objective: Objective,
    count: int,
    random: np.random.Generator,
    generations: int,
    report: Progress,
    show: Callable[[Placement], None],
) -> list[Placement]:
    """Return the last generation of an evolution, the best layout first; show the best of each that is better."""
    from scipy.optimize import Bounds, OptimizeResult, differential_evolution

    limits = space.tension_limits(count)
    size = count * (space.dimension + 1)

    def layouts(genes: Floats) -> Placement:
        return space.decode(genes.reshape(-1, count, space.dimension + 1))

    def cost(genes: Floats) -> Floats:
        return -objective.merit(target_margins(space, space.anchors(layouts(genes.T)), limits, target))

    passed, least = 0, np.inf

    def callback(intermediate_result: OptimizeResult) -> None:
        nonlocal passed, least
        passed += 1
        report(passed / generations)
        if intermediate_result.fun < least:
            least = intermediate_result.fun
            shown = layouts(intermediate_result.x)
            show(Placement(shown.surfaces[0], shown.along[0]))

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
        callback=callback,
    )
    everyone = layouts(found.population)
    order = np.argsort(found.population_energies, kind="stable")
    return [Placement(everyone.surfaces[index], everyone.along[index]) for index in order]


def _hop(space: Space, places: Placement, random: np.random.Generator) -> Placement:
    """Return the layout with one or two modules moved anywhere."""
    surfaces, along = places.surfaces.copy(), places.along.copy()
    count = len(surfaces)
    for index in random.permutation(count)[: random.integers(1, 3)]:
        surfaces[index] = random.integers(len(space.surfaces))
        along[index] = random.random(space.dimension)
    return Placement(surfaces, along)


def polish(
    space: Space, target: Floats, objective: Objective, places: Placement, limits: TensionLimits
) -> tuple[Placement, Floats]:
    """Return the best layout near a given one, with every module on its surface.

    The margins are not smooth where two facets or two points of the target are equally bad, as in the best
    layouts. So each step takes all margins as linear in the places, finds the best places within a trust region by
    a linear program, and keeps them if the objective rises; if not, the region shrinks. Small targets are
    surrounded by a cloud of points, which show the slopes of all the nearest facets. Returned are the places and
    their margins (P,), in N, whose merit is never below that of the given places.

    Source: Conn, Gould and Toint, "Trust-region methods", 2000, chapter 11, for such sequences of linear programs;
    Burke, Lewis and Overton, "A robust gradient sampling algorithm for nonsmooth, nonconvex optimization", 2005,
    for the cloud.
    """
    own, copies = len(target), CLOUD_POINTS // len(target)
    away = np.random.default_rng(0).normal(size=(copies, *target.shape))
    away *= CLOUD_RADIUS_M / np.linalg.norm(away, axis=-1, keepdims=True)
    cloud = np.concatenate([target, (target + away).reshape(-1, target.shape[1])])
    margins, gradient = target_slopes(space, places, limits, cloud)
    for sharpness in SHARPNESS if objective.force is not None else SHARPNESS[:1]:
        radius = INITIAL_STEP
        for _ in range(MAX_STEPS):
            low = np.maximum(-radius, -places.along)
            high = np.minimum(radius, 1.0 - places.along)
            step = _best_step(objective, margins, gradient, low, high, sharpness)
            ahead = Placement(places.surfaces, np.clip(places.along + step, 0.0, 1.0))
            new_margins, new_gradient = target_slopes(space, ahead, limits, cloud)
            gain = objective.smooth(new_margins[:own], sharpness) - objective.smooth(margins[:own], sharpness)
            if gain > MIN_GAIN:
                places, margins, gradient = ahead, new_margins, new_gradient
                radius = min(2 * radius, MAX_STEP)
            else:
                radius /= 4
                if radius < MIN_STEP:
                    break
    return places, margins[:own]


def _best_step(
    objective: Objective, margins: Floats, gradient: Floats, low: Floats, high: Floats, sharpness: float
) -> Floats:
    """Return the best step between two bounds, (k, d), if margins were linear: margins + gradient . step.

    It minimises the missing total, while force is missing anywhere; else it maximises the worst margin.
    """
    from scipy.optimize import linprog

    slope = gradient.reshape(len(margins), -1)
    lowest = margins + np.minimum(slope * low.ravel(), slope * high.ravel()).sum(axis=1)
    bounds: list[tuple[float | None, float | None]] = [*zip(low.ravel(), high.ravel(), strict=True)]
    if objective.force is not None and (margins < objective.force).any():
        rows = lowest < objective.force  # the others have enough after any step
        count = int(rows.sum())
        # unknown: step, missing >= 0; margins + slope step + missing >= force
        matrix = np.hstack([-slope[rows], -np.eye(count)])
        bound = margins[rows] - objective.force
        cost = np.concatenate([np.zeros(slope.shape[1]), 1 / (sharpness + objective.missing(margins[rows]))])
        bounds += [(0.0, None)] * count
    else:
        highest = margins + np.maximum(slope * low.ravel(), slope * high.ravel()).sum(axis=1)
        rows = lowest <= highest.min()  # the others are the worst after no step
        # unknown: step, worst; margins + slope step >= worst
        matrix = np.hstack([-slope[rows], np.ones((int(rows.sum()), 1))])
        bound = margins[rows]
        cost = np.append(np.zeros(slope.shape[1]), -1.0)
        bounds.append((None, None))
    # Unscaled and small: presolving takes longer than solving.
    found = linprog(cost, A_ub=matrix, b_ub=bound, bounds=bounds, method="highs", options={"presolve": False})
    if found.x is None:
        return np.zeros_like(low)
    step: Floats = found.x[: low.size].reshape(low.shape)
    return step


def evaluate(space: Space, target: Floats, objective: Objective, places: Placement, name: str) -> Layout:
    """Return the rig of a layout, its score, and the contribution of each module."""
    order = np.lexsort((*places.along.T[::-1], places.surfaces))
    places = Placement(places.surfaces[order], places.along[order])
    modules = (*_modules(space, places), *space.fixed)
    limits = space.tension_limits(len(places.surfaces))
    anchors = space.anchors(places).round(DECIMALS)
    found = target_margins(space, anchors, limits, target)
    score = float(objective.score(found))
    lost = []
    for index in range(len(modules)):
        others, without = np.arange(len(modules)) != index, 0.0
        if others.any():
            fewer = TensionLimits(limits.lower[others], limits.upper[others])
            without = float(objective.score(target_margins(space, anchors[others], fewer, target)))
        lost.append(max(score, 0.0) - max(without, 0.0))  # no force is less than none
    rig = space.rig(name, modules, target.mean(axis=0).round(DECIMALS) + 0.0)
    rig = replace(rig, description=f"A layout found by search: it {objective.describe(rig, score)}.")
    return Layout(rig, score, float(found.min()), tuple(lost))


def _modules(space: Space, places: Placement) -> list[Module]:
    """Return modules with names after their surfaces, in the axes of their own frames."""
    modules: list[Module] = []
    taken = {module.name for module in space.fixed}
    for index, along in zip(places.surfaces, places.along, strict=True):
        surface = space.surfaces[index]
        number = 1
        while f"{surface.name} {number}" in taken:
            number += 1
        name = f"{surface.name} {number}"
        taken.add(name)
        anchor = (surface.corner + along[: len(surface.edges)] @ surface.edges).round(DECIMALS) + 0.0
        modules.append(Module(name, anchor, *space.limits, frame=surface.frame, **space.hardware))
    return modules


def proved_force(rig: Rig, target: Floats, most: float) -> float:
    """Return the force in N, up to ``most``, that is proved in every direction in the box around a target (P, d).

    It is counted from the required wrenches of the rig; NaN if not even those are proved.
    """
    region = np.stack([target.min(axis=0), target.max(axis=0)], axis=1)
    edge = float(np.ptp(region, axis=1).max())

    def proved(force: float) -> bool:
        required = replace(rig.required, ball=rig.required.ball + force)
        return prove(rig, region, required, edge / PROOF_CELLS).proved

    if not most >= 0 or (edge and not proved(0.0)):
        return float("nan")
    if not edge or proved(most):  # the search itself evaluates a single position
        return most
    low, high = 0.0, most
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if proved(middle) else (low, middle)
    return low
