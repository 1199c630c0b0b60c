"""Energy of a grasp with chosen contact points (GenDexGrasp, Section III-A)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.energies import penetration
from gdg.force_closure import force_closure_error
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel

from .options import DfcOptions


@dataclass(frozen=True)
class Contacts:
    """Contact points on a hand, as places in its contact regions.

    Attributes:
        region: index of each contact's region.
        place: logits of the bilinear coordinates in the region's quadrilateral.
    """

    region: Int[Tensor, "batch contact"]
    place: Float[Tensor, "batch contact 2"]


@dataclass(frozen=True)
class Terms:
    """Unweighted energy terms per chain, and the contact points they belong to."""

    force_closure: Float[Tensor, "batch"]
    distance: Float[Tensor, "batch"]
    normals: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]
    limits: Float[Tensor, "batch"]
    contact_distances: Float[Tensor, "batch contact"]
    contact_points: Float[Tensor, "batch contact 3"]


class GraspEnergy:
    """E = w_fc ‖G c‖ + w_d Σ|δ(x)| + w_n Σ(1 + ⟨n_h, n_o⟩) + w_p E_p + w_s E_self + w_l E_n."""

    def __init__(self, hand: HandModel, obj: ObjectModel, options: DfcOptions):
        self.hand, self.obj, self.options = hand, obj, options
        self._center = obj.center_of_mass.to(hand.device)

    def terms(self, q: Float[Tensor, "batch dof"], contacts: Contacts, stride: int = 1) -> Terms:
        """All terms, differentiable in q and in the contacts' places.

        ``stride`` thins the surface points of the penetration term.
        """
        hand, sdf = self.hand, self.obj.sdf
        poses = hand.link_poses(q)
        local, link = self.contact_points_in_links(contacts)
        points = hand.place(poses, local, link)
        hand_normals = hand.turn(poses, hand.regions.normals[contacts.region], link)
        normals, distances = sdf.normals(points), sdf.distance(points).abs()
        length = self.obj.radius
        inside = penetration(hand, self.obj, poses, stride)
        return Terms(
            force_closure=force_closure_error(points - self._center, normals, length),
            distance=distances.sum(-1),
            normals=(1 + (hand_normals * normals).sum(-1)).sum(-1),
            penetration=inside.summed,
            depth=inside.depth,
            self_penetration=hand.self_penetration(poses),
            limits=hand.limit_violation(q),
            contact_distances=distances,
            contact_points=points,
        )

    def total(self, terms: Terms) -> Float[Tensor, "batch"]:
        """Weighted sum of the terms."""
        o = self.options
        return (
            o.force_closure_weight * terms.force_closure
            + o.distance_weight * terms.distance
            + o.normal_weight * terms.normals
            + o.penetration_weight * terms.penetration
            + o.self_weight * terms.self_penetration
            + o.limit_weight * terms.limits
        )

    def contact_points_in_links(
        self, contacts: Contacts
    ) -> tuple[Float[Tensor, "batch contact 3"], Int[Tensor, "batch contact"]]:
        """Positions in link frames (metres), and the links."""
        corners = self.hand.regions.corners[contacts.region]
        u, v = torch.sigmoid(contacts.place).unbind(-1)
        weights = torch.stack(((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v), dim=-1)
        points = (weights[..., None] * corners).sum(-2)
        return points, self.hand.regions.link_index[contacts.region]
