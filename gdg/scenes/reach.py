"""Where on an object that rests on a table fingers get."""

from __future__ import annotations

import torch
from jaxtyping import Bool
from torch import Tensor

from gdg.objects.model import ObjectModel

#: A fingertip is a ball of this radius, metres; about that of a ShadowHand's.
FINGER_RADIUS_M = 0.007


def reachable(obj: ObjectModel) -> Bool[Tensor, "object_point"]:
    """The object points that a fingertip can touch without going below the table.

    The ball's centre lies a radius off the surface along the normal, and must be a radius above
    the table. Without a table these are all points.
    """
    if obj.table is None:
        return torch.ones(len(obj.points), dtype=torch.bool, device=obj.points.device)
    up = torch.as_tensor(obj.table.up).to(obj.points)
    centers = obj.points + FINGER_RADIUS_M * obj.normals
    return centers @ up - obj.table.offset >= FINGER_RADIUS_M
