"""Where points of a hand's links are in the world, given the poses of the links.

On the CPU by code that numba compiles (``compiled.py``), which holds no matrix per point;
elsewhere, and as the reference, by tensor operations (``eager.py``).
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from gdg.placement import eager

__all__ = ["place_points"]


def place_points(
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    points: Float[Tensor, "*batch point 3"],
    link_index: Int[Tensor, "*batch point"],
) -> Float[Tensor, "batch point 3"]:
    """Link-frame points in the world, differentiable in poses and points.

    On the CPU once only; higher derivatives are those of ``eager.py``.

    Args:
        Ts_world_link: link poses; metres.
        points: in the frame of their link, metres; the same for all poses, or each pose's own.
        link_index: the link of each point, of the same shape.

    Raises:
        ValueError: shapes that don't belong together.
        IndexError: a link that there is not.
    """
    own = (len(Ts_world_link),) if points.ndim == 3 else ()
    if link_index.shape != points.shape[:-1] or link_index.shape != (*own, points.shape[-2]):
        raise ValueError(
            f"points {tuple(points.shape)} and link_index {tuple(link_index.shape)} must be those "
            f"of every pose or of {len(Ts_world_link)} poses."
        )
    single = Ts_world_link.dtype == points.dtype == torch.float32
    if Ts_world_link.device.type == "cpu" and single:
        links = Ts_world_link.shape[1]  # the compiled pass takes any index, and reads anything
        if link_index.numel() and not 0 <= int(link_index.min()) <= int(link_index.max()) < links:
            raise IndexError(f"link_index must lie in [0, {links}).")
        placed: Any = _Placed.apply(Ts_world_link, points, link_index)
        return placed
    if link_index.ndim == 1:
        return eager.place_shared(Ts_world_link, points, link_index)
    return eager.place_each(Ts_world_link, points, link_index)


class _Placed(torch.autograd.Function):
    """The compiled pass and its transpose."""

    @staticmethod
    def forward(ctx: Any, Ts: Tensor, points: Tensor, link_index: Tensor) -> Tensor:
        from gdg.placement import compiled  # compiles (or loads its cache) on import

        ctx.save_for_backward(Ts, points, link_index)
        return torch.from_numpy(compiled.place(*_arrays(Ts, points, link_index)))

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, *grads: Tensor
    ) -> tuple[Tensor, Tensor | None, None]:
        from gdg.placement import compiled

        Ts, points, link_index = ctx.saved_tensors
        grad = grads[0].contiguous().numpy()
        arrays = _arrays(Ts, points, link_index)
        to_poses = torch.from_numpy(compiled.pull_to_poses(grad, *arrays))
        if not ctx.needs_input_grad[1]:
            return to_poses, None, None
        to_points = torch.from_numpy(compiled.pull_to_points(grad, *arrays))
        return to_poses, to_points if points.ndim == 3 else to_points.sum(0), None


def _arrays(Ts: Tensor, points: Tensor, link_index: Tensor) -> tuple[Any, Any, Any]:
    """What the compiled passes take; points that all poses share get a batch axis of length 1."""
    shared = points.ndim == 2
    parts = (Ts, points[None] if shared else points, link_index[None] if shared else link_index)
    return tuple(part.detach().contiguous().numpy() for part in parts)  # pyright: ignore[reportReturnType]
