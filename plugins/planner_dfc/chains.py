"""Markov chains of grasps: their state, and the steps that every sampler shares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from .energy import Contacts, GraspEnergy, Terms, Touch

#: Logits beyond this put a contact within 0.7 % of a region's edge; farther, they'd get stuck.
MAX_PLACE = 5.0
#: Forgetting factor of running means of gradients (DexGraspNet).
GRADIENT_MEMORY = 0.98

Rows = TypeVar("Rows", "Chains", Contacts, Terms, Touch)


@dataclass(frozen=True)
class Chains:
    """State of all chains: where they are, their energy terms and its gradient there.

    Those of several objects lie object by object, equally many each.
    """

    q: Float[Tensor, "batch dof"]
    contacts: Contacts
    terms: Terms
    q_gradient: Float[Tensor, "batch dof"]
    place_gradient: Float[Tensor, "batch contact 2"]

    def __len__(self) -> int:
        return len(self.q)


def select(state: Rows, index: Int[Tensor, "kept"]) -> Rows:
    """The chains at the given indices."""
    return _per_tensor(lambda values: values[index], state)


def choose(accept: Bool[Tensor, "batch"], new: Rows, old: Rows) -> Rows:
    """Of each chain the new state where accepted, else the old one."""
    return _per_tensor(
        lambda a, b: torch.where(accept.reshape(-1, *(1,) * (a.ndim - 1)), a, b), new, old
    )


def _per_tensor(function, *states):  # type: ignore[no-untyped-def]
    """Applies a function to every tensor of states of one class."""
    changed = {}
    for field in fields(states[0]):
        values = [getattr(state, field.name) for state in states]
        combine = (
            function if isinstance(values[0], Tensor) else lambda *v: _per_tensor(function, *v)
        )
        changed[field.name] = combine(*values)
    return replace(states[0], **changed)


class ChainSteps:
    """Evaluation, contact choice and Metropolis acceptance of chains.

    Chains of different objects know nothing of each other: what they share (gradient scales,
    culling) they share with those of their own object, and random numbers come from its own
    generator. So what an object gets is the same, but for rounding, whatever stands beside it.

    Args:
        energy: of one hand on one or many objects.
        generators: one per object; every random choice for its chains comes from it.

    Attributes:
        accepted: of each object, proposals that were accepted so far.
        proposed: proposals so far, of every object.
    """

    def __init__(self, energy: GraspEnergy, generators: Sequence[torch.Generator]):
        self.energy, self._generators = energy, generators
        self.accepted: Int[Tensor, "object"] = torch.zeros(
            len(generators), dtype=torch.long, device=energy.hand.device
        )
        self.proposed = 0

    def evaluate(
        self,
        q: Tensor,
        contacts: Contacts,
        stride: int = 1,
        hardness: float = 1.0,
        margin_m: float = 0.0,
    ) -> Chains:
        """Energy terms and gradient at a state; a gradient that is not finite stays so in q."""
        q = q.detach().requires_grad_(True)
        place = contacts.place.detach().requires_grad_(True)
        terms = self.energy.terms(q, Contacts(contacts.region, place), stride, margin_m)
        total = self.energy.total(terms, hardness)
        q_gradient, place_gradient = torch.autograd.grad(total.sum(), (q, place))
        return Chains(
            q.detach(),
            Contacts(contacts.region, place.detach()),
            _per_tensor(Tensor.detach, terms),
            q_gradient,
            place_gradient.nan_to_num(),
        )

    def metropolis(
        self,
        old: Chains,
        new: Chains,
        temperature: float | Float[Tensor, "batch"],
        hardness: float = 1.0,
    ) -> tuple[Chains, Bool[Tensor, "batch"]]:
        """Accepts with probability min(1, exp((E − E')/T)); never a state that is not finite."""
        before = self.energy.total(old.terms, hardness)
        after = self.energy.total(new.terms, hardness)
        drawn = self.uniform(len(old))
        accept = drawn < torch.exp(((before - after) / temperature).clamp(max=0.0))
        accept &= torch.isfinite(after) & torch.isfinite(new.q_gradient).all(-1)
        mine = self.energy.objects.per_object(accept)
        self.accepted += mine.sum(-1)
        self.proposed += mine.shape[1]
        return choose(accept, new, old), accept

    def random_contacts(self, chains: int, *shape: int) -> Contacts:
        """Random places, away from the edges, of random regions."""
        regions = len(self.energy.hand.regions.corners)
        region = (self.uniform(chains, *shape) * regions).long()
        return Contacts(region, 4 * self.uniform(chains, *shape, 2) - 2)

    def uniform(self, chains: int, *shape: int) -> Tensor:
        """Uniform numbers in [0, 1), (chains, *shape), on the hand's device."""
        return self._drawn(torch.rand, chains, shape)

    def normal(self, chains: int, *shape: int) -> Tensor:
        """Standard normal numbers, (chains, *shape), on the hand's device."""
        return self._drawn(torch.randn, chains, shape)

    def _drawn(
        self, draw: Callable[..., Tensor], chains: int, shape: Sequence[int]
    ) -> Float[Tensor, "batch *rest"]:
        each = chains // len(self._generators)
        parts = [draw(each, *shape, generator=generator) for generator in self._generators]
        return torch.cat(parts).to(self.energy.hand.device)

    def mean(self, values: Float[Tensor, "batch *rest"]) -> Float[Tensor, "object *rest"]:
        """Mean over each object's chains with finite values, so that a bad one spoils no other.

        1 where there is none.
        """
        good = torch.isfinite(values).reshape(len(values), -1).all(-1)
        good = good.reshape(-1, *(1,) * (values.ndim - 1))
        objects = self.energy.objects
        summed = objects.per_object(torch.where(good, values, 0.0)).sum(1)
        count = objects.per_object(good).sum(1)
        return torch.where(count > 0, summed / count, 1.0)

    def flat_mean_square(
        self, gradient: Float[Tensor, "batch contact 2"]
    ) -> Float[Tensor, "object 1 1"]:
        """One mean square for all of an object's places: a contact's slot means nothing."""
        return self.mean(gradient.square()).mean((1, 2), keepdim=True)

    def per_chain(
        self, values: Float[Tensor, "object *rest"], chains: int
    ) -> Float[Tensor, "batch *rest"]:
        """What belongs to objects, for each of so many chains in all."""
        return self.energy.objects.per_hand(values, chains)


def remember(mean: Tensor, value: Tensor) -> Tensor:
    """The running mean with one more value."""
    return GRADIENT_MEMORY * mean + (1 - GRADIENT_MEMORY) * value
