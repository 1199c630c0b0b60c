"""The fitter that particles descend in: many starts per map, the best of which are kept."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.adam import Adam
from gdg.contact_maps import values_on
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.fitting.energy import FitEnergy
from gdg.fitting.options import FitOptions
from gdg.initial_poses import above_surface, around_sphere
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Fitter, Progress
from gdg.kinds.hand_model import HandModel
from gdg.multicore import one_torch_thread
from gdg.objects.model import ObjectModel
from gdg.penetration.table import raised
from gdg.rotations import ROOT_DIM
from gdg.scenes.reach import reachable

#: Fitted hands end at least so high above a table, metres.
TABLE_CLEARANCE_M = 0.001

AnyOptions = TypeVar("AnyOptions", bound=FitOptions)


@dataclass(frozen=True)
class Round:
    """Steps that some particles of each map take together.

    Attributes:
        particles: per map; the best of the round before.
        steps: of Adam.
        learning_rate: of every entry of q (metres, rot6d, radians).
        points: at how many object points, chosen at random, maps are compared; None: at all.
        hand_stride: every so-manieth of the hand's points is searched.
    """

    particles: int
    steps: int
    learning_rate: float
    points: int | None = None
    hand_stride: int = 1


@dataclass(frozen=True)
class Particles:
    """Pose vectors, and the map that each is fitted to; equally many of each map, in order."""

    q: Float[Tensor, "batch dof"]
    maps: Int[Tensor, "batch"]

    def split(self, size: int) -> list[Particles]:
        """Parts of at most ``size`` particles."""
        parts = zip(self.q.split(size), self.maps.split(size), strict=True)
        return [Particles(q, maps) for q, maps in parts]

    def select(self, rows: Int[Tensor, "kept"]) -> Particles:
        """Some rows, in the given order."""
        return Particles(self.q[rows], self.maps[rows])


class ParticleFitter(Fitter, Generic[AnyOptions]):
    """Adam on all of q, from many starts per map, in rounds of ever fewer particles.

    Each map has a random stream of its own, so its fits don't depend on the maps after it, nor on
    how many are fitted at once.

    On a table, contact is sought only where fingers get, and the hand is raised by what is left
    below.
    """

    options: AnyOptions

    def __init__(self, options: AnyOptions, *, distance: Distance):
        super().__init__(options, distance=distance)

    @abstractmethod
    def rounds(self) -> Sequence[Round]:
        """What the particles do; all of them take part in the first round."""

    def fit(
        self,
        hand: HandModel,
        obj: ObjectModel,
        maps: ContactMap,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """The best particles of each map, in the order of the maps; see the interface."""
        energy = self.energy(hand, obj, maps)
        plan = self.rounds() if len(maps) else ()
        rounds = [(one, _coarse(energy, one, generator)) for one in plan]
        seeds = torch.randint(2**62, (len(maps),), generator=generator, device=generator.device)
        groups = torch.arange(len(maps)).split(self._maps_at_once(energy, rounds))
        steps = _Steps(len(groups), sum(one.steps for one, _ in rounds), progress)
        found = []
        with one_torch_thread():
            for group in groups:
                particles = Particles(
                    self._starts(hand, obj, seeds[group].tolist()),
                    group.to(hand.device).repeat_interleave(self.options.particles),
                )
                found.append(self._fitted(energy, rounds, particles, steps))
        return self._grasps(hand, obj, maps, Judged.joined(found))

    def _maps_at_once(self, energy: FitEnergy, rounds: Sequence[tuple[Round, FitEnergy]]) -> int:
        """How many maps all of whose particles fit into memory together."""
        largest = max((one.particles * coarse.particle_bytes for one, coarse in rounds), default=1)
        last = rounds[-1][0].particles * energy.particle_bytes if rounds else 1
        return max(1, int(1e6 * self.options.max_memory_mb / max(largest, last)))

    def _fitted(
        self,
        energy: FitEnergy,
        rounds: Sequence[tuple[Round, FitEnergy]],
        particles: Particles,
        steps: _Steps,
    ) -> Judged:
        """The particles that are kept of some maps, after all rounds."""
        hand, obj, each = energy.hand, energy.obj, self.options.particles
        for one, coarse in rounds:
            if one.particles < each:
                best = _best(_totals(coarse, particles), each, one.particles)
                particles, each = particles.select(best), one.particles
            particles = _descended(coarse, particles, one, steps)
        q = hand.clamp(particles.q)
        if obj.table is not None:
            q = raised(hand, obj.table, q, TABLE_CLEARANCE_M)
        judged = _judged(energy, Particles(q, particles.maps))
        return judged.select(_best(judged.energies["total"], each, self.options.keep))

    def energy(self, hand: HandModel, obj: ObjectModel, maps: ContactMap) -> FitEnergy:
        """What a fit to these maps minimises.

        Raises:
            GdgError: as ``fit``.
        """
        targets = values_on(obj, maps, self.distance).to(hand.device)
        if self.options.sharpen:
            targets = self.distance.sharpen(targets)
        if obj.table is not None:
            targets = torch.where(reachable(obj), targets, 0.0)
        return FitEnergy(
            hand, obj, obj.points, obj.normals, targets, hand.surface, self.distance, self.options
        )

    def _starts(
        self, hand: HandModel, obj: ObjectModel, seeds: Sequence[int]
    ) -> Float[Tensor, "batch dof"]:
        """Where the particles of maps with these seeds begin."""
        starts = [torch.zeros(0, ROOT_DIM + len(hand.joint_names), device=hand.device)]
        for seed in seeds:
            generator = torch.Generator().manual_seed(seed)
            starts.append(self._start(hand, obj, self.options.particles, generator))
        return torch.cat(starts)

    def _start(self, hand: HandModel, obj: ObjectModel, count: int, g: torch.Generator) -> Tensor:
        if self.options.start == "surface":
            return above_surface(hand, obj, count, g)
        return around_sphere(hand, obj, count, g, self.options.start_factor)

    def _grasps(
        self, hand: HandModel, obj: ObjectModel, maps: ContactMap, fitted: Judged
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


@dataclass(frozen=True)
class Judged:
    """Pose vectors with their energies and contact maps, on the CPU."""

    q: Float[Tensor, "batch dof"]
    energies: dict[str, Float[Tensor, "batch"]]
    contact_values: Float[Tensor, "batch object_point"]

    @classmethod
    def joined(cls, parts: Sequence[Judged]) -> Judged:
        """All parts as one, in order."""
        return cls(
            torch.cat([part.q for part in parts]),
            {
                name: torch.cat([part.energies[name] for part in parts])
                for name in parts[0].energies
            },
            torch.cat([part.contact_values for part in parts]),
        )

    def select(self, rows: Int[Tensor, "kept"]) -> Judged:
        """Some rows, in the given order."""
        energies = {name: values[rows] for name, values in self.energies.items()}
        return Judged(self.q[rows], energies, self.contact_values[rows])


class _Steps:
    """Counts the steps of a fit: for people, and within a group for the penetration weight."""

    def __init__(self, groups: int, each: int, progress: Progress | None):
        self._each, self._total, self._done = each, groups * each, 0
        self._progress = progress

    @property
    def fraction(self) -> float:
        """How far the fit of the present group is: 0 in its first step, 1 in its last."""
        return (self._done % self._each) / max(1, self._each - 1)

    def advance(self) -> None:
        """One more step is done."""
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


def _descended(energy: FitEnergy, particles: Particles, one: Round, steps: _Steps) -> Particles:
    """The particles after the steps of a round."""
    parts = particles.split(_held_at_once(energy))
    moving = [part.q.clone().requires_grad_(True) for part in parts]
    index: list[Tensor | None] = [None] * len(parts)
    optimiser = Adam(moving, one.learning_rate)
    for step in range(one.steps):
        optimiser.zero_grad()
        for number, (q, part) in enumerate(zip(moving, parts, strict=True)):
            searched = step % energy.options.search_every == 0
            terms = energy.terms(q, part.maps, None if searched else index[number])
            index[number] = terms.hand_index
            energy.total(terms, steps.fraction).sum().backward()
        optimiser.step()
        steps.advance()
    return Particles(torch.cat([q.detach() for q in moving]), particles.maps)


@torch.no_grad()
def _totals(energy: FitEnergy, particles: Particles) -> Float[Tensor, "batch"]:
    """Energies with an exact search and the final weights; those of lost particles are inf."""
    parts = particles.split(_held_at_once(energy))
    return torch.cat([_or_inf(energy.total(energy.terms(part.q, part.maps))) for part in parts])


@torch.no_grad()
def _judged(energy: FitEnergy, particles: Particles) -> Judged:
    """The particles with their energies as ``_totals``, the terms and the contact maps."""
    found = []
    for part in particles.split(_held_at_once(energy)):
        terms = energy.terms(part.q, part.maps)
        energies = {
            "total": _or_inf(energy.total(terms)),
            "contact": terms.contact,
            "penetration": terms.penetration,
            "limits": terms.limits,
            "self_penetration": terms.self_penetration,
            "penetration_depth_mm": 1000 * terms.depth,
        }
        cpu = {name: values.cpu() for name, values in energies.items()}
        found.append(Judged(part.q.cpu(), cpu, terms.values.cpu()))
    return Judged.joined(found)


def _or_inf(energies: Float[Tensor, "batch"]) -> Float[Tensor, "batch"]:
    return energies.nan_to_num(nan=math.inf, posinf=math.inf)


def _held_at_once(energy: FitEnergy) -> int:
    """How many particles fit into memory together."""
    return max(1, int(1e6 * energy.options.max_memory_mb / energy.particle_bytes))


def _best(energies: Float[Tensor, "batch"], each: int, count: int) -> Int[Tensor, "kept"]:
    """Rows of the lowest energies of each map that ``each`` rows in turn belong to."""
    best = energies.reshape(-1, each).argsort(dim=-1, stable=True)[:, :count]
    return (best + each * torch.arange(len(best), device=best.device)[:, None]).flatten()


def _coarse(energy: FitEnergy, one: Round, generator: torch.Generator) -> FitEnergy:
    """The energy of a round, at object points that are drawn without repetition."""
    points = len(energy.points)
    if one.points is None or one.points >= points:
        chosen = torch.arange(points, device=energy.points.device)
    else:
        chosen = torch.randperm(points, generator=generator)[: one.points].to(energy.points.device)
    return energy.on(chosen, one.hand_stride)
