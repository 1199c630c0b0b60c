"""How much of a hand is inside an object (or the table it rests on), and inside itself.

On the CPU by code that numba compiles, which gives values and gradients in one pass
(``compiled.py``); elsewhere, and as the reference, by tensor operations (``eager.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gdg.geometry.sdf_stack import SdfStack
from gdg.kinds.hand_model import HandModel
from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel
from gdg.penetration import eager
from gdg.penetration.blocks import link_blocks, pose_array
from gdg.penetration.nearest_point import nearest_point_penetration
from gdg.penetration.table import table_penetration

__all__ = [
    "Penetration",
    "nearest_point_penetration",
    "penetration",
    "penetration_depth",
    "self_penetration",
    "table_penetration",
]


@dataclass(frozen=True)
class Penetration:
    """How much of a hand lies inside an object, and inside the table that it rests on.

    Attributes:
        summed: Σ over surface points of relu(−δ) plus Σ over inscribed spheres of
            relu(radius − δ(centre)), metres. The paper sums over points alone, between which a
            cup's wall goes unseen; a sphere that a wall cuts is always seen. On a table, the
            same sum over −height is added.
        depth: the largest single term, metres: without a margin a lower bound of the true
            penetration depth. No gradient flows through it.
    """

    summed: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]


def penetration(
    hand: HandModel,
    obj: ObjectModel | ObjectBatch,
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    stride: int = 1,
    margin_m: float = 0.0,
) -> Penetration:
    """Penetration of the hand with the given link poses, differentiable in them.

    Args:
        hand: the hand.
        obj: the object, whose signed distance is δ, or several, each with its share of the poses;
            each with the table that it rests on, if there is one.
        Ts_world_link: link poses; metres.
        stride: only every so-manieth surface point is tested, and its term multiplied by
            ``stride``, so that the sum keeps its size.
        margin_m: the hand counts as so much thicker all around, metres.
    """
    sdf = obj.sdf if isinstance(obj.sdf, SdfStack) else SdfStack.of([obj.sdf])
    if Ts_world_link.device.type == "cpu":
        found = Penetration(*_ObjectPenetration.apply(Ts_world_link, hand, sdf, stride, margin_m))
    else:
        summed, depth = eager.object_penetration(hand, sdf, Ts_world_link, stride, margin_m)
        found = Penetration(summed, depth.detach())
    tables = obj.tables if isinstance(obj, ObjectBatch) else (obj.table,)
    if not any(tables):
        return found
    summed, depth = table_penetration(hand, tables, Ts_world_link, stride, margin_m)
    return Penetration(found.summed + summed, torch.maximum(found.depth, depth))


def penetration_depth(
    hand: HandModel, obj: ObjectModel, q: Float[Tensor, "batch dof"]
) -> Float[Tensor, "batch"]:
    """``Penetration.depth`` of the hand in the poses q, metres."""
    return penetration(hand, obj, hand.link_poses(q)).depth


def self_penetration(
    hand: HandModel, Ts_world_link: Float[Tensor, "batch link 4 4"]
) -> Float[Tensor, "batch"]:
    """Summed overlap of inscribed spheres of links that must not touch, metres; differentiable."""
    if Ts_world_link.device.type == "cpu":
        summed: Any = _SelfPenetration.apply(Ts_world_link, hand)
        return summed
    return eager.self_penetration(hand, Ts_world_link)


class _ObjectPenetration(torch.autograd.Function):
    """The compiled pass, whose gradient is made along with the value."""

    @staticmethod
    def forward(
        ctx: Any,
        Ts: Tensor,
        hand: HandModel,
        sdf: SdfStack,
        stride: int,
        margin_m: float,
    ) -> tuple[Tensor, Tensor]:
        from gdg.penetration import compiled  # compiles (or loads its cache) on import

        blocks = link_blocks(hand, stride)
        poses = sdf.split(Ts.detach().float().contiguous())
        found = [
            compiled.object_penetration(
                own.numpy(),
                grid.values.numpy(),
                grid.origin.numpy(),
                grid.spacing,
                *blocks.shape_arguments,
                float(stride),
                margin_m,
            )
            for grid, own in zip(sdf.grids, poses)
        ]
        summed, deepest, gradient = (
            torch.from_numpy(parts[0] if len(parts) == 1 else np.concatenate(parts))
            for parts in zip(*found)
        )
        ctx.save_for_backward(gradient)
        ctx.mark_non_differentiable(deepest)
        return summed, deepest

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, None, None, None]:
        (gradient,) = ctx.saved_tensors
        return grads[0][:, None, None, None] * gradient, None, None, None, None


class _SelfPenetration(torch.autograd.Function):
    """The compiled pass, whose gradient is made along with the value."""

    @staticmethod
    def forward(ctx: Any, Ts: Tensor, hand: HandModel) -> Tensor:
        from gdg.penetration import compiled

        summed, gradient = compiled.self_penetration(
            pose_array(Ts), *link_blocks(hand).pair_arguments
        )
        ctx.save_for_backward(torch.from_numpy(gradient))
        return torch.from_numpy(summed)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        (gradient,) = ctx.saved_tensors
        return grads[0][:, None, None, None] * gradient, None
