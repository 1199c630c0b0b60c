"""Energy of a grasp with chosen contact points (GenDexGrasp, Section III-A)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.force_closure import force_closure_error
from gdg.kinds.hand_model import HandModel
from gdg.objects.batch import ObjectBatch
from gdg.penetration import penetration, self_penetration

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

    def with_one(
        self, slot: Int[Tensor, "batch"], chosen: Bool[Tensor, "batch"], fresh: Contacts
    ) -> Contacts:
        """These with the contact in ``slot`` of each chosen element replaced by its fresh one."""
        slots = torch.arange(self.region.shape[1], device=slot.device)
        here = chosen[:, None] & (slots == slot[:, None])
        return Contacts(
            torch.where(here, fresh.region, self.region),
            torch.where(here[..., None], fresh.place, self.place),
        )


@dataclass(frozen=True)
class Touch:
    """Contact points in the world, and the object there.

    Attributes:
        points: metres.
        hand_normals: outward unit normals of the hand.
        normals: outward unit normals of the object's nearest surface.
        distances: from that surface, metres, ≥ 0 on both sides.
    """

    points: Float[Tensor, "batch contact 3"]
    hand_normals: Float[Tensor, "batch contact 3"]
    normals: Float[Tensor, "batch contact 3"]
    distances: Float[Tensor, "batch contact"]


@dataclass(frozen=True)
class Terms:
    """Unweighted energy terms per chain, and what they were made of."""

    force_closure: Float[Tensor, "batch"]
    distance: Float[Tensor, "batch"]
    normals: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]
    limits: Float[Tensor, "batch"]
    touch: Touch
    Ts_world_link: Float[Tensor, "batch link 4 4"]


class GraspEnergy:
    """E = w_fc ‖G c‖ + w_d Σ|δ(x)| + w_n Σ(1 + ⟨n_h, n_o⟩) + w_p E_p + w_s E_self + w_l E_n.

    Args:
        hand: one hand.
        objects: one or many; each has its share of every batch (``ObjectBatch``).
        options: the weights.
    """

    def __init__(self, hand: HandModel, objects: ObjectBatch, options: DfcOptions):
        self.hand, self.objects, self.options = hand, objects, options

    def terms(
        self,
        q: Float[Tensor, "batch dof"],
        contacts: Contacts,
        stride: int = 1,
        margin_m: float = 0.0,
    ) -> Terms:
        """All terms, differentiable in q and in the contacts' places.

        ``stride`` and ``margin_m`` are those of ``gdg.penetration.penetration``.
        """
        poses = self.hand.link_poses(q)
        touch = self.touch(poses, contacts)
        inside = penetration(self.hand, self.objects, poses, stride, margin_m)
        return Terms(
            force_closure=self.force_closure(touch),
            distance=touch.distances.sum(-1),
            normals=self.turned_away(touch).sum(-1),
            penetration=inside.summed,
            depth=inside.depth,
            self_penetration=self_penetration(self.hand, poses),
            limits=self.hand.limit_violation(q),
            touch=touch,
            Ts_world_link=poses,
        )

    def total(self, terms: Terms, hardness: float = 1.0) -> Float[Tensor, "batch"]:
        """Weighted sum of the terms; ``hardness`` multiplies the two penetration weights."""
        o = self.options
        return (
            o.force_closure_weight * terms.force_closure
            + o.distance_weight * terms.distance
            + o.normal_weight * terms.normals
            + hardness * o.penetration_weight * terms.penetration
            + hardness * o.self_weight * terms.self_penetration
            + o.limit_weight * terms.limits
        )

    def touch(self, Ts_world_link: Float[Tensor, "batch link 4 4"], contacts: Contacts) -> Touch:
        """Where contact points lie when the links are where they are."""
        local, link = self.contact_points_in_links(contacts)
        hand, sdf = self.hand, self.objects.sdf
        points = hand.place(Ts_world_link, local, link)
        outward = hand.turn(Ts_world_link, hand.regions.normals[contacts.region], link)
        return Touch(points, outward, sdf.normals(points), sdf.distance(points).abs())

    def force_closure(self, touch: Touch) -> Float[Tensor, "batch"]:
        """‖G c‖ / n, torques about the centre of mass divided by the object's reach."""
        arms, reaches = self._arms(touch)
        return force_closure_error(arms, touch.normals, reaches)

    def wrenches(self, touch: Touch) -> Float[Tensor, "batch contact 6"]:
        """Wrench of a unit force along the normal at each contact, torques as above."""
        arms, reaches = self._arms(touch)
        torques = torch.linalg.cross(arms, touch.normals)
        return torch.cat((touch.normals, torques / reaches[:, None]), dim=-1)

    def _arms(
        self, touch: Touch
    ) -> tuple[Float[Tensor, "batch contact 3"], Float[Tensor, "batch 1"]]:
        """Contacts relative to their object's centre of mass, and its reach, metres."""
        objects, batch = self.objects, len(touch.points)
        centers = objects.per_hand(objects.centers_of_mass, batch)
        reaches = objects.per_hand(objects.reaches[:, None], batch)
        return touch.points - centers[:, None], reaches

    def turned_away(self, touch: Touch) -> Float[Tensor, "batch contact"]:
        """1 + ⟨n_hand, n_object⟩: 0 where a pad faces the surface."""
        return 1 + (touch.hand_normals * touch.normals).sum(-1)

    def contact_points_in_links(
        self, contacts: Contacts
    ) -> tuple[Float[Tensor, "batch contact 3"], Int[Tensor, "batch contact"]]:
        """Positions in link frames (metres), and the links."""
        corners = self.hand.regions.corners[contacts.region]
        u, v = torch.sigmoid(contacts.place).unbind(-1)
        weights = torch.stack(((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v), dim=-1)
        points = (weights[..., None] * corners).sum(-2)
        return points, self.hand.regions.link_index[contacts.region]
