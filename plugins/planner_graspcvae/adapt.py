"""Test-time adaptation: a grasp is moved until its contact map agrees with ContactNet's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.adam import Adam
from gdg.contact_maps import values_on
from gdg.data.contact_map import ContactMap
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.pads import contact_pads
from gdg.penetration import penetration, self_penetration

from .network import ContactNet, thinned
from .options import GraspCvaeOptions

#: Pads nearer than this are drawn to the object, metres (the published code's 2 cm).
NEAR_M = 0.02
#: The nearest hand points are searched anew in every so-manieth step.
SEARCH_EVERY = 3


@dataclass(frozen=True)
class Terms:
    """Energy terms per grasp; ``Agreement.total`` is their weighted sum.

    Attributes:
        contact: mean difference from the target map.
        touch: mean gap of the pads that are near the object, metres; others count 0.
        penetration: summed, metres.
        depth: the deepest, metres; not in the energy.
        limits: norm of the joint-limit violation.
        self_penetration: summed, metres.
        values: the hand's contact map.
        hand_index: the hand points that it was made with.
    """

    contact: Float[Tensor, "batch"]
    touch: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    limits: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]
    values: Float[Tensor, "batch object_point"]
    hand_index: Int[Tensor, "batch object_point"]


class Agreement:
    """How well grasps agree with the contact maps that ContactNet predicts for them.

    Args:
        hand: the hand.
        obj: the object.
        network: ContactNet, in evaluation mode, on the hand's device.
        trained_with: label of the distance whose maps it predicts.
        distance: what the hand's own maps are measured with.
        options: weights and steps.
    """

    def __init__(
        self,
        hand: HandModel,
        obj: ObjectModel,
        network: ContactNet,
        trained_with: str,
        distance: Distance,
        options: GraspCvaeOptions,
    ):
        self._hand, self._obj, self._network = hand, obj, network
        self._trained_with, self._distance, self._options = trained_with, distance, options
        self._pads = contact_pads(hand)

    @torch.no_grad()
    def targets(self, q: Float[Tensor, "batch dof"]) -> Float[Tensor, "batch object_point"]:
        """The maps that these grasps should make, each scaled to a largest value of 1."""
        predicted = self._network(self._obj.points[None], thinned(self._hand.surface_points(q)))
        scaled = predicted / predicted.amax(-1, keepdim=True)
        maps = ContactMap(self._obj.name, scaled, self._trained_with)
        return values_on(self._obj, maps, self._distance)

    def terms(
        self,
        q: Float[Tensor, "batch dof"],
        targets: Float[Tensor, "batch object_point"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> Terms:
        """All terms against target maps; searches hand points unless they are given."""
        hand, obj, pads = self._hand, self._obj, self._pads
        poses = hand.link_poses(q)
        points = hand.place_surface(poses)
        found = self._distance.to_hand(obj.points, obj.normals, points, hand_index)
        values = self._distance.contact_value(found.distance)
        gap = torch.relu(obj.sdf.distance(hand.place(poses, pads.points, pads.link_index)))
        inside = penetration(hand, obj, poses)
        return Terms(
            contact=(values - targets).abs().mean(-1),
            touch=torch.where(gap < NEAR_M, gap, torch.zeros_like(gap)).mean(-1),
            penetration=inside.summed,
            depth=inside.depth,
            limits=hand.limit_violation(q),
            self_penetration=self_penetration(hand, poses),
            values=values,
            hand_index=found.hand_index,
        )

    def total(self, terms: Terms, fraction: float = 1.0) -> Float[Tensor, "batch"]:
        """Weighted sum at a fraction of the adaptation, 0 at its start and 1 at its end."""
        o = self._options
        return (
            terms.contact
            + o.touch_weight * terms.touch
            + o.penetration_weight * o.penetration_ramp ** (fraction - 1) * terms.penetration
            + o.limit_weight * terms.limits
            + o.self_weight * terms.self_penetration
        )

    def adapted(
        self, q: Float[Tensor, "batch dof"], report: Callable[[int], None]
    ) -> Float[Tensor, "batch dof"]:
        """The grasps after ``adapt_steps`` Adam steps on all of q, joints within their limits."""
        o = self._options
        q = q.clone().requires_grad_(True)
        optimiser = Adam([q], o.learning_rate)
        targets, index = self.targets(q), None
        for step in range(o.adapt_steps):
            if step and step % o.retarget_every == 0:
                targets = self.targets(q)
            optimiser.zero_grad()
            terms = self.terms(q, targets, None if step % SEARCH_EVERY == 0 else index)
            index = terms.hand_index
            self.total(terms, step / max(1, o.adapt_steps - 1)).sum().backward()
            optimiser.step()
            report(step + 1)
        return self._hand.clamp(q.detach())
