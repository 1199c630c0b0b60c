"""Fits a hand to contact maps without gradients, by differential evolution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.contact_maps import values_on
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.initial_poses import above_surface, around_sphere
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Fitter, Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration, self_penetration
from gdg.rotations import ROOT_DIM, q_from_pose, root_pose

from .options import EvolutionOptions

#: Hands evaluated at once; bounds the memory.
MAX_BATCH = 256
#: A trial goes a random share of the way, between these (Price, Storn and Lampinen 2005: 0.4–1).
LEAST_STEP, LARGEST_STEP = 0.4, 1.0


@dataclass(frozen=True)
class Terms:
    """Energy terms of some hands, and the contact maps that these make."""

    contact: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    values: Float[Tensor, "batch object_point"]


class EvolutionFitter(Fitter):
    """E = mean_i |C_i(q) − C*_i| + w_p E_p + w_s E_self, by differential evolution.

    Each contact map has a population of hands. In every generation each hand tries a pose between
    itself, one of the best, and the difference of two others (current-to-p-best, Zhang and
    Sanderson 2009), and moves there if that is better. Needs no gradients, so it takes any
    distance; differences shrink as the population agrees, so it first explores, then refines.
    """

    options: EvolutionOptions

    def __init__(self, options: EvolutionOptions, *, distance: Distance):
        super().__init__(options, distance=distance)

    @torch.no_grad()
    def fit(
        self,
        hand: HandModel,
        obj: ObjectModel,
        maps: ContactMap,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """The best hand of each map's population, in the order of the maps; see the interface."""
        targets = values_on(obj, maps, self.distance).to(hand.device)
        if self.options.sharpen:
            targets = self.distance.sharpen(targets)
        coarse, wanted = self._thinned(obj, targets)
        q = self._start(hand, obj, len(targets), generator)
        energy = self._energy(hand, coarse, q, wanted)
        done = torch.zeros(len(targets), dtype=torch.bool)
        for generation in range(self.options.generations):
            trial = self._trials(hand, q, energy, generator)
            found = self._energy(hand, coarse, trial, wanted)
            better = found < energy
            q = torch.where(better[..., None], trial, q)
            energy = torch.where(better, found, energy)
            if progress is not None:
                progress(generation + 1, self.options.generations)
            done = (energy.median(-1).values - energy.amin(-1) < self.options.tolerance).cpu()
            if bool(done.all()):
                break
        best = q[torch.arange(len(q), device=q.device), energy.argmin(-1)]
        return self._grasps(hand, obj, maps, best, targets, done)

    def _thinned(
        self, obj: ObjectModel, targets: Float[Tensor, "map object_point"]
    ) -> tuple[ObjectModel, Float[Tensor, "map some_point"]]:
        """The object and the targets at every so-manieth point; most of the time goes there."""
        stride = self.options.every
        thinned = replace(
            obj, points=obj.points[::stride].clone(), normals=obj.normals[::stride].clone()
        )
        return thinned, targets[:, ::stride]

    def _start(
        self, hand: HandModel, obj: ObjectModel, maps: int, generator: torch.Generator
    ) -> Float[Tensor, "map member dof"]:
        start = above_surface if self.options.start == "surface" else around_sphere
        q = start(hand, obj, maps * self.options.population, generator)
        return q.reshape(maps, self.options.population, q.shape[-1])

    def _trials(
        self,
        hand: HandModel,
        q: Float[Tensor, "map member dof"],
        energy: Float[Tensor, "map member"],
        generator: torch.Generator,
    ) -> Float[Tensor, "map member dof"]:
        """One trial pose for every hand, within joint limits."""
        maps, members, _ = q.shape

        def random(*shape: int) -> Tensor:
            return torch.rand(shape, generator=generator).to(q)

        def chosen(member: Tensor) -> Tensor:
            return torch.gather(q, 1, member[..., None].expand_as(q))

        elite = max(1, round(self.options.greed * members))
        rank = torch.randint(elite, (maps, members), generator=generator).to(q.device)
        best = chosen(energy.argsort(-1).gather(1, rank))
        others = random(maps, members, members)
        others.diagonal(dim1=1, dim2=2).fill_(-1.0)  # never the hand itself
        first, second = others.topk(2, dim=-1).indices.unbind(-1)
        step = LEAST_STEP + (LARGEST_STEP - LEAST_STEP) * random(maps, members, 1)
        moved = q + step * (best - q + chosen(first) - chosen(second))
        kept = random(*q.shape) >= self.options.crossover
        trial = torch.where(kept, q, moved).flatten(0, 1)
        # back to a rotation, or the six numbers that describe it would shrink together
        trial = q_from_pose(root_pose(trial), trial[:, ROOT_DIM:])
        return hand.clamp(trial).reshape(q.shape)

    def _energy(
        self,
        hand: HandModel,
        obj: ObjectModel,
        q: Float[Tensor, "map member dof"],
        targets: Float[Tensor, "map object_point"],
    ) -> Float[Tensor, "map member"]:
        """Total energies; what is not finite loses against everything."""
        rows = targets.repeat_interleave(q.shape[1], dim=0)
        batches = zip(q.flatten(0, 1).split(MAX_BATCH), rows.split(MAX_BATCH))
        found = [self._total(self._terms(hand, obj, *batch)) for batch in batches]
        return torch.cat(found).nan_to_num(nan=torch.inf).reshape(q.shape[:2])

    def _terms(
        self,
        hand: HandModel,
        obj: ObjectModel,
        q: Float[Tensor, "batch dof"],
        targets: Float[Tensor, "batch object_point"],
    ) -> Terms:
        poses = hand.link_poses(q)
        found = self.distance.to_hand(obj.points, obj.normals, hand.place_surface(poses))
        values = self.distance.contact_value(found.distance)
        inside = penetration(hand, obj, poses)
        return Terms(
            contact=(values - targets).abs().mean(-1),
            penetration=inside.summed,
            self_penetration=self_penetration(hand, poses),
            depth=inside.depth,
            values=values,
        )

    def _total(self, terms: Terms) -> Float[Tensor, "batch"]:
        return (
            terms.contact
            + self.options.penetration_weight * terms.penetration
            + self.options.self_weight * terms.self_penetration
        )

    def _grasps(
        self,
        hand: HandModel,
        obj: ObjectModel,
        maps: ContactMap,
        q: Float[Tensor, "map dof"],
        targets: Float[Tensor, "map object_point"],
        done: Bool[Tensor, "map"],
    ) -> GraspSet:
        terms = self._terms(hand, obj, q, targets)
        energies = {
            "total": self._total(terms),
            "contact": terms.contact,
            "penetration": terms.penetration,
            "self_penetration": terms.self_penetration,
            "penetration_depth_mm": 1000 * terms.depth,
        }
        finite = torch.isfinite(energies["total"]) & torch.isfinite(q).all(-1)
        return hand.grasps_from(
            q,
            obj.name,
            energies,
            status=tuple(
                "diverged" if not ok else "converged" if end else "hit_limit"
                for ok, end in zip(finite.tolist(), done.tolist())
            ),
            contact_values=terms.values.cpu(),
            provenance={"maps": maps.provenance, "distance": self.distance.label},
        )
