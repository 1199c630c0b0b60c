"""Annealed MALA: fewer and better steps than the published sampler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from .chains import MAX_PLACE, Chains, ChainSteps, remember, select
from .energy import Contacts, GraspEnergy
from .options import DfcOptions

#: A region is about 20 mm wide, so a logit of 1 is about 5 mm: 50 times a metre's step.
LOGITS_PER_METRE = 50.0
#: At the end every contact is so often moved to the best of so many places.
POLISH_SWEEPS, POLISH_TRIES = 3, 64


class AnnealedMala(ChainSteps):
    """Runs chains of one hand on one or many objects.

    Proposals are x − 2 u s g/√E[g²] + ``noise`` s N(0, I) with u uniform in [0, 1]; a proposal is
    accepted with probability min(1, exp((E − E')/T)). Step s and temperature T decay geometrically
    (Wang et al. 2023), where the published MALA (Liu et al. 2021) ties both to the energy. What is
    new here: contacts switch to a likely one of ``switch_tries`` places, the worst chains are
    dropped early, and at the end nothing switches and penetration weighs more.

    Attributes:
        starts: number of chains to start with, per object.
        steps: steps of one run.
    """

    def __init__(
        self, energy: GraspEnergy, options: DfcOptions, generators: Sequence[torch.Generator]
    ):
        super().__init__(energy, generators)
        self._options = options
        self.starts = options.batch * options.oversample
        self.steps = options.steps

    def run(self, q: Tensor, report: Callable[[int], None]) -> Chains:
        """Runs ``options.steps`` steps from q; gives the last states of the chains that are left.

        Args:
            q: starts, (object × batch × oversample, dof).
            report: called with the number of steps done.
        """
        o = self._options
        chains = self.evaluate(
            q, self.random_contacts(len(q), o.contacts), o.surface_stride, 1.0, o.clearance_m
        )
        q_scale, place_scale = self._scales(chains)
        for step in range(o.steps):
            if step == int(o.cull_at * o.steps):
                chains = self._best(chains, o.batch)
            q_now, place_now = self._scales(chains)
            q_scale, place_scale = remember(q_scale, q_now), remember(place_scale, place_now)
            hardness = self._hardness(step)
            proposal = self._propose(chains, q_scale.sqrt(), place_scale.sqrt(), step, hardness)
            chains, _ = self.metropolis(chains, proposal, self._temperature(step), hardness)
            report(step + 1)
        return self._polish(chains)

    def _scales(self, chains: Chains) -> tuple[Tensor, Tensor]:
        """Mean squares of the gradients of each object's chains."""
        return self.mean(chains.q_gradient.square()), self.flat_mean_square(chains.place_gradient)

    def _propose(
        self, chains: Chains, q_scale: Tensor, place_scale: Tensor, step: int, hardness: float
    ) -> Chains:
        o, count = self._options, len(chains)
        q_scale, place_scale = self.per_chain(q_scale, count), self.per_chain(place_scale, count)
        size = o.step_size * o.decay ** (step / o.step_period)
        # the steps vary between chains and times: some explore while others settle
        factor = 2 * self.uniform(count, 1)
        move = factor * size * chains.q_gradient / (q_scale + 1e-6)
        q = chains.q - move.clamp(-0.1, 0.1) + o.noise * size * self.normal(*chains.q.shape)
        slide = chains.place_gradient / (place_scale + 1e-6)
        slide = LOGITS_PER_METRE * factor[..., None] * size * slide
        place = (chains.contacts.place - slide.clamp(-1, 1)).clamp(-MAX_PLACE, MAX_PLACE)
        contacts = Contacts(chains.contacts.region, place)
        if step < (1 - o.settle_share) * o.steps:
            contacts = self._switch(chains, contacts, self._temperature(step))
        return self.evaluate(q, contacts, o.surface_stride, hardness, o.clearance_m)

    def _switch(self, chains: Chains, contacts: Contacts, temperature: float) -> Contacts:
        """Moves one contact of some chains to one of some random places, likely a good one.

        A place is drawn by its Boltzmann weight among those tried, given that the hand and the
        other contacts stay where they are. No correction is made for that in the acceptance: chains
        look for low energies, they do not sample exp(−E/T).
        """
        o, batch = self._options, len(chains)
        chosen = self.uniform(batch) < o.switch_probability
        slot = (self.uniform(batch) * o.contacts).long()
        tries = self.random_contacts(batch, o.switch_tries)
        cost = self._cost_of_switching(chains, slot, tries)
        gumbel = -(-self.uniform(*cost.shape).clamp(min=1e-30).log()).log()
        best = (cost.nan_to_num(nan=1e30) - temperature * gumbel).argmin(-1)
        return contacts.with_one(slot, chosen, _pick(tries, best))

    def _polish(self, chains: Chains) -> Chains:
        """The same hands with each contact in turn moved to the best of many places, if better."""
        o, batch = self._options, len(chains)
        for turn in range(POLISH_SWEEPS * o.contacts):
            slot = torch.full((batch,), turn % o.contacts, device=chains.q.device)
            own = chains.contacts.region[:, slot[:1]], chains.contacts.place[:, slot[:1]]
            fresh = self.random_contacts(batch, POLISH_TRIES)
            tries = Contacts(
                *(torch.cat(pair, dim=1) for pair in zip(own, (fresh.region, fresh.place)))
            )
            best = self._cost_of_switching(chains, slot, tries).nan_to_num(nan=1e30).argmin(-1)
            contacts = chains.contacts.with_one(slot, best > 0, _pick(tries, best))
            touch = self.energy.touch(chains.terms.Ts_world_link, contacts)
            chains = replace(chains, contacts=contacts, terms=replace(chains.terms, touch=touch))
        return chains

    @torch.no_grad()
    def _cost_of_switching(self, chains: Chains, slot: Tensor, tries: Contacts) -> Tensor:
        """Energy that depends on the contact in ``slot``, for each place tried, (batch, try)."""
        o, energy = self._options, self.energy
        touch = energy.touch(chains.terms.Ts_world_link, tries)
        wrenches = energy.wrenches(chains.terms.touch)
        others = wrenches.sum(1) - wrenches[torch.arange(len(slot), device=slot.device), slot]
        net = (others[:, None] + energy.wrenches(touch)) / o.contacts
        return (
            o.force_closure_weight * net.norm(dim=-1)
            + o.distance_weight * touch.distances
            + o.normal_weight * energy.turned_away(touch)
        )

    def _best(self, chains: Chains, count: int) -> Chains:
        """So many chains of each object, the lowest energy first."""
        energy = self.energy.total(chains.terms).nan_to_num(nan=torch.inf)
        of_object = self.energy.objects.per_object(energy)
        first = of_object.shape[1] * torch.arange(len(of_object), device=energy.device)
        best = of_object.argsort(dim=1, stable=True)[:, :count]
        return select(chains, (first[:, None] + best).flatten())

    def _temperature(self, step: int) -> float:
        o = self._options
        return o.temperature * o.decay ** (step / o.temperature_period)

    def _hardness(self, step: int) -> float:
        """Grows from 1 to ``options.hardening`` while the chains settle."""
        o = self._options
        begin = (1 - o.settle_share) * o.steps
        return 1 + (o.hardening - 1) * max(0.0, (step - begin) / max(1.0, o.steps - begin))


def _pick(tries: Contacts, best: Tensor) -> Contacts:
    """One of the places of each chain, as (batch, 1) contacts."""
    index = best[:, None]
    return Contacts(
        tries.region.gather(1, index), tries.place.gather(1, index[..., None].expand(-1, -1, 2))
    )
