"""Allocation as a differentiable function of PyTorch tensors: the one door to PyTorch, of the extra ``torch``."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tensionlab.errors import InputError, optional_import
from tensionlab.gradients import allocation_jacobian
from tensionlab.solvers.base import Policy

if TYPE_CHECKING:
    import torch

__all__ = ["allocate"]


def allocate(
    structure: torch.Tensor,
    wrench: torch.Tensor,
    limits: Any,
    reference: torch.Tensor | Literal["lower", "middle"] | None = None,
    policy: Policy | None = None,
    wrench_weights: ArrayLike | None = None,
) -> torch.Tensor:
    """Return the tensions of `tensionlab.allocate`, through which gradients go back.

    Arguments are those of `tensionlab.allocate` with newton as the solver, as tensors on any device; ``limits``
    may be a pair. The whole batch is one call, forwards and backwards, on the processor, in float64; the tensions
    have the type and the device of ``structure``.

    Gradients go to all tensors but the weights, as `tensionlab.AllocationJacobian.pull_back` has them. Second
    derivatives, which are zero or jumps in most respects, are refused by PyTorch. Errors are those of
    `tensionlab.allocate`; MissingDependency if PyTorch is not installed.
    """
    with optional_import("torch", "tensionlab.interop.torch"):
        import torch

    def tensor(given: Any) -> Any:
        # A copy of arrays: those of a rig may not be written to, and PyTorch knows no such tensors.
        return given if isinstance(given, torch.Tensor) else torch.tensor(np.asarray(given))

    lower, upper = map(tensor, limits if isinstance(limits, tuple) else (limits.lower, limits.upper))
    words = {"lower": lower, "middle": (lower + upper) / 2}
    if isinstance(reference, str) and reference not in words:
        raise InputError(f"reference {reference!r} is unknown; give tensions, 'lower' or 'middle'")
    near = words[reference] if isinstance(reference, str) else 0.0 if reference is None else reference
    tensors = map(tensor, (structure, wrench, lower, upper, near))
    tensions: torch.Tensor = _function().apply(*tensors, policy, wrench_weights)
    return tensions


@cache
def _function() -> Any:
    import torch

    class Allocate(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, *given: Any) -> Any:
            *tensors, policy, weights = given
            structure, wrench, lower, upper, reference = (
                tensor.detach().to("cpu", torch.float64).numpy() for tensor in tensors
            )
            ctx.jacobian = allocation_jacobian(
                structure,
                wrench,
                (lower, upper),
                reference=reference,
                policy=policy,
                wrench_weights=None if weights is None else np.asarray(weights),
            )
            ctx.like = [(tensor.shape, tensor.dtype, tensor.device) for tensor in tensors]
            first = tensors[0]
            dtype = first.dtype if first.dtype.is_floating_point else torch.get_default_dtype()
            return torch.tensor(ctx.jacobian.allocation.tensions, dtype=dtype, device=first.device)

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, cotangent: Any) -> Any:
            gradients = ctx.jacobian.pull_back(cotangent.to("cpu", torch.float64).numpy())
            own = [
                torch.from_numpy(gradient).sum_to_size(shape).to(device, dtype)
                for gradient, (shape, dtype, device) in zip(gradients, ctx.like, strict=True)
            ]
            return *own, None, None

    return Allocate
