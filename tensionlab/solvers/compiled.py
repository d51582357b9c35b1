"""Base class of the solvers that are compiled: one way for all of them from arrays to verified tensions."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, TypeVar

from tensionlab import _native
from tensionlab.solvers.base import POLICIES, RANK_TOLERANCE, TOLERANCE, Answer, Policy, Problem, Verified
from tensionlab.support.arrays import MAX_MAGNITUDE, Floats

Result = TypeVar("Result")  # class whose fields are those of `Verified`


def rule_of(policy: Policy | None) -> int:
    """Return the number of the rule by which the kernels verify infeasible wrenches; 0 without a policy."""
    return 0 if policy is None else 1 + POLICIES.index(policy)


class CompiledSolver:
    """Built-in solver that chooses and verifies tensions in one pass over a batch, compiled.

    A family adds its hyper-parameters, as a frozen dataclass, and `_compiled`. The interface in C++ is
    ``native/solvers/tension_solver.hpp``.
    """

    policies: ClassVar[tuple[Policy, ...]] = ()

    def _compiled(self) -> _native.TensionSolver:
        """Return the compiled solver with these hyper-parameters."""
        raise NotImplementedError

    def solve(self, problem: Problem) -> Answer:
        """Choose tensions for every problem of the batch."""
        return Answer(*self._compiled().choose(problem.arrays, rule_of(problem.policy)))

    def solve_verified(self, problem: Problem) -> Verified | None:
        """Choose and verify tensions; None if an entry of a structure matrix or a wrench is not finite."""
        verified = self._compiled().allocate(
            problem.arrays, rule_of(problem.policy), MAX_MAGNITUDE, TOLERANCE, RANK_TOLERANCE
        )
        return None if verified is None else Verified(*verified)

    def prepare(
        self,
        lower: Floats,
        upper: Floats,
        reference: Floats,
        weights: Floats,
        policy: Policy | None,
        result: type[Result],
    ) -> Callable[[object, object], Result | None]:
        """Return what allocates for one structure matrix and wrench with these limits, (m,), and so on.

        It returns None where the two are not float64 arrays of the right shapes, contiguous and finite; the wrench
        may be a list of numbers.
        """
        numbers = (rule_of(policy), MAX_MAGNITUDE, TOLERANCE, RANK_TOLERANCE)
        return _native.prepare_call(self._compiled(), lower, upper, reference, weights, *numbers, result)

    def unprepared(
        self, result: type[Result]
    ) -> Callable[[object, object, object, object, object], Result | None]:
        """Return what allocates for one structure matrix, wrench, limits, reference and policy.

        It returns None where structure and wrench are not as `prepare` wants them, where a limit is not such an
        array, a list of numbers or a number, where the limits cross, where the solver refuses the size or the
        policy, and where the reference is not None, "lower" or "middle".
        """
        rules: dict[str | None, int] = {policy: rule_of(policy) for policy in self.policies}
        rules |= {None: next(iter(rules.values()), rule_of(None))}
        refuses = getattr(self, "refuses", None)
        numbers = (MAX_MAGNITUDE, TOLERANCE, RANK_TOLERANCE)
        return _native.unprepared_call(self._compiled(), rules, refuses, *numbers, result)
