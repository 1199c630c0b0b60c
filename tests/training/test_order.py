"""The order of items: every one once, or classes equally often; the same from any step on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from training_samples import synthetic_groups

from gdg.training.items import class_sizes, sorted_groups
from gdg.training.order import ItemOrder, Place, TrainingSteps, ValidationSteps, permuted


@settings(max_examples=40, deadline=None)
@given(total=st.integers(1, 600), key=st.lists(st.integers(0, 2**63), min_size=1, max_size=3))
def test_permutation_reaches_every_place_once(total: int, key: list[int]) -> None:
    assert sorted(permuted(np.arange(total), total, *key)) == list(range(total))


def test_permutation_is_as_random_as_one_drawn() -> None:
    """Where the first of eight goes, and who follows whom, is even over keys."""
    drawn = np.stack([permuted(np.arange(8), 8, key) for key in range(4000)])
    first = np.bincount(drawn[:, 0], minlength=8)
    assert (abs(first - 500) < 5 * np.sqrt(500)).all()
    pairs = np.bincount(8 * drawn[:, 3] + drawn[:, 4], minlength=64).reshape(8, 8)
    assert (np.diag(pairs) == 0).all()
    apart = pairs[~np.eye(8, dtype=bool)]
    assert (abs(apart - 4000 / 56) < 5 * np.sqrt(4000 / 56)).all()


def test_order_of_a_hundred_billion_items_is_computed_a_batch_at_a_time() -> None:
    order = ItemOrder([10**11, 7], seed=0)
    drawn = order.indices(3, 10**10, 10**10 + 1000)
    assert len(drawn) == 1000
    assert (drawn < len(order)).all()
    assert 350 < (drawn >= 10**11).sum() < 650, "the seven items come as often as all others"


@settings(max_examples=25, deadline=None)
@given(
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=5),
    seed=st.integers(0, 99),
    epoch=st.integers(0, 9),
)
def test_classes_come_equally_often_and_no_item_twice_before_all(
    sizes: list[int], seed: int, epoch: int
) -> None:
    order = ItemOrder(sizes, seed)
    drawn = order.indices(epoch, 0, len(order))
    ends = np.cumsum(sizes)
    of_class = np.bincount(np.searchsorted(ends, drawn, side="right"), minlength=len(sizes))
    assert of_class.max() - of_class.min() <= 1
    for size, end in zip(sizes, ends, strict=True):
        times = np.bincount(drawn[(drawn >= end - size) & (drawn < end)] - (end - size))
        times = np.pad(times, (0, size - len(times)))
        assert times.max() - times.min() <= 1
    if len(sizes) == 1:
        assert sorted(drawn) == list(range(sizes[0]))


def test_order_follows_seed_and_epoch() -> None:
    def whole(seed: int, epoch: int) -> list[int]:
        return ItemOrder([50], seed).indices(epoch, 0, 50).tolist()

    assert whole(1, 0) == whole(1, 0)
    assert whole(1, 0) != whole(1, 1)
    assert whole(1, 0) != whole(2, 0)


def test_steps_from_the_middle_are_those_of_the_whole_epoch() -> None:
    order = ItemOrder([30, 9], seed=4)
    whole, rest = TrainingSteps(order, 8, 4), TrainingSteps(order, 8, 4, start=Place(2, 3))
    whole.set_epoch(2)
    assert len(whole) == len(rest) == 5
    for a, b in zip(list(whole)[3:], rest, strict=True):
        np.testing.assert_array_equal(a.indices, b.indices)
        assert a.seed == b.seed
    rest.set_epoch(3)
    assert len(list(rest)) == 5, "later epochs are whole"


@pytest.mark.parametrize(("items", "steps"), [(32, 4), (33, 4), (34, 5), (39, 5)])
def test_last_step_of_one_item_is_dropped(items: int, steps: int) -> None:
    sampler = TrainingSteps(ItemOrder([items], 0), 8, 0)
    drawn = [step.indices for step in sampler]
    assert len(sampler) == len(drawn) == steps
    assert sum(map(len, drawn)) == (items if items != 33 else 32)


def test_processes_share_every_step_evenly() -> None:
    order = ItemOrder([45], seed=0)
    ranks = [list(TrainingSteps(order, 8, 0, rank, 2)) for rank in range(2)]
    assert [len(step.indices) for step in ranks[0]] == [8, 8, 6]
    assert [len(step.indices) for step in ranks[1]] == [8, 8, 6]
    drawn = np.concatenate([step.indices for step in itertools.chain(*ranks)])
    assert len(set(drawn.tolist())) == len(drawn) == 44
    assert len({step.seed for step in itertools.chain(*ranks)}) == 6


def test_validation_steps_of_all_processes_are_all_items_in_order() -> None:
    alone = ValidationSteps(20, 8)
    assert np.concatenate([step.indices for step in alone]).tolist() == list(range(20))
    assert all(step.seed is None for step in alone)
    shared = [step for rank in range(2) for step in ValidationSteps(20, 8, rank, 2)]
    assert sorted(np.concatenate([step.indices for step in shared])) == list(range(20))
    assert all(len(ValidationSteps(20, 8, rank, 5)) == 3 for rank in range(5)), "too few to share"


def test_classes_are_hands_or_pairs() -> None:
    groups = [
        *synthetic_groups(5, 3, hand="b"),
        *synthetic_groups(4, hand="a"),
        *synthetic_groups(2, hand="b"),
    ]
    groups = sorted_groups(groups)
    assert class_sizes(groups, "none") == [14]
    assert class_sizes(groups, "hands") == [4, 10]
    assert class_sizes(groups, "pairs") == [4, 7, 3]
