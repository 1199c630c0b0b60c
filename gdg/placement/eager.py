"""Placing points by plain tensor operations: the reference, on any device."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor


def place_shared(
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    points: Float[Tensor, "point 3"],
    link_index: Int[Tensor, "point"],
) -> Float[Tensor, "batch point 3"]:
    """All points by one matrix product, far cheaper (backward too) than a matrix per point."""
    batch, links = Ts_world_link.shape[:2]
    lift = points.new_zeros(links, 4, len(points))
    columns = torch.arange(len(points), device=points.device)
    lift[link_index, :3, columns] = points
    lift[link_index, 3, columns] = 1.0
    flat = Ts_world_link[:, :, :3].transpose(1, 2).reshape(batch, 3, 4 * links)
    return (flat @ lift.reshape(4 * links, len(points))).mT


def place_each(
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    points: Float[Tensor, "batch point 3"],
    link_index: Int[Tensor, "batch point"],
) -> Float[Tensor, "batch point 3"]:
    """Points that each pose has by itself."""
    T = poses_of(Ts_world_link, link_index)
    return (T[..., :3, :3] @ points[..., None])[..., 0] + T[..., :3, 3]


def poses_of(
    Ts_world_link: Float[Tensor, "batch link 4 4"], link_index: Int[Tensor, "*batch point"]
) -> Float[Tensor, "batch point 4 4"]:
    """The pose of the link that each point is on."""
    # index_select and gather have far cheaper backward passes than advanced indexing
    if link_index.ndim == 1:
        return torch.index_select(Ts_world_link, 1, link_index)
    spread = link_index[..., None, None].expand(-1, -1, 4, 4)
    return torch.gather(Ts_world_link, 1, spread)
