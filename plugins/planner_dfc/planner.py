"""Grasp synthesis by differentiable force closure (GenDexGrasp, Section III-A)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
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
from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel
from gdg.penetration.table import raised

from .annealed import AnnealedMala
from .energy import Contacts, GraspEnergy, Terms
from .options import DfcOptions
from .published import PublishedMala

#: Accepted pose vectors (grasp, dof), and the energies of each.
Accepted = tuple[Tensor, dict[str, Tensor]]


@dataclass
class _Search:
    """What was found so far for one object."""

    obj: ObjectModel
    generator: torch.Generator
    found: list[Accepted] = field(default_factory=list)
    rejected: Counter[str] = field(default_factory=Counter)
    candidates: int = 0
    accepted_steps: int = 0
    proposed_steps: int = 0

    @property
    def count(self) -> int:
        return sum(len(q) for q, _ in self.found)


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
        return self.plan_many(hand, [obj], count, [generator], progress)[0]

    def plan_many(
        self,
        hand: HandModel,
        objects: Sequence[ObjectModel],
        count: int,
        generators: Sequence[torch.Generator],
        progress: Progress | None = None,
    ) -> list[GraspSet]:
        """At most ``count`` accepted grasps of each object; see the interface.

        The chains of all objects run as one batch. On the CPU that is as fast as one object
        after the other. On a GPU each object takes 34 MB for its signed distances (of 128³ nodes)
        besides its own copy, and each of its ``batch`` × ``oversample`` chains, for gradients, some
        90 bytes per surface point and 12 per pair of inscribed spheres: 0.4 GB per object for
        ShadowHand (1600 points, 173 spheres) with the usual options.

        Raises:
            GdgError: the hand has no contact regions.
        """
        if len(hand.regions.corners) == 0:
            raise GdgError(f"hand '{hand.hand.name}': planner dfc needs contact_regions.")
        searches = [_Search(*pair) for pair in zip(objects, generators, strict=True)]
        for batch in range(self.options.max_batches):
            going = [search for search in searches if batch == 0 or search.count < count]
            if going:
                self._run_batch(hand, going, batch, progress)
        return [self._grasps(hand, search, count) for search in searches]

    def _run_batch(
        self, hand: HandModel, searches: list[_Search], batch: int, progress: Progress | None
    ) -> None:
        """Runs a batch of chains for each of these objects, together."""
        o = self.options
        generators = [search.generator for search in searches]
        energy = GraspEnergy(hand, ObjectBatch([search.obj for search in searches]), o)
        make = AnnealedMala if o.sampler == "annealed" else PublishedMala
        sampler = make(energy, o, generators)

        def report(step: int) -> None:
            if progress is not None:
                progress(batch * sampler.steps + step, o.max_batches * sampler.steps)

        starts = [above_surface(hand, s.obj, sampler.starts, s.generator) for s in searches]
        chains = sampler.run(torch.cat(starts), report)
        parts = zip(searches, energy.objects.per_object(hand.clamp(chains.q)))
        q = torch.cat([self._finished(hand, search.obj, part) for search, part in parts])
        self._keep_accepted(energy, q, chains.contacts, searches)
        for search, accepted in zip(searches, sampler.accepted.tolist()):
            search.candidates += o.batch
            search.accepted_steps += accepted
            search.proposed_steps += sampler.proposed

    def _finished(self, hand: HandModel, obj: ObjectModel, q: Tensor) -> Tensor:
        """Hands of one object, raised out of the table, with closed fingers."""
        o = self.options
        if obj.table is not None:
            q = raised(hand, obj.table, q, o.close_margin_m)
        return close_until_touch(hand, obj, q, o.close_margin_m) if o.close else q

    @torch.no_grad()
    def _keep_accepted(
        self, energy: GraspEnergy, q: Tensor, contacts: Contacts, searches: list[_Search]
    ) -> None:
        """Adds to each search what meets every threshold, and counts why the others don't."""
        terms = energy.terms(q, contacts)
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

        def per_object(values: Tensor) -> Tensor:
            return energy.objects.per_object(values).cpu()

        poses = per_object(q)
        split = {name: per_object(values) for name, values in energies.items()}
        tests = {reason: per_object(failed) for reason, failed in self._tests(q, terms).items()}
        for number, search in enumerate(searches):
            good = torch.ones(poses.shape[1], dtype=torch.bool)
            for reason, failed in tests.items():
                search.rejected[reason] += int((good & failed[number]).sum())
                good &= ~failed[number]
            kept = {name: values[number][good] for name, values in split.items()}
            search.found.append((poses[number][good], kept))

    def _tests(self, q: Tensor, terms: Terms) -> dict[str, Tensor]:
        """Reason -> which chains are rejected for it, in the order in which they are tested."""
        o = self.options
        return {
            "not finite": ~torch.isfinite(q).all(-1),
            "contact off the surface": terms.touch.distances.amax(-1) > o.max_distance_m,
            "penetration": terms.depth > o.max_penetration_m,
            "self-penetration": terms.self_penetration > o.max_self_m,
            "no force closure": terms.force_closure > o.max_force_closure,
        }

    def _grasps(self, hand: HandModel, search: _Search, count: int) -> GraspSet:
        q = torch.cat([q for q, _ in search.found])
        names = search.found[0][1]
        energies = {name: torch.cat([e[name] for _, e in search.found]) for name in names}
        best = energies["total"].argsort()[:count]
        q = q[best]
        provenance: dict[str, Any] = {
            "candidates": search.candidates,
            "rejected": dict(search.rejected),
            "acceptance_rate": search.accepted_steps / max(1, search.proposed_steps),
        }
        return hand.grasps_from(
            q,
            search.obj.name,
            {name: values[best] for name, values in energies.items()},
            status=("converged",) * len(best),
            provenance=provenance,
        )
