"""Exhaustive search by matrix products over blocks; any device."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

#: Pairs scored at once on the GPU and CPU: 2^22 float32 are 16 MB per temporary.
BLOCK_PAIRS = 2**22


def nearest_exhaustive(
    object_points: Float[Tensor, "object_point 3"],
    object_normals: Float[Tensor, "object_point 3"],
    hand_points: Float[Tensor, "batch hand_point 3"],
    gamma: float,
    epsilon: float,
) -> Int[Tensor, "batch object_point"]:
    """See ``gdg.nearest.nearest_hand_points``.

    Squared distances come from |o|² + |h|² − 2 o·h of centred coordinates, whose rounding
    (about 1e-9 m²) only decides between pairs that are equally good to 1e-5.
    """
    batch, hands = hand_points.shape[:2]
    rows = max(1, BLOCK_PAIRS // max(1, hands))
    index = torch.empty(batch, len(object_points), dtype=torch.long, device=hand_points.device)
    center = object_points.mean(0)
    points, hand_points = object_points - center, hand_points - center
    # (o, 1, |o|²) · (−2h, |h|², 1) = |o − h|², and (n, −o·n) · (h, 1) = (h − o)·n
    left = torch.cat(
        (points, torch.ones_like(points[:, :1]), points.square().sum(-1, keepdim=True)), -1
    )
    along = torch.cat((object_normals, -(points * object_normals).sum(-1, keepdim=True)), -1)
    for b, hand in enumerate(hand_points):
        one = torch.ones_like(hand[:, :1])
        right = torch.cat((-2 * hand, hand.square().sum(-1, keepdim=True), one), -1).T
        lifted = torch.cat((hand, one), -1).T
        for start in range(0, len(points), rows):
            block = slice(start, start + rows)
            length = (left[block] @ right).clamp_(min=1e-12).sqrt_()
            alignment = (along[block] @ lifted).div_(length + epsilon)
            index[b, block] = length.log_().sub_(alignment, alpha=2 * gamma).argmin(-1)
    return index
