"""Compiled passes over a batch in several threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import numpy as np
import pytest
import torch

from gdg.multicore import one_torch_thread, over_batch

ROWS = 1000


@pytest.fixture(params=[1, 2, 3], autouse=True)
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@over_batch(0, 1)
def sums(rows: np.ndarray, others: np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Stands in for a compiled pass; the second result says which thread computed a row."""
    who = np.full(len(rows), threading.get_ident())
    return factor * (rows + others).sum(-1), who


@pytest.mark.parametrize("others", [1, ROWS])
@pytest.mark.parametrize("rows", [0, 1, 17, ROWS])
def test_parts_give_what_the_whole_gives(rows: int, others: int):
    generator = np.random.default_rng(0)
    a, b = generator.random((rows, 3)), generator.random((min(others, rows) or 1, 3))
    found, _ = sums(a, b, 2.0)
    np.testing.assert_array_equal(found, 2.0 * (a + b).sum(-1))


def test_the_work_is_in_other_threads_only_if_torch_may_use_several(threads: int):
    _, who = sums(np.zeros((ROWS, 3)), np.zeros((1, 3)), 1.0)
    assert (set(who) == {threading.get_ident()}) == (threads == 1)


def several_threads_work() -> bool:
    _, who = sums(np.zeros((ROWS, 3)), np.zeros((1, 3)), 1.0)
    return len(set(who)) > 1


def test_torch_is_left_one_thread_and_gets_the_others_back(threads: int):
    with one_torch_thread(), one_torch_thread():
        assert torch.get_num_threads() == 1
        assert several_threads_work() == (threads > 1)
    assert torch.get_num_threads() == threads
    assert several_threads_work() == (threads > 1)


def test_work_at_the_same_time_gives_torch_all_its_threads_back(threads: int):
    inside, leave = threading.Barrier(2, timeout=30), threading.Event()
    seen: list[bool | int] = []

    def stays_longer() -> None:  # and begins when torch has one thread
        with one_torch_thread():
            seen.append(several_threads_work())
            inside.wait()
            leave.wait(30)

    other = threading.Thread(target=stays_longer, daemon=True)
    with one_torch_thread():
        other.start()
        inside.wait()
    leave.set()
    other.join(30)
    assert torch.get_num_threads() == threads
    later = threading.Thread(target=lambda: seen.append(torch.get_num_threads()), daemon=True)
    later.start()
    later.join(30)
    assert seen == [threads > 1, threads]


def test_what_a_part_raises_comes_out():
    @over_batch(0)
    def fails(rows: np.ndarray) -> np.ndarray:
        if rows[-1] == ROWS - 1:
            raise ValueError("the last row")
        return rows

    with pytest.raises(ValueError, match="the last row"):
        fails(np.arange(ROWS))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:This process.*multi-threaded:DeprecationWarning")
def test_a_forked_process_starts_threads_of_its_own():
    sums(np.zeros((ROWS, 3)), np.zeros((1, 3)), 1.0)
    child = os.fork()
    if child == 0:
        found, _ = sums(np.ones((ROWS, 3)), np.zeros((1, 3)), 1.0)
        os._exit(0 if (found == 3.0).all() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
