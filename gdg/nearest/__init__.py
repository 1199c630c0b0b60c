"""The hand point that minimises the aligned distance, per object point.

On the CPU a search compiled by numba; on a GPU one kernel that torch's compiler generates; where
that has no Triton a blocked search in plain tensor operations. All score every pair, and none holds
object × hand for a whole batch, let alone × 3. The winning pair's distance is then computed by the
caller, exactly and differentiably.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.nearest.eager import nearest_exhaustive
from gdg.nearest.fused import can_fuse, nearest_fused

#: The release divides by d + ε, metres, so that a coinciding point has no direction.
EPSILON_M = 1e-5


@torch.no_grad()
def nearest_hand_points(
    object_points: Float[Tensor, "object_point 3"],
    object_normals: Float[Tensor, "object_point 3"],
    hand_points: Float[Tensor, "batch hand_point 3"],
    gamma: float,
) -> Int[Tensor, "batch object_point"]:
    """Index of the hand point h that minimises d · exp(−2 γ ⟨u, n⟩), the lowest on ties.

    d = ‖h − o‖ and u = (h − o)/(d + ε); γ = 0 gives the Euclidean nearest point.

    Args:
        object_points: metres.
        object_normals: outward unit normals.
        hand_points: metres, same frame.
        gamma: weight of the alignment, from 0 to 4 (exp(±2γ) is approximated up to there).
    """
    if hand_points.device.type == "cpu":
        from gdg.nearest.compiled import nearest_compiled  # compiles (or loads its cache) on import

        index = nearest_compiled(
            object_points.float().numpy(),
            object_normals.float().numpy(),
            hand_points.float().contiguous().numpy(),
            gamma,
            EPSILON_M,
        )
        return torch.from_numpy(index)
    search = nearest_fused if can_fuse(hand_points.device) else nearest_exhaustive
    return search(object_points, object_normals, hand_points, gamma, EPSILON_M)


def gather_points(
    hand_points: Float[Tensor, "batch hand_point 3"], index: Int[Tensor, "batch object_point"]
) -> Float[Tensor, "batch object_point 3"]:
    """The selected hand points; gradients flow into them alone."""
    return torch.gather(hand_points, 1, index[..., None].expand(-1, -1, 3))
