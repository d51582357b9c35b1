"""Do layouts that a search finds beat those that people build? ``python -m tensionlab.experiments.room_layouts``.

In a room of 4 x 4 m, 2.5 m high, for a hand in a cube of 0.6 m: four modules against the published triangle with a
module on top, and eight against the corners of the room.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.layouts import box_corners, ring_plus_top
from tensionlab.model.rig import Rig
from tensionlab.workspace.layout import place
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.result import Layout
from tensionlab.workspace.layout.search import search_layout
from tensionlab.workspace.layout.space import Space, room
from tensionlab.workspace.paths import box

SIZE = (4.0, 2.5, 4.0)
"""Of the room, in m."""
CUBE = 0.6
"""Edge of the cube of hand positions, in m."""
HEIGHTS = (0.6, 1.25)
"""Of the middle of the cube, in m: where the triangle with a top is at its best, and the middle of the room."""
OBJECTIVES = (Objective(), Objective(force=2.0))


@dataclass(frozen=True)
class Duel:
    """What does a search gain over a layout that people build?

    Attributes
    ----------
    rival : str
    modules : int
    height : float
        Of the middle of the cube of hand positions, in m.
    objective : Objective
    built, found : float
        Scores of the rival and of the layout that was found.
    layout : Layout
        What was found.
    """

    rival: str
    modules: int
    height: float
    objective: Objective
    built: float
    found: float
    layout: Layout


def duels(starts: int = 100, seed: int = 1, step: float = 0.1) -> Iterator[Duel]:
    """Which duels are fought, and how do they end?

    Parameters
    ----------
    starts, seed : int
        As in `search_layout`.
    step : float
        Between hand positions, in m.
    """
    for height in HEIGHTS:
        half = CUBE / 2
        cube = box((-half, half), (height - half, height + half), (-half, half), step=step)
        target = cube.arrays()[0]
        for objective in OBJECTIVES:
            rivals: list[tuple[str, Rig]] = [
                ("triangle and top", best_triangle_and_top(target, objective, seed)),
                ("corners of the room", room_corners()),
            ]
            for name, rival in rivals:
                space = Space(room(SIZE), counts=(rival.m,))
                best = search_layout(space, target, objective, seed=seed, starts=starts).best
                built = float(objective.score(place.margins(rival.anchors, rival.limits, target)))
                yield Duel(name, rival.m, height, objective, built, best.score, best)


def room_corners() -> Rig:
    """Which rig has its modules in the corners of the room?"""
    return _moved(box_corners(SIZE), lambda anchors: np.add(anchors, [0.0, SIZE[1] / 2, 0.0]))


def best_triangle_and_top(target: Floats, objective: Objective, seed: int) -> Rig:
    """How does the published arrangement fit the room best? Scaled, turned and shifted on the floor.

    The top module hangs on the ceiling above the centre of the triangle.

    Parameters
    ----------
    target : (P, 3) array
        In m.
    objective : Objective
    seed : int
    """
    from scipy.optimize import Bounds, differential_evolution

    unit = ring_plus_top(1.0, height=0.0, top=SIZE[1])
    largest = SIZE[0] / np.cos(np.pi / 12)  # of all triangles in a square

    def anchors(x: Floats) -> Floats:
        side, angle, shift_x, shift_z = (value[..., None] for value in np.moveaxis(np.asarray(x), -1, 0))
        c, s = np.cos(angle), np.sin(angle)
        ux, uy, uz = (unit.anchors[:, axis] for axis in range(3))
        along_x, along_z = side * (c * ux - s * uz) + shift_x, side * (s * ux + c * uz) + shift_z
        return np.stack([along_x, np.broadcast_to(uy, along_x.shape), along_z], axis=-1)

    def cost(genes: Floats) -> Floats:
        places = anchors(genes.T)
        outside = np.maximum(np.abs(places[..., ::2]).max(axis=(-2, -1)) - SIZE[0] / 2, 0.0)
        merit = objective.merit(place.margins(places, unit.limits, target))
        return np.where(outside > 1e-9, 100.0 + outside, -merit)

    found = differential_evolution(
        cost,  # type: ignore[arg-type]  # the stubs know no vectorized functions
        Bounds([0.3, 0.0, -1.0, -1.0], [largest, 2 * np.pi / 3, 1.0, 1.0]),
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(seed),
        maxiter=100,
        popsize=20,
        polish=False,
    )
    return _moved(unit, lambda _: anchors(found.x))


def _moved(rig: Rig, move: Callable[[Floats], Floats]) -> Rig:
    """The same rig with other anchors."""
    places = move(rig.anchors)
    modules = tuple(replace(module, anchor=anchor) for module, anchor in zip(rig.modules, places, strict=True))
    return replace(rig, modules=modules)


def main() -> None:
    """Fight all duels and print them."""
    for duel in duels():
        unit = "N everywhere" if duel.objective.force is None else f"of the cube with {duel.objective.force:g} N"
        print(
            f"{duel.modules} modules, cube {duel.height:g} m up: {duel.rival} {duel.built:.4g}, "
            f"found {duel.found:.4g} {unit}",
            flush=True,
        )


if __name__ == "__main__":
    main()
