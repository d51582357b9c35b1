"""The largest share of a wrench that tensions render, as a program of JAX."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from tensionlab.interop.jax_dual import Answer, Bounded, rank_tolerance, rounding_share, solve
from tensionlab.solvers.base import GRAZING, TOLERANCE

Arrays = TypeVar("Arrays", bound=tuple[Any, ...])

CUTS = 30  # shares at most that are tried

# Phases: the share is to be rendered exactly, or within tolerance; it is known; found; no share is feasible.
EXACT, NEAR, LAST, DONE, NONE = range(5)


class Rows(NamedTuple):
    """A problem with orthonormal rows, and last a row for the part of the wrench that no tensions render.

    Near-singular structure matrices do no harm in these coordinates. An error of 1 in a row is one of its strength
    in the wrench.
    """

    columns: Array  # (k + 1, m)
    target: Array  # (k + 1,)
    strengths: Array  # (k + 1,)

    def bounded(self, metric: Array | float, share: Array | float, *limits_and_reference: Array) -> Bounded:
        """Return the problem for a share of the wrench, with the error of each row multiplied by a metric."""
        weights = metric * jnp.ones_like(self.target)
        return Bounded(weights[:, None] * self.columns, weights * share * self.target, *limits_and_reference)


def orthonormal_rows(structure: Array, wrench: Array) -> Rows:
    """Return a problem in the coordinates of the singular vectors of its structure matrix."""
    left, values, rows = jnp.linalg.svd(structure, full_matrices=False)
    known = values > rank_tolerance(structure) * values[0]
    inside = jnp.where(known, left.T @ wrench, 0.0)
    outside = jnp.linalg.norm(wrench - left @ inside)
    outside = jnp.where(outside > rounding_share(structure) * jnp.linalg.norm(wrench), outside, 0.0)
    noise = _rounding(rows) * values[0] / jnp.where(known, values, 1.0)
    rows = jnp.where(known[:, None] & (jnp.abs(rows) > noise[:, None]), rows, 0.0)
    columns = jnp.vstack([rows, jnp.zeros_like(rows[:1])])
    strengths = jnp.append(jnp.where(known, values, 1.0), 1.0)
    return Rows(columns, jnp.append(inside, outside) / strengths, strengths)


class Line(NamedTuple):
    """What the normal of a line allows of the shares of a wrench: ``share along <= reach``, in N."""

    along: Array
    reach: Array

    def moved(self, tolerance: Array) -> Line:
        """Return the line moved outwards by a tolerance at the whole wrench, and by a little less below."""
        return Line(self.along - 0.1 * tolerance, self.reach + 0.9 * tolerance)

    def largest(self) -> Array:
        """Return the largest share; where ``along`` is positive."""
        return jnp.where(self.reach > 0, self.reach / jnp.where(self.along > 0, self.along, 1.0), 0.0)


class SearchState(NamedTuple):
    """Where the search is."""

    phase: Array
    share: Array
    normal: Array  # of the line that allows no larger share
    answer: Answer  # to this share


class Search(NamedTuple):
    """The search of the compiled kernels (``scale_search.hpp``) for the largest feasible share of one wrench.

    What is missing of a share is the normal of a line that bounds all shares, so the share falls until one is
    feasible. Where the wrench grazes a face of the available wrench set, or leaves a flat one, shares count as
    rendered within the tolerance of EXACT.
    """

    rows: Rows
    lower: Array
    upper: Array
    length: Array  # of the wrench, in N
    tolerance: Array  # in N
    rounding: Array  # of a line's reach, in N

    def line(self, normal: Array) -> Line:
        """Return the line with a normal."""
        columns, target, _ = self.rows
        pull = columns.T @ normal
        rounding = _rounding(normal) * (jnp.abs(columns).T @ jnp.abs(normal))
        pull = jnp.where(jnp.abs(pull) > rounding, pull, 0.0)
        return Line(normal @ target, jnp.sum(jnp.maximum(pull * self.lower, pull * self.upper)))

    def unit(self, normal: Array) -> Array:
        """Return a normal whose length is 1 in the wrench's coordinates."""
        return normal / jnp.maximum(jnp.linalg.norm(normal / self.rows.strengths), jnp.finfo(normal.dtype).tiny)

    def excludes_all(self, normal: Array) -> Array:
        """Return whether no share is feasible within the tolerance, as a normal shows."""
        line = self.line(normal)
        moved = Line(line.along, line.reach + self.rounding).moved(self.tolerance)
        return (moved.reach < 0) & (moved.reach < moved.along)

    def metric(self, phase: Array) -> Array:
        """Return the weights of the rows' errors in a phase."""
        return jnp.where(phase == EXACT, 1.0, self.rows.strengths)

    def cut(self, state: SearchState) -> SearchState:
        """Return the next share, or how the search ends; no answer to it yet."""
        missing, exact = state.answer[2], state.phase == EXACT
        normal = self.unit(self.metric(state.phase) * missing)
        columns, target, strengths = self.rows
        size = jnp.max(jnp.abs(columns) @ jnp.maximum(jnp.abs(self.lower), jnp.abs(self.upper)) + jnp.abs(target))
        rendered = jnp.all(jnp.abs(missing) <= rounding_share(missing) * size * jnp.where(exact, 1.0, strengths))
        after = _where(exact, self._cut_exactly(state, normal), self._cut_nearly(state, normal))
        after = _where(self.excludes_all(normal), state._replace(phase=NONE), after)
        after = _where(rendered | (state.phase == LAST), state._replace(phase=DONE), after)
        return _where(exact & (after.phase == DONE), self._reopened(after), after)

    def _cut_exactly(self, state: SearchState, normal: Array) -> SearchState:
        """Cut where shares must be rendered exactly; without such a share, try all within tolerance."""
        line = self.line(normal)
        possible = (line.along > self.rounding) & (line.reach >= -self.rounding)
        falls = line.largest() < state.share
        lower = SearchState(EXACT, line.largest(), normal, state.answer)
        # A share that is too short, by this normal, after one that is too long: their mean may exclude all.
        along = state.normal @ self.rows.target
        mean = self.unit(jnp.abs(along) * normal + jnp.abs(line.along) * state.normal)
        none = (state.share < 1) & self.excludes_all(mean)
        near = state._replace(phase=jnp.where(none, NONE, NEAR), share=1.0)
        return _where(possible, _where(falls, lower, state._replace(phase=DONE)), near)

    def _cut_nearly(self, state: SearchState, normal: Array) -> SearchState:
        """Cut where shares count as rendered within the tolerance; the last share is that of the line's angle."""
        line = self.line(normal)
        most = line.moved(self.tolerance)
        beyond = (state.share * most.along > most.reach) & ~((most.along > 0) & (most.largest() >= state.share))
        angle = jnp.clip(2 - 2 * line.along / (GRAZING * self.length), 0, 1)
        chosen = _where(beyond, most, line.moved(angle * self.tolerance))
        falls = (chosen.along > 0) & (chosen.largest() < state.share)
        falls &= (state.share < 1) | (line.along - line.reach > self.tolerance)
        none = beyond & ~(most.along > 0) & (state.share < 1)
        lower = SearchState(jnp.where(beyond, NEAR, LAST), chosen.largest(), normal, state.answer)
        after = _where(falls, lower, state._replace(phase=DONE, normal=normal))
        return _where(none, state._replace(phase=NONE), after)

    def _reopened(self, state: SearchState) -> SearchState:
        """Try a larger share within tolerance where the wrench grazes the line that allows no larger one."""
        line = self.line(state.normal)
        clear = line.along - line.reach > self.tolerance
        most = line.moved(self.tolerance)
        share = jnp.where(clear & (most.along > 0), jnp.minimum(most.largest(), 1.0), 1.0)
        over = clear & (line.along >= GRAZING * self.length)
        return state._replace(phase=jnp.where(over, DONE, NEAR), share=jnp.where(over, state.share, share))


def along_wrench(
    rows: Rows, whole: Answer, rendered: Array, nearest: tuple[Array, Array], *arrays: Array
) -> tuple[Array, Array]:
    """Return the tensions of the largest feasible share of a wrench, or the nearest ones where there is none.

    ``whole`` answers the whole wrench, and does so exactly where ``rendered``.
    """
    structure, wrench, lower, upper, _ = arrays
    size = jnp.sum(jnp.abs(structure) @ jnp.maximum(jnp.abs(lower), jnp.abs(upper)))
    length, rounding = jnp.linalg.norm(wrench), _rounding(structure)
    tolerance = max(TOLERANCE, 16.0 * rounding) * jnp.maximum(1.0, jnp.minimum(length, size))
    search = Search(rows, lower, upper, length, tolerance, rounding * size)

    def advance(step: tuple[SearchState, Array]) -> tuple[SearchState, Array]:
        after = search.cut(step[0])
        problem = rows.bounded(search.metric(after.phase), after.share, *arrays[2:])
        return after._replace(answer=solve(problem, after.phase >= DONE, after.answer)), step[1] + 1

    def unfinished(step: tuple[SearchState, Array]) -> Array:
        return (step[0].phase < DONE) & (step[1] < CUTS)

    start = SearchState(
        jnp.where(rendered, DONE, EXACT), jnp.ones_like(length), jnp.zeros_like(rows.target), whole
    )
    state, _ = jax.lax.while_loop(unfinished, advance, (start, 0))
    tensions, optimal, _ = state.answer
    return _where(state.phase == NONE, nearest, (tensions, optimal & (state.phase == DONE)))


def _rounding(array: Array) -> float:
    """Return the share of a sum's size that rounding may change."""
    return 64.0 * float(jnp.finfo(array.dtype).eps)


def _where(condition: Array, first: Arrays, second: Arrays) -> Arrays:
    """Return the first of two tuples of arrays where a condition holds, else the second."""
    chosen: Arrays = jax.tree.map(partial(jnp.where, condition), first, second)
    return chosen
