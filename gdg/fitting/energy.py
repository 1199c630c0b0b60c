"""The energy of a hand against contact maps (GenDexGrasp, Section III-C)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.fitting.options import FitOptions
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel, LinkPoints
from gdg.objects.model import ObjectModel
from gdg.penetration import (
    nearest_point_penetration,
    penetration,
    self_penetration,
    table_penetration,
)

#: The release's weight of its mean penetration, per metre.
NEAREST_WEIGHT = 100.0
#: What one evaluation with its gradient holds, bytes: measured on the CPU, where points are placed
#: and penetration is found by compiled passes, and what tensor operations elsewhere add (per pair
#: of inscribed spheres, too).
BYTES_PER_OBJECT_POINT, BYTES_PER_HAND_POINT, BYTES_PER_LINK = 190, 12, 450
TENSORS_PER_OBJECT_POINT, TENSORS_PER_HAND_POINT, TENSORS_PER_SPHERE_PAIR = 200, 150, 16


@dataclass(frozen=True)
class Terms:
    """Energy terms per particle; ``FitEnergy.total`` is their weighted sum.

    Attributes:
        contact: mean difference of the maps, contact beyond the target's weighted.
        penetration: summed depth, metres.
        depth: deepest point, metres.
        limits: by how much joints exceed their limits, rad (m for prismatic joints).
        self_penetration: summed overlap of links, metres.
        values: the hand's own contact map.
        hand_index: the point of ``FitEnergy.surface`` that each object point is nearest to.
    """

    contact: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    limits: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]
    values: Float[Tensor, "batch object_point"]
    hand_index: Int[Tensor, "batch object_point"]


@dataclass(frozen=True)
class FitEnergy:
    """E = mean_i |C_i(q) − C*_i| + w_p E_p + w_n E_n + w_s E_self for particles of several maps.

    Differences from the release: contact beyond the map's may cost less (``extra_weight``): a hand
    that touches more than the map asks for holds better. Joint limits are in the gradient (as the
    paper writes). The penetration weight grows, since maps fitted with a constant one leave
    fingers 10 mm inside.
    On a table, E_p counts what is below it too.

    Attributes:
        hand: what is fitted.
        obj: the object.
        points: where on the object the maps are compared; metres.
        normals: outward unit normals there.
        targets: the maps there, C*.
        surface: the hand's points among which the nearest are searched, link frames, metres.
        distance: what the hand's own map is measured with.
        options: the weights.
    """

    hand: HandModel
    obj: ObjectModel
    points: Float[Tensor, "object_point 3"]
    normals: Float[Tensor, "object_point 3"]
    targets: Float[Tensor, "map object_point"]
    surface: LinkPoints
    distance: Distance
    options: FitOptions

    def on(self, chosen: Int[Tensor, "chosen_point"], stride: int) -> FitEnergy:
        """The same on some of the object's points, and every ``stride``-th of the hand's."""
        return replace(
            self,
            points=self.points[chosen],
            normals=self.normals[chosen],
            targets=self.targets[:, chosen],
            surface=self.surface.every(stride),
        )

    @property
    def particle_bytes(self) -> int:
        """About what one particle takes while its energy and gradient are computed."""
        compiled = (
            BYTES_PER_OBJECT_POINT * len(self.points)
            + BYTES_PER_HAND_POINT * len(self.surface.points)
            + BYTES_PER_LINK * len(self.hand.link_names)
        )
        if self.hand.device.type == "cpu":
            return compiled
        return (
            compiled
            + TENSORS_PER_OBJECT_POINT * len(self.points)
            + TENSORS_PER_HAND_POINT * len(self.hand.surface.points)
            + TENSORS_PER_SPHERE_PAIR * len(self.hand.spheres.radii) ** 2
        )

    def terms(
        self,
        q: Float[Tensor, "batch dof"],
        maps: Int[Tensor, "batch"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> Terms:
        """All terms of particles, each against its map; searches hand points unless given."""
        poses = self.hand.link_poses(q)
        if hand_index is None:
            hand_index = self._nearest(poses)
        values = self.distance.contact_value(self._distance_to(hand_index, poses))
        inside = penetration(self.hand, self.obj, poses)
        summed = inside.summed
        if self.options.penetration == "nearest":
            surface = self.hand.place_surface(poses)
            summed = NEAREST_WEIGHT * nearest_point_penetration(self.obj, surface)
            if self.obj.table is not None:
                summed = summed + table_penetration(self.hand, [self.obj.table], poses)[0]
        overlap = torch.zeros(len(q), device=q.device)
        if self.options.self_weight > 0:
            overlap = self_penetration(self.hand, poses)
        return Terms(
            contact=self._difference(values, self.targets[maps]),
            penetration=summed,
            depth=inside.depth,
            limits=self.hand.limit_violation(q),
            self_penetration=overlap,
            values=values,
            hand_index=hand_index,
        )

    @torch.no_grad()
    def _nearest(
        self, Ts_world_link: Float[Tensor, "batch link 4 4"]
    ) -> Int[Tensor, "batch object_point"]:
        """The hand point that each object point is nearest to."""
        placed = self.hand.place(Ts_world_link, self.surface.points, self.surface.link_index)
        return self.distance.to_hand(self.points, self.normals, placed).hand_index

    def _distance_to(
        self,
        hand_index: Int[Tensor, "batch object_point"],
        Ts_world_link: Float[Tensor, "batch link 4 4"],
    ) -> Float[Tensor, "batch object_point"]:
        """Distance of each object point to one hand point; the others need not be placed."""
        points, links = self.surface.points[hand_index], self.surface.link_index[hand_index]
        placed = self.hand.place(Ts_world_link, points, links)
        each_its_own = torch.arange(len(self.points), device=placed.device).expand_as(hand_index)
        return self.distance.to_hand(self.points, self.normals, placed, each_its_own).distance

    def _difference(
        self,
        values: Float[Tensor, "batch object_point"],
        targets: Float[Tensor, "batch object_point"],
    ) -> Float[Tensor, "batch"]:
        """Mean difference of maps; contact where none is asked for weighs ``extra_weight``."""
        beyond = values - targets
        return torch.where(beyond > 0, self.options.extra_weight * beyond, -beyond).mean(-1)

    def total(self, terms: Terms, fraction: float = 1.0) -> Float[Tensor, "batch"]:
        """Weighted sum at a fraction of the fit, 0 at its start and 1 at its end."""
        ramp = self.options.penetration_ramp**fraction
        return (
            terms.contact
            + self.options.penetration_weight * ramp * terms.penetration
            + self.options.limit_weight * terms.limits
            + self.options.self_weight * terms.self_penetration
        )
