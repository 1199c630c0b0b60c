"""Training losses of GraspCVAE (Jiang et al. 2021, Section 3.2), lengths in centimetres."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.rotations import ROOT_DIM, rotation_from_rot6d

#: Weights of the sum. With 0.05 per nat, a latent may cost as much as 5 mm off by each of some
#: twenty degrees of freedom.
PARAMETER_WEIGHT = 5.0
KL_WEIGHT = 0.05
CONTACT_WEIGHT = 10.0
TOUCH_WEIGHT = 0.5
PENETRATION_WEIGHT = 10.0
CONTACT_NET_WEIGHT = 10.0
#: A pad nearer than this is meant to touch, centimetres (the published code's 2 cm).
NEAR_CM = 2.0
#: Exponent of the weight that lets contacts count more than the far side, as in the maps' CVAE.
CONTACT_EXPONENT = 3.0
CM = 100.0


@dataclass(frozen=True)
class Beside:
    """Which points are nearest, hand and object side by side; no gradients.

    Attributes:
        hand_of_object: for each object point its nearest hand point.
        object_of_hand: for each hand point its nearest object point.
        object_of_pad: for each pad point its nearest object point.
    """

    hand_of_object: Tensor
    object_of_hand: Tensor
    object_of_pad: Tensor


@torch.no_grad()
def nearest(
    points: Float[Tensor, "batch object_point 3"],
    hand_points: Float[Tensor, "batch hand_point 3"],
    pads: Float[Tensor, "batch pad 3"],
) -> Beside:
    """The nearest points by Euclidean distance, of all pairs at once."""
    apart = torch.cdist(hand_points, points)
    return Beside(apart.argmin(1), apart.argmin(2), torch.cdist(pads, points).argmin(2))


def parameter_loss(
    q: Float[Tensor, "batch dof"],
    predicted: Float[Tensor, "batch dof"],
    joint_half: Float[Tensor, "joint"],
    grip: Float[Tensor, "3"],
) -> Float[Tensor, ""]:
    """Squared error of q: grip in decimetres, rot6d, joints in halves of their range.

    The grip's place is compared, not the root's, as it is what the network gives.

    Args:
        q: true pose vectors.
        predicted: pose vectors.
        joint_half: halves of the joints' ranges.
        grip: its middle in the root frame, metres.
    """
    shift = (10 * (_grips(predicted, grip) - _grips(q, grip))).square().sum(-1)
    turn = (predicted - q)[:, 3:ROOT_DIM].square().sum(-1)
    joints = (predicted - q)[:, ROOT_DIM:] / joint_half.clamp(min=1e-3)
    return (shift + turn + joints.square().mean(-1)).mean()


def surface_loss(
    hand_points: Float[Tensor, "batch hand_point 3"],
    predicted: Float[Tensor, "batch hand_point 3"],
) -> Float[Tensor, ""]:
    """Mean squared distance of corresponding hand points, cm²."""
    return (CM * (predicted - hand_points)).square().sum(-1).mean()


def kl_divergence(
    mean: Float[Tensor, "batch latent"], log_variance: Float[Tensor, "batch latent"]
) -> Float[Tensor, ""]:
    """KL of N(mean, exp(log_variance)) from N(0, I): summed over the latent, batch average."""
    summands = mean.square() + log_variance.exp() - 1 - log_variance
    return 0.5 * summands.sum(-1).mean()


def proximity(distance_m: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The paper's contact value of a distance: 1 − 2 (sigmoid(2 D) − ½), D in centimetres."""
    return 2 * torch.sigmoid(-2 * CM * distance_m)


def consistency_loss(
    points: Float[Tensor, "batch object_point 3"],
    hand_points: Float[Tensor, "batch hand_point 3"],
    predicted: Float[Tensor, "batch hand_point 3"],
    index: Tensor,
    predicted_index: Tensor,
) -> Float[Tensor, ""]:
    """Object-centric loss: mean difference of the object's contact values under both hands."""
    wanted = proximity(_gaps(points, hand_points, index))
    return (proximity(_gaps(points, predicted, predicted_index)) - wanted).abs().mean()


def touch_loss(
    pads: Float[Tensor, "batch pad 3"],
    points: Float[Tensor, "batch object_point 3"],
    index: Tensor,
) -> Float[Tensor, ""]:
    """Hand-centric loss: mean distance of pad points near the object from it, cm; others 0."""
    gap = CM * _gaps(pads, points, index)
    return torch.where(gap < NEAR_CM, gap, torch.zeros_like(gap)).mean()


def penetration_loss(
    hand_points: Float[Tensor, "batch hand_point 3"],
    points: Float[Tensor, "batch object_point 3"],
    normals: Float[Tensor, "batch object_point 3"],
    index: Tensor,
) -> Float[Tensor, ""]:
    """Mean distance of inside hand points from their nearest object points, cm.

    A point is inside when it lies behind the surface at its nearest object point, as in the
    release of GenDexGrasp; the paper tests object points against the hand's mesh.
    """
    spread = index[..., None].expand(-1, -1, 3)
    offset = hand_points - points.gather(1, spread)
    inside = (offset * normals.gather(1, spread)).sum(-1) < 0
    depth = CM * (offset.square().sum(-1) + 1e-12).sqrt()
    return torch.where(inside, depth, torch.zeros_like(depth)).mean()


def map_loss(
    values: Float[Tensor, "batch object_point"], predicted: Float[Tensor, "batch object_point"]
) -> Float[Tensor, ""]:
    """sqrt(Σ w (c − ĉ)² / Σ w) over points, w = exp(3 c), averaged over the batch."""
    weight = torch.exp(CONTACT_EXPONENT * values)
    squared = (weight * (values - predicted).square()).sum(-1) / weight.sum(-1)
    return (squared + 1e-12).sqrt().mean()


def _grips(q: Float[Tensor, "batch dof"], grip: Float[Tensor, "3"]) -> Float[Tensor, "batch 3"]:
    """Where the middle of the grip is, metres."""
    return q[:, :3] + rotation_from_rot6d(q[:, 3:ROOT_DIM]) @ grip


def _gaps(
    points: Float[Tensor, "batch point 3"], others: Float[Tensor, "batch other 3"], index: Tensor
) -> Float[Tensor, "batch point"]:
    """Distances of points from the others with the given indices, metres."""
    found = others.gather(1, index[..., None].expand(-1, -1, 3))
    return ((points - found).square().sum(-1) + 1e-12).sqrt()
