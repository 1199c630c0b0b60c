"""Penetration by the nearest object point, as the release of GenDexGrasp has it."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.objects.model import ObjectModel


def nearest_point_penetration(
    obj: ObjectModel, hand_points: Float[Tensor, "batch hand_point 3"]
) -> Float[Tensor, "batch"]:
    """Mean over hand points of [inside] · ‖h − nn(h)‖, metres: the release's form.

    nn is the nearest of the object's surface points; inside means (nn − h) · n_nn > 0. Gradients
    flow through h alone. Holds batch × hand × object distances in blocks of one batch element.
    """
    with torch.no_grad():
        index = torch.stack([torch.cdist(h, obj.points).argmin(-1) for h in hand_points])
    difference = obj.points[index] - hand_points
    inside = (difference * obj.normals[index]).sum(-1) > 0
    length = (difference.square().sum(-1) + 1e-16).sqrt()
    return torch.where(inside, length, torch.zeros_like(length)).mean(-1)
