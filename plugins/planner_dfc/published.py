"""MALA as published (Liu et al. 2021), which GenDexGrasp's dataset was made with."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from .chains import MAX_PLACE, Chains, ChainSteps, remember
from .energy import Contacts, GraspEnergy
from .options import DfcOptions

#: Step and temperature: a base, and growth with a chain's energy.
STEP, STEP_SLOPE = 0.0260, 3.95e-5
TEMPERATURE, TEMPERATURE_SLOPE = 0.0260, 0.0395
#: Noise as a share of the step, and chance of a Langevin step rather than a contact switch.
NOISE, LANGEVIN = 0.1, 0.85
#: The last steps keep the contacts and use this step and temperature.
REFINEMENT_STEPS, REFINEMENT_STEP, REFINEMENT_TEMPERATURE = 1000, 0.1, 1e-3
#: Steps before refinement; ``options.steps`` replaces it, with refinement in proportion.
PUBLISHED_STEPS = 10_000


class PublishedMala(ChainSteps):
    """Proposals x − ½ s² g/E|g| + 0.1 s N(0, I), or one contact moved to a random place.

    A chain takes a Langevin step with probability 0.85, unless its last two proposals were
    rejected. Contacts move with Langevin steps too, as they slide in their regions here; in the
    source they are vertices. The energy and its weights are this planner's, in metres; the source
    scales the hand instead.
    """

    def __init__(
        self, energy: GraspEnergy, options: DfcOptions, generators: Sequence[torch.Generator]
    ):
        super().__init__(energy, generators)
        self._options = options
        self.starts = options.batch
        self.steps = options.steps + refinement_steps(options.steps)

    def run(self, q: Tensor, report: Callable[[int], None]) -> Chains:
        """Runs ``options.steps`` steps and then the refinement; gives the last states."""
        o = self._options
        chains = self.evaluate(q, self.random_contacts(len(q), o.contacts))
        scale, place_scale = self._scales(chains)
        rejected = torch.zeros(len(q), device=q.device)
        for step in range(self.steps):
            refining = step >= o.steps
            now, place_now = self._scales(chains)
            scale, place_scale = remember(scale, now), remember(place_scale, place_now)
            energy = self.energy.total(chains.terms)
            size = STEP + STEP_SLOPE * energy
            temperature: Tensor | float = TEMPERATURE + TEMPERATURE_SLOPE * energy
            if refining:
                size, temperature = torch.full_like(energy, REFINEMENT_STEP), REFINEMENT_TEMPERATURE
            moves = (self.uniform(len(q)) < LANGEVIN) & (rejected < 2)
            moves |= torch.full_like(moves, refining)
            proposal = self._propose(chains, scale, place_scale, size[:, None], moves)
            chains, accepted = self.metropolis(chains, proposal, temperature)
            rejected = torch.where(accepted, torch.zeros_like(rejected), rejected + 1)
            report(step + 1)
        return chains

    def _scales(self, chains: Chains) -> tuple[Tensor, Tensor]:
        """E|g| per dimension of q, and one size for all places, of each object's chains."""
        return (
            self.mean(chains.q_gradient.abs()),
            self.flat_mean_square(chains.place_gradient).sqrt(),
        )

    def _propose(
        self, chains: Chains, scale: Tensor, place_scale: Tensor, size: Tensor, moves: Tensor
    ) -> Chains:
        count = len(chains)
        scale, place_scale = self.per_chain(scale, count), self.per_chain(place_scale, count)
        drift = 0.5 * size.square() * chains.q_gradient / (scale + 1e-6)
        q = chains.q - drift + NOISE * size * self.normal(*chains.q.shape)
        slide = chains.place_gradient / (place_scale + 1e-6)
        slide = 0.5 * size[..., None].square() * slide
        place = (chains.contacts.place - slide).clamp(-MAX_PLACE, MAX_PLACE)
        slot = (self.uniform(count) * self._options.contacts).long()
        switched = chains.contacts.with_one(slot, ~moves, self.random_contacts(count, 1))
        return self.evaluate(
            torch.where(moves[:, None], q, chains.q),
            Contacts(
                switched.region,
                torch.where(moves[:, None, None], place, switched.place),
            ),
        )


def refinement_steps(steps: int) -> int:
    """Refinement steps that go with so many steps: the published proportion."""
    return max(1, round(steps * REFINEMENT_STEPS / PUBLISHED_STEPS))
