"""Annealed Metropolis-adjusted Langevin sampling of grasps with contact switching."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from .energy import Contacts, GraspEnergy
from .options import DfcOptions

#: Forgetting factor of the running mean of squared gradients (DexGraspNet).
GRADIENT_MEMORY = 0.98
#: Logits beyond this put a contact within 0.7 % of a region's edge; farther, they'd get stuck.
MAX_PLACE = 5.0


@dataclass
class Chains:
    """State of all chains: position, its energy and its gradient."""

    q: Float[Tensor, "batch dof"]
    contacts: Contacts
    energy: Float[Tensor, "batch"]
    q_gradient: Float[Tensor, "batch dof"]
    place_gradient: Float[Tensor, "batch contact 2"]


class Mala:
    """Runs chains of one hand on one object.

    Proposals are x − 2 u s g/√E[g²] + ``noise`` s N(0, I) with u uniform in [0, 1]; a proposal is
    accepted with probability min(1, exp((E − E')/T)). Step s and temperature T decay geometrically
    (Wang et al. 2023), where the published MALA (Liu et al. 2021) ties both to the energy. A chain
    whose proposal is not finite rejects it, so it never spreads.
    """

    def __init__(self, energy: GraspEnergy, options: DfcOptions, generator: torch.Generator):
        self._energy, self._options, self._generator = energy, options, generator
        self.accepted = 0
        self.proposed = 0

    def run(
        self, q: Float[Tensor, "batch dof"], report: Callable[[int], None]
    ) -> tuple[Float[Tensor, "batch dof"], Contacts]:
        """Runs ``options.steps`` steps from q; gives the chains' last states."""
        chains = self._evaluate(q, self._random_contacts(len(q)))
        q_scale = torch.zeros_like(q[:1])
        place_scale = torch.zeros(1, device=q.device)
        for step in range(self._options.steps):
            q_scale = _remember(q_scale, _mean_square(chains.q_gradient), step)
            place_scale = _remember(place_scale, _mean_square(chains.place_gradient).mean(), step)
            proposal = self._propose(chains, q_scale.sqrt(), place_scale.sqrt(), step)
            temperature = self._options.temperature * self._options.decay ** (
                step / self._options.temperature_period
            )
            chains = self._choose(chains, proposal, temperature)
            report(step + 1)
        return chains.q, chains.contacts

    def _propose(self, chains: Chains, q_scale: Tensor, place_scale: Tensor, step: int) -> Chains:
        o = self._options
        size = o.step_size * o.decay ** (step / o.step_period)
        # the steps vary between chains and times: some explore while others settle
        factor = 2 * self._uniform(len(chains.q), 1)
        move = factor * size * chains.q_gradient / (q_scale + 1e-6)
        noise = torch.randn(chains.q.shape, generator=self._generator).to(chains.q.device)
        q = chains.q - move.clamp(-0.1, 0.1) + o.noise * size * noise
        # a region is about 20 mm wide, so a logit of 1 is about 5 mm: 50 times a metre's step
        slide = factor[..., None] * 50 * size * chains.place_gradient / (place_scale + 1e-6)
        place = (chains.contacts.place - slide.clamp(-1, 1)).clamp(-MAX_PLACE, MAX_PLACE)
        contacts = Contacts(chains.contacts.region, place)
        if step < (1 - o.settle_share) * o.steps:
            contacts = self._switch(contacts)
        return self._evaluate(q, contacts)

    def _switch(self, contacts: Contacts) -> Contacts:
        """Moves one contact of some chains to a random place of a random region."""
        batch, count = contacts.region.shape
        fresh = self._random_contacts(batch)
        chosen = (self._uniform(batch, 1) < self._options.switch_probability) & (
            torch.arange(count, device=contacts.region.device)
            == (self._uniform(batch, 1) * count).long()
        )
        return Contacts(
            torch.where(chosen, fresh.region, contacts.region),
            torch.where(chosen[..., None], fresh.place, contacts.place),
        )

    def _choose(self, old: Chains, new: Chains, temperature: float) -> Chains:
        drawn = self._uniform(len(old.q))
        accept = drawn < torch.exp(((old.energy - new.energy) / temperature).clamp(max=0.0))
        accept &= torch.isfinite(new.energy) & torch.isfinite(new.q_gradient).all(-1)
        self.accepted += int(accept.sum())
        self.proposed += len(accept)
        return Chains(
            _pick(accept, new.q, old.q),
            Contacts(
                _pick(accept, new.contacts.region, old.contacts.region),
                _pick(accept, new.contacts.place, old.contacts.place),
            ),
            _pick(accept, new.energy, old.energy),
            _pick(accept, new.q_gradient, old.q_gradient),
            _pick(accept, new.place_gradient, old.place_gradient),
        )

    def _evaluate(self, q: Tensor, contacts: Contacts) -> Chains:
        q = q.detach().requires_grad_(True)
        place = contacts.place.detach().requires_grad_(True)
        movable = Contacts(contacts.region, place)
        terms = self._energy.terms(q, movable, self._options.surface_stride)
        energy = self._energy.total(terms)
        q_gradient, place_gradient = torch.autograd.grad(energy.sum(), (q, place))
        return Chains(
            q.detach(),
            Contacts(contacts.region, place.detach()),
            energy.detach(),
            q_gradient,
            place_gradient.nan_to_num(),
        )

    def _random_contacts(self, batch: int) -> Contacts:
        regions = len(self._energy.hand.regions.corners)
        count = self._options.contacts
        region = (self._uniform(batch, count) * regions).long()
        return Contacts(region, 4 * self._uniform(batch, count, 2) - 2)

    def _uniform(self, *shape: int) -> Tensor:
        drawn = torch.rand(*shape, generator=self._generator)
        return drawn.to(self._energy.hand.device)


def _mean_square(gradient: Tensor) -> Tensor:
    """Mean over the chains whose gradient is finite, so that a bad one spoils no other."""
    good = torch.isfinite(gradient).reshape(len(gradient), -1).all(-1)
    if not good.any():
        return torch.ones_like(gradient[:1])
    return gradient[good].square().mean(0, keepdim=True)


def _remember(mean: Tensor, value: Tensor, step: int) -> Tensor:
    if step == 0:
        return value
    return GRADIENT_MEMORY * mean + (1 - GRADIENT_MEMORY) * value


def _pick(accept: Bool[Tensor, "batch"], new: Tensor, old: Tensor) -> Tensor:
    return torch.where(accept.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
