"""Which links touch an object, and which cross each other; no gradients."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration import eager
from gdg.penetration.blocks import link_blocks


def touching_links(
    hand: HandModel,
    obj: ObjectModel,
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    margin_m: float = 0.0,
) -> Bool[Tensor, "batch link"]:
    """Whether a surface point or inscribed sphere of each link is inside or ``margin_m`` near."""
    if Ts_world_link.device.type != "cpu":
        return eager.touching_links(hand, obj.sdf, Ts_world_link, margin_m)
    from gdg.penetration import compiled  # compiles (or loads its cache) on import

    blocks = link_blocks(hand)
    found = compiled.touching_links(
        Ts_world_link.detach().float().contiguous().numpy(),
        obj.sdf.values.numpy(),
        obj.sdf.origin.numpy(),
        obj.sdf.spacing,
        blocks.balls,
        blocks.points,
        blocks.point_starts,
        blocks.spheres,
        blocks.sphere_starts,
        margin_m,
    )
    return torch.from_numpy(found)


def crossing_pairs(
    hand: HandModel, Ts_world_link: Float[Tensor, "batch link 4 4"]
) -> Bool[Tensor, "batch link_pair"]:
    """Whether the links of each of ``link_pairs`` overlap by their inscribed spheres."""
    if Ts_world_link.device.type != "cpu":
        return eager.crossing_pairs(hand, Ts_world_link)
    from gdg.penetration import compiled

    blocks = link_blocks(hand)
    found = compiled.crossing_pairs(
        Ts_world_link.detach().float().contiguous().numpy(),
        blocks.balls,
        blocks.link_pairs,
        blocks.pair_starts,
        blocks.pairs,
        blocks.reach,
        blocks.spheres,
    )
    return torch.from_numpy(found)


def link_pairs(hand: HandModel) -> Int[Tensor, "link_pair 2"]:
    """Pairs of links that must not overlap."""
    return torch.as_tensor(link_blocks(hand).link_pairs, device=hand.device)
