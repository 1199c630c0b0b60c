"""Energy terms that planners and fitters share; every one is ≥ 0 and per batch element."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel


@dataclass(frozen=True)
class Penetration:
    """How much of a hand lies inside an object.

    Attributes:
        summed: Σ over surface points of relu(−δ) plus Σ over inscribed spheres of
            relu(radius − δ(centre)), metres. The paper sums over points alone, between which a
            cup's wall goes unseen; a sphere that a wall cuts is always seen.
        depth: the largest single term, metres: a lower bound of the true penetration depth.
    """

    summed: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]


def penetration(
    hand: HandModel,
    obj: ObjectModel,
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    stride: int = 1,
) -> Penetration:
    """Penetration of the hand with the given link poses; δ is the object's signed distance.

    Args:
        hand: the hand.
        obj: the object.
        Ts_world_link: link poses; metres.
        stride: only every so-manieth surface point is tested, and its term multiplied by
            ``stride``, so that the sum keeps its size.
    """
    spheres = hand.spheres
    centers = hand.place(Ts_world_link, spheres.centers, spheres.link_index)
    in_spheres = torch.relu(spheres.radii - obj.sdf.distance(centers))
    surface = hand.surface
    points = hand.place(Ts_world_link, surface.points[::stride], surface.link_index[::stride])
    at_points = torch.relu(-obj.sdf.distance(points))
    return Penetration(
        summed=stride * at_points.sum(-1) + in_spheres.sum(-1),
        depth=torch.maximum(at_points.amax(-1), in_spheres.amax(-1)),
    )


def penetration_depth(
    hand: HandModel, obj: ObjectModel, q: Float[Tensor, "batch dof"]
) -> Float[Tensor, "batch"]:
    """``Penetration.depth`` of the hand in the poses q, metres."""
    return penetration(hand, obj, hand.link_poses(q)).depth


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
