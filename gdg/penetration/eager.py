"""Penetration by plain tensor operations: the reference, on any device."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.geometry.sdf import SignedDistanceGrid
from gdg.geometry.sdf_stack import SdfStack
from gdg.kinds.hand_model import HandModel


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
        torch.maximum(at_points.amax(-1), in_spheres.amax(-1)),
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
