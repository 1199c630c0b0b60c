"""Penetration by plain tensor operations: the reference, on any device."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.geometry.sdf import SignedDistanceGrid
from gdg.geometry.sdf_stack import SdfStack
from gdg.kinds.hand_model import HandModel
from gdg.penetration.blocks import link_blocks


def object_penetration(
    hand: HandModel,
    sdf: SignedDistanceGrid | SdfStack,
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    stride: int,
    margin_m: float = 0.0,
) -> tuple[Float[Tensor, "batch"], Float[Tensor, "batch"]]:
    """Sum and largest term; see ``gdg.penetration.penetration``.

    Keeps some 90 bytes per pose and surface point for gradients.
    """
    spheres, surface = hand.spheres, hand.surface
    centers = hand.place(Ts_world_link, spheres.centers, spheres.link_index)
    in_spheres = torch.relu(margin_m + spheres.radii - sdf.distance(centers))
    points = hand.place(Ts_world_link, surface.points[::stride], surface.link_index[::stride])
    at_points = torch.relu(margin_m - sdf.distance(points))
    return (
        stride * at_points.sum(-1) + in_spheres.sum(-1),
        torch.nn.functional.pad(torch.cat((at_points, in_spheres), dim=-1), (0, 1)).amax(-1),
    )


def self_penetration(
    hand: HandModel, Ts_world_link: Float[Tensor, "batch link 4 4"]
) -> Float[Tensor, "batch"]:
    """Summed overlap; see ``gdg.penetration.self_penetration``.

    Keeps some 12 bytes per pose and pair of spheres for gradients.
    """
    spheres = hand.spheres
    centers = hand.place(Ts_world_link, spheres.centers, spheres.link_index)
    squared = centers.square().sum(-1)
    # |a|² + |b|² − 2 a·b by a matrix product: rounding is about 1e-8 m², 0.1 mm at contact
    gap = squared[:, :, None] + squared[:, None] - 2 * centers @ centers.mT
    overlap = spheres.reach - gap.clamp(min=1e-8).sqrt()
    return torch.relu(overlap).sum((-1, -2))


def touching_links(
    hand: HandModel,
    sdf: SignedDistanceGrid,
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    margin_m: float,
) -> Bool[Tensor, "batch link"]:
    """See ``gdg.penetration.touching_links``."""
    spheres, surface = hand.spheres, hand.surface
    centers = hand.place(Ts_world_link, spheres.centers, spheres.link_index)
    points = hand.place_surface(Ts_world_link)
    gaps = torch.cat((sdf.distance(points), sdf.distance(centers) - spheres.radii), dim=-1)
    link = torch.cat((surface.link_index, spheres.link_index))
    nearest = gaps.new_full(Ts_world_link.shape[:2], torch.inf)
    return nearest.scatter_reduce(1, link.expand_as(gaps), gaps, "amin") <= margin_m


def crossing_pairs(
    hand: HandModel, Ts_world_link: Float[Tensor, "batch link 4 4"]
) -> Bool[Tensor, "batch link_pair"]:
    """See ``gdg.penetration.crossing_pairs``."""
    blocks = link_blocks(hand)
    device = Ts_world_link.device
    spheres = torch.as_tensor(blocks.spheres, device=device)
    link = torch.as_tensor(blocks.sphere_links, device=device)
    centers = hand.place(Ts_world_link, spheres[:, :3], link)
    first, second = torch.as_tensor(blocks.pairs, device=device).unbind(-1)
    apart = (centers[:, first] - centers[:, second]).norm(dim=-1)
    overlaps = (apart < torch.as_tensor(blocks.reach, device=device)).to(torch.uint8)
    counts = torch.as_tensor(np.diff(blocks.pair_starts), device=device)
    group = torch.arange(len(counts), device=device).repeat_interleave(counts)
    found = overlaps.new_zeros(len(Ts_world_link), len(counts))
    return found.scatter_reduce(1, group.expand_as(overlaps), overlaps, "amax") > 0
