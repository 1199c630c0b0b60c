"""Equal patches of a surface, by halving its points again and again."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True)
class Patches:
    """Which points form which patch of each object.

    Attributes:
        members: indices of points, patch by patch; where the points don't divide evenly, some
            stand in it twice.
        slot: for each point, where it stands in the flattened ``members``.
    """

    members: Int[Tensor, "object patch member"]
    slot: Int[Tensor, "object object_point"]

    def gather(
        self, values: Float[Tensor, "object object_point channel"]
    ) -> Float[Tensor, "object patch member channel"]:
        """Values of points, arranged by patches."""
        objects, patches, size = self.members.shape
        index = self.members.flatten(1)[..., None].expand(-1, -1, values.shape[-1])
        return values.gather(1, index).view(objects, patches, size, -1)

    def scatter(
        self, values: Float[Tensor, "object patch member channel"]
    ) -> Float[Tensor, "object object_point channel"]:
        """Values arranged by patches, as values of points."""
        index = self.slot[..., None].expand(-1, -1, values.shape[-1])
        return values.flatten(1, 2).gather(1, index)


def split_into_patches(points: Float[Tensor, "object object_point 3"], count: int) -> Patches:
    """Patches of equally many points, each part halved along its longest extent.

    Args:
        points: in a frame whose axes mean something, since parts are cut across axes.
        count: number of patches, a power of two.
    """
    objects, total, _ = points.shape
    slots = -(-total // count) * count
    order = torch.arange(slots, device=points.device).expand(objects, -1)
    parts = 1
    while parts < count:
        order = order.reshape(objects, parts, -1)
        index = (order % total).flatten(1)[..., None].expand(-1, -1, 3)
        located = points.gather(1, index).view(objects, parts, -1, 3)
        axis = (located.amax(2) - located.amin(2)).argmax(-1)[..., None, None]
        along = located.gather(3, axis.expand(-1, -1, located.shape[2], 1))[..., 0]
        order = order.gather(2, along.argsort(dim=2, stable=True)).flatten(1)
        parts *= 2
    slot = order.argsort(1)[:, :total]
    return Patches((order % total).view(objects, count, -1), slot)
