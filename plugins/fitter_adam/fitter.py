"""Fits a hand to contact maps with Adam (GenDexGrasp, Section III-C)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.contact_maps import values_on
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.initial_poses import above_surface, around_sphere
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Fitter, Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration import (
    nearest_point_penetration,
    penetration,
    self_penetration,
    table_penetration,
)
from gdg.penetration.table import raised
from gdg.scenes.reach import reachable

from .options import AdamOptions

#: The release's weight of its mean penetration, per metre.
NEAREST_WEIGHT = 100.0
#: Particles optimised at once; bounds the memory at about 0.6 GB for 2048 × 1600 points.
MAX_BATCH = 256
#: Fitted hands end at least so high above a table, metres.
TABLE_CLEARANCE_M = 0.001


@dataclass(frozen=True)
class Terms:
    """Energy terms per particle; ``total`` is their weighted sum."""

    contact: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    limits: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]
    values: Float[Tensor, "batch object_point"]
    hand_index: Int[Tensor, "batch object_point"]


@dataclass(frozen=True)
class GraspBatch:
    """Fitted pose vectors with their energies and contact maps, on the CPU."""

    q: Float[Tensor, "batch dof"]
    energies: dict[str, Float[Tensor, "batch"]]
    contact_values: Float[Tensor, "batch object_point"]

    @classmethod
    def joined(cls, batches: Sequence[GraspBatch]) -> GraspBatch:
        """All batches as one, in order."""
        return cls(
            torch.cat([batch.q for batch in batches]),
            {
                name: torch.cat([batch.energies[name] for batch in batches])
                for name in batches[0].energies
            },
            torch.cat([batch.contact_values for batch in batches]),
        )

    def select(self, rows: Int[Tensor, "kept"]) -> GraspBatch:
        """Some rows, in the given order."""
        energies = {name: values[rows] for name, values in self.energies.items()}
        return GraspBatch(self.q[rows], energies, self.contact_values[rows])


class AdamFitter(Fitter):
    """E = mean_i |C_i(q) − C*_i| + w_p E_p + w_n E_n + w_s E_self, by Adam on all of q.

    Differences from the release: joint limits are in the gradient (as the paper writes), and the
    penetration weight grows, since maps fitted with a constant one leave fingers 10 mm inside.
    On a table, E_p counts what is below it too; contact is sought only where fingers get, and the
    hand is raised by what is left below.
    """

    options: AdamOptions

    def __init__(self, options: AdamOptions, *, distance: Distance):
        super().__init__(options, distance=distance)

    def fit(
        self,
        hand: HandModel,
        obj: ObjectModel,
        maps: ContactMap,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """The best particles of each map, in the order of the maps; see the interface."""
        targets = values_on(obj, maps, self.distance).to(hand.device)
        if self.options.sharpen:
            targets = self.distance.sharpen(targets)
        if obj.table is not None:
            targets = torch.where(reachable(obj), targets, 0.0)
        rows = targets.repeat_interleave(self.options.particles, dim=0)
        starts = self._start(hand, obj, len(rows), generator)
        batches = list(zip(starts.split(MAX_BATCH), rows.split(MAX_BATCH), strict=True))
        found = []
        for number, (start, target) in enumerate(batches):

            def report(step: int, done: int = number * self.options.steps) -> None:
                if progress is not None:
                    progress(done + step, len(batches) * self.options.steps)

            q = self._descend(hand, obj, start, target, report)
            found.append(self._judge(hand, obj, q, target))
        fitted = GraspBatch.joined(found)
        return self._grasps(hand, obj, maps, fitted.select(self._best(fitted)))

    def _start(self, hand: HandModel, obj: ObjectModel, count: int, g: torch.Generator) -> Tensor:
        if self.options.start == "surface":
            return above_surface(hand, obj, count, g)
        return around_sphere(hand, obj, count, g, self.options.start_factor)

    def _descend(
        self,
        hand: HandModel,
        obj: ObjectModel,
        start: Tensor,
        targets: Tensor,
        report: Callable[[int], None],
    ) -> Tensor:
        if len(start) == 0:
            return start
        q = start.clone().requires_grad_(True)
        steps = self.options.steps
        optimiser = torch.optim.Adam([q], lr=self.options.learning_rate)
        index = None
        for step in range(steps):
            optimiser.zero_grad()
            known = None if step % self.options.search_every == 0 else index
            terms = self.terms(hand, obj, q, targets, known)
            index = terms.hand_index
            self.total(terms, step / max(1, steps - 1)).sum().backward()
            if q.grad is not None:  # a particle that diverged must not spoil the others
                q.grad.nan_to_num_(nan=0.0, posinf=0.0, neginf=0.0)
            optimiser.step()
            report(step + 1)
        q = hand.clamp(q.detach())
        return q if obj.table is None else raised(hand, obj.table, q, TABLE_CLEARANCE_M)

    def terms(
        self,
        hand: HandModel,
        obj: ObjectModel,
        q: Float[Tensor, "batch dof"],
        targets: Float[Tensor, "batch object_point"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> Terms:
        """All energy terms against target maps; searches hand points unless they are given."""
        poses = hand.link_poses(q)
        points = hand.place_surface(poses)
        found = self.distance.to_hand(obj.points, obj.normals, points, hand_index)
        values = self.distance.contact_value(found.distance)
        inside = penetration(hand, obj, poses)
        summed = inside.summed
        if self.options.penetration == "nearest":
            summed = NEAREST_WEIGHT * nearest_point_penetration(obj, points)
            if obj.table is not None:
                summed = summed + table_penetration(hand, [obj.table], poses)[0]
        overlap = torch.zeros(len(q), device=q.device)
        if self.options.self_weight > 0:
            overlap = self_penetration(hand, poses)
        return Terms(
            contact=(values - targets).abs().mean(-1),
            penetration=summed,
            depth=inside.depth,
            limits=hand.limit_violation(q),
            self_penetration=overlap,
            values=values,
            hand_index=found.hand_index,
        )

    def total(self, terms: Terms, fraction: float) -> Float[Tensor, "batch"]:
        """Weighted sum at a fraction of the fit, 0 at its start and 1 at its end."""
        ramp = self.options.penetration_ramp**fraction
        return (
            terms.contact
            + self.options.penetration_weight * ramp * terms.penetration
            + self.options.limit_weight * terms.limits
            + self.options.self_weight * terms.self_penetration
        )

    @torch.no_grad()
    def _judge(
        self,
        hand: HandModel,
        obj: ObjectModel,
        q: Float[Tensor, "batch dof"],
        targets: Float[Tensor, "batch object_point"],
    ) -> GraspBatch:
        """Final energies, with an exact search and the final weights."""
        terms = self.terms(hand, obj, q, targets)
        energies = {
            "total": self.total(terms, fraction=1.0).nan_to_num(nan=float("inf")),
            "contact": terms.contact,
            "penetration": terms.penetration,
            "limits": terms.limits,
            "self_penetration": terms.self_penetration,
            "penetration_depth_mm": 1000 * terms.depth,
        }
        cpu = {name: values.cpu() for name, values in energies.items()}
        return GraspBatch(q.cpu(), cpu, terms.values.cpu())

    def _best(self, fitted: GraspBatch) -> Int[Tensor, "kept"]:
        """The particles of lowest energy of each map."""
        energies = fitted.energies["total"].reshape(-1, self.options.particles)
        best = energies.argsort(dim=-1, stable=True)[:, : self.options.keep]
        return (best + self.options.particles * torch.arange(len(best))[:, None]).flatten()

    def _grasps(
        self, hand: HandModel, obj: ObjectModel, maps: ContactMap, fitted: GraspBatch
    ) -> GraspSet:
        finite = torch.isfinite(fitted.energies["total"]) & torch.isfinite(fitted.q).all(-1)
        return hand.grasps_from(
            fitted.q,
            obj.name,
            fitted.energies,
            status=tuple("hit_limit" if ok else "diverged" for ok in finite),
            contact_values=fitted.contact_values,
            provenance={"maps": maps.provenance, "distance": self.distance.label},
        )
