"""Which items each step gets: a function of seed, epoch and step, computed a batch at a time.

Nothing is kept of what was drawn before, so memory does not grow with the dataset and a run can
be taken up at any step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from torch.utils.data import Sampler

from gdg.training.randomness import derived_seed

Balance = Literal["none", "pairs", "hands"]
#: Rounds of the Feistel network; four make it a good permutation, more cost little.
ROUNDS = 6
#: Tells the seed of a step's data from that of the module's own random numbers.
OF_DATA = 1
#: Odd constants of a multiplicative hash (those of the splitmix64 generator).
MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))


class Step(NamedTuple):
    """What one step of one process gets.

    Attributes:
        indices: of the items.
        seed: of the choice of points and of the augmentation; None for validation.
    """

    indices: np.ndarray
    seed: int | None


@dataclass(frozen=True)
class Place:
    """A place in a run: the epoch, and how many of its steps are done."""

    epoch: int = 0
    steps: int = 0


def permuted(positions: np.ndarray, total: int, *key: int) -> np.ndarray:
    """Where a random permutation of ``range(total)`` sends some positions.

    A Feistel network on the least even number of bits that holds ``total``, walked on until it
    comes back into the range: a permutation that no memory holds.

    Args:
        positions: whole numbers in ``range(total)``.
        total: how many are permuted.
        key: whole numbers, not negative, that choose the permutation.
    """
    half = np.uint64(max(1, (max(total - 1, 1).bit_length() + 1) // 2))
    mask = (np.uint64(1) << half) - np.uint64(1)
    keys = np.random.SeedSequence(key).generate_state(ROUNDS, np.uint64)
    out = np.asarray(positions, np.uint64).copy()
    outside = np.ones(out.shape, bool)
    while outside.any():
        left, right = out[outside] >> half, out[outside] & mask
        for round_key in keys:
            left, right = right, left ^ (_mixed(right, round_key) & mask)
        out[outside] = (left << half) | right
        outside = out >= total
    return out.astype(np.int64)


def _mixed(values: np.ndarray, key: np.uint64) -> np.ndarray:
    mixed = values ^ key  # products of arrays wrap around, as they should
    for factor in MIX:
        mixed = (mixed ^ (mixed >> np.uint64(30))) * factor
    return mixed ^ (mixed >> np.uint64(31))


class ItemOrder:
    """The items of an epoch, in random order; an epoch has as many as there are.

    Args:
        classes: number of items in each class, whose indices follow one another. Each class comes
            equally often (to one item); within a class every item comes once before any comes
            again. One class of all items is the plain shuffle.
        seed: with the epoch, decides the order.
    """

    def __init__(self, classes: Sequence[int], seed: int):
        self._sizes = np.asarray([size for size in classes if size], np.int64)
        self._starts = np.cumsum(self._sizes) - self._sizes
        self._seed = seed

    def __len__(self) -> int:
        return int(self._sizes.sum())

    def indices(self, epoch: int, start: int, stop: int) -> np.ndarray:
        """The indices of the items at the places ``start`` to ``stop`` of an epoch."""
        places = permuted(np.arange(start, stop), len(self), self._seed, epoch)
        number_of, draw = places % len(self._sizes), places // len(self._sizes)
        cycle, position = draw // self._sizes[number_of], draw % self._sizes[number_of]
        found = np.empty(stop - start, np.int64)
        for number, round_ in set(zip(number_of.tolist(), cycle.tolist(), strict=True)):
            here = (number_of == number) & (cycle == round_)
            # from 1: a sequence that ends in zeros seeds as one without them
            key = (self._seed, epoch, number + 1, round_ + 1)
            inside = permuted(position[here], int(self._sizes[number]), *key)
            found[here] = self._starts[number] + inside
        return found


class TrainingSteps(Sampler[Step]):
    """The steps of an epoch for one of several processes, from any step on.

    All processes get equally many items in each step, and no step has a single item, from which
    batch norm could not learn: what is left over at an epoch's end is dropped.

    Args:
        order: of the items.
        batch: items per step and process.
        seed: of what is random in a step.
        rank: number of this process.
        processes: how many there are.
        start: where a resumed run goes on.
    """

    def __init__(
        self,
        order: ItemOrder,
        batch: int,
        seed: int,
        rank: int = 0,
        processes: int = 1,
        start: Place | None = None,
    ):
        self._order, self._batch, self._seed = order, batch, seed
        self._rank, self._processes = rank, processes
        self._start = start or Place()
        self._epoch = self._start.epoch
        #: Lightning calls ``set_epoch`` of a batch sampler's sampler.
        self.sampler = self

    def set_epoch(self, epoch: int) -> None:
        """Chooses the epoch, counted from 0."""
        self._epoch = epoch

    def __len__(self) -> int:
        """Steps of a whole epoch, wherever the run is taken up."""
        whole, last = self._whole_and_last()
        return whole + (last > 1)

    def _whole_and_last(self) -> tuple[int, int]:
        """Whole steps of an epoch, and what each process would get in the step after them."""
        whole, rest = divmod(len(self._order), self._batch * self._processes)
        return whole, rest // self._processes

    def __iter__(self) -> Iterator[Step]:
        epoch, (whole, last) = self._epoch, self._whole_and_last()
        done = self._start.steps if epoch == self._start.epoch else 0
        for step in range(done, len(self)):
            size = self._batch if step < whole else last
            start = step * self._batch * self._processes + self._rank * size
            seed = derived_seed(self._seed, epoch, step, self._rank, OF_DATA)
            yield Step(self._order.indices(epoch, start, start + size), seed)


class ValidationSteps(Sampler[Step]):
    """All items in order; several processes share the steps if there are enough for all."""

    def __init__(self, items: int, batch: int, rank: int = 0, processes: int = 1):
        starts = range(0, items, batch)
        own = starts[rank::processes] if len(starts) >= processes else starts
        self._steps = [Step(np.arange(at, min(at + batch, items)), None) for at in own]

    def __len__(self) -> int:
        return len(self._steps)

    def __iter__(self) -> Iterator[Step]:
        return iter(self._steps)
