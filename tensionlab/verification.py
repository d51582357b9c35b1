"""Certificates: what is proved about an answer, by any solver.

Whoever chose the tensions, they are clipped into their limits, the wrench is recomputed, and a status needs
a certificate that anyone can check (``tensionlab/native/verification/certificates.cpp``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import ShapeError
from tensionlab.solvers.base import RANK_TOLERANCE, TOLERANCE, Answer, Problem, Status, Verified
from tensionlab.solvers.compiled import rule_of
from tensionlab.solvers.least_squares import Newton
from tensionlab.support.arrays import Floats


def verify(problem: Problem, answer: Answer) -> Verified:
    """Clip and measure a solver's answer, and certify what can be proved about it.

    Nothing in the answer is believed; where a policy needs a separating direction that it lacks, one is derived.
    """
    size, n, _ = problem.structure.shape
    tensions = _writable(require_answer(problem, answer).tensions)
    proposed = answer.separation is not None
    separation = _writable(answer.separation) if answer.separation is not None else np.zeros((size, n))
    wrench, residual, status, scale, flawed = _certify(problem, tensions, separation)
    failures: dict[int, str] = {}
    if flawed:
        unproved = np.flatnonzero(status == Status.UNPROVEN)
        if problem.policy == "direction" and not proposed and unproved.size:
            # That proof needs a direction that no error vector supplies: ask the exact solver for one.
            part, proposal = problem.take(unproved), tensions[unproved]
            proof = _writable(Newton().solve(part).separation)
            _, _, status[unproved], scale[unproved], _ = _certify(part, proposal, proof)
            separation[unproved] = proof
        failed = map(int, np.flatnonzero(status == Status.FAILED))
        failures = {row: answer.failures.get(row, "the solver returned NaN") for row in failed}
    iterations = np.asarray(answer.iterations, dtype=np.int64)
    return Verified(tensions, wrench, residual, status, scale, iterations, separation, failures)


def require_answer(problem: Problem, answer: Answer) -> Answer:
    """Return what a solver returned; TypeError or ShapeError if that is no answer to the whole batch."""
    if not isinstance(answer, Answer):
        raise TypeError(f"the solver returned {type(answer).__name__}; return Answer(tensions, iterations)")
    size, _, m = problem.structure.shape
    for name, shape in (("tensions", (size, m)), ("iterations", (size,))):
        if np.shape(getattr(answer, name)) != shape:
            raise ShapeError(f"the solver returned {name} of shape {np.shape(getattr(answer, name))}, not {shape}")
    return answer


def _writable(array: Floats | None) -> Floats:
    """Return an array that verification may write to: the solver's own, or a copy of a read-only one."""
    return np.require(array, np.float64, ("C_CONTIGUOUS", "WRITEABLE"))


def _certify(
    problem: Problem, tensions: Floats, separation: Floats
) -> tuple[Floats, Floats, NDArray[np.int8], Floats, bool]:
    """Clip tensions in place, verify them, and store the proof in ``separation`` (`certificates.cpp`)."""
    rule = rule_of(problem.policy)
    return _native.verify(problem.arrays, tensions, separation, rule, TOLERANCE, RANK_TOLERANCE)
