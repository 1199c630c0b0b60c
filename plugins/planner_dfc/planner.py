"""Grasp synthesis by differentiable force closure (GenDexGrasp, Section III-A)."""

from __future__ import annotations

from collections import Counter
from typing import Any

import torch
from torch import Tensor

from gdg.closure import close_until_touch
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.initial_poses import above_surface
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.planner import Planner
from gdg.objects.model import ObjectModel
from gdg.rotations import ROOT_DIM, root_pose

from .annealed import AnnealedMala
from .energy import Contacts, GraspEnergy
from .options import DfcOptions
from .published import PublishedMala

#: Accepted pose vectors (grasp, dof), and the energies of each.
Accepted = tuple[Tensor, dict[str, Tensor]]


class DfcPlanner(Planner):
    """Samples grasps by MALA and keeps those that meet every threshold, lowest energy first."""

    options: DfcOptions

    def __init__(self, options: DfcOptions):
        super().__init__(options)

    def plan(
        self,
        hand: HandModel,
        obj: ObjectModel,
        count: int,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """At most ``count`` accepted grasps; see the interface.

        Raises:
            GdgError: the hand has no contact regions.
        """
        if len(hand.regions.corners) == 0:
            raise GdgError(f"hand '{hand.hand.name}': planner dfc needs contact_regions.")
        o = self.options
        energy = GraspEnergy(hand, obj, o)
        sampler = (AnnealedMala if o.sampler == "annealed" else PublishedMala)(energy, o, generator)
        found: list[Accepted] = []
        rejected: Counter[str] = Counter()
        for batch in range(o.max_batches):

            def report(step: int, batch: int = batch) -> None:
                if progress is not None:
                    progress(batch * sampler.steps + step, o.max_batches * sampler.steps)

            chains = sampler.run(above_surface(hand, obj, sampler.starts, generator), report)
            q, contacts = hand.clamp(chains.q), chains.contacts
            if o.close:
                q = close_until_touch(hand, obj, q)
            found.append(self._accepted(energy, q, contacts, rejected))
            if sum(len(q) for q, _ in found) >= count:
                break
        provenance = {
            "candidates": len(found) * o.batch,
            "rejected": dict(rejected),
            "acceptance_rate": sampler.accepted / max(1, sampler.proposed),
        }
        return self._grasps(energy, found, count, provenance)

    @torch.no_grad()
    def _accepted(
        self, energy: GraspEnergy, q: Tensor, contacts: Contacts, rejected: Counter[str]
    ) -> Accepted:
        o = self.options
        terms = energy.terms(q, contacts)
        tests = {
            "not finite": ~torch.isfinite(q).all(-1),
            "contact off the surface": terms.touch.distances.amax(-1) > o.max_distance_m,
            "penetration": terms.depth > o.max_penetration_m,
            "self-penetration": terms.self_penetration > o.max_self_m,
            "no force closure": terms.force_closure > o.max_force_closure,
        }
        good = torch.ones(len(q), dtype=torch.bool, device=q.device)
        for reason, failed in tests.items():
            rejected[reason] += int((good & failed).sum())
            good &= ~failed
        energies = {
            "total": energy.total(terms),
            "force_closure": terms.force_closure,
            "distance": terms.distance,
            "normals": terms.normals,
            "penetration": terms.penetration,
            "penetration_depth_mm": 1000 * terms.depth,
            "self_penetration": terms.self_penetration,
            "limits": terms.limits,
        }
        return q[good].cpu(), {name: values[good].cpu() for name, values in energies.items()}

    def _grasps(
        self,
        energy: GraspEnergy,
        found: list[Accepted],
        count: int,
        provenance: dict[str, Any],
    ) -> GraspSet:
        hand = energy.hand
        q = torch.cat([q for q, _ in found])
        energies = {name: torch.cat([e[name] for _, e in found]) for name in found[0][1]}
        best = energies["total"].argsort()[:count]
        q = q[best]
        return GraspSet(
            hand=hand.hand.name,
            object_name=energy.obj.name,
            joint_names=hand.joint_names,
            root_link=hand.hand.spec.root_link,
            poses=root_pose(q),
            joints=q[:, ROOT_DIM:],
            energies={name: values[best] for name, values in energies.items()},
            status=("converged",) * len(best),
            provenance=provenance,
        )
