"""Which links touch an object, and which cross each other; no gradients."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration import eager
from gdg.penetration.blocks import link_blocks, pose_array


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

    found = compiled.touching_links(
        pose_array(Ts_world_link),
        obj.sdf.values.numpy(),
        obj.sdf.origin.numpy(),
        obj.sdf.spacing,
        *link_blocks(hand).shape_arguments,
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

    found = compiled.crossing_pairs(pose_array(Ts_world_link), *link_blocks(hand).pair_arguments)
    return torch.from_numpy(found)


def link_pairs(hand: HandModel) -> Int[Tensor, "link_pair 2"]:
    """Pairs of links that must not overlap."""
    return torch.as_tensor(link_blocks(hand).link_pairs, device=hand.device)
