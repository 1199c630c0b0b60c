"""Several processes give what one gives, and a killed one is told."""

from __future__ import annotations

import os
import signal

import pytest

from gdg.errors import GdgError
from gdg.pipeline.workers import run_all


def double(number: int) -> int:
    return 2 * number


def die(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.parametrize("workers", [1, 2])
def test_every_item_comes_back_with_its_result(workers: int):
    assert sorted(run_all(double, [1, 2, 3], workers)) == [(1, 2), (2, 4), (3, 6)]


def test_a_killed_worker_is_told_in_one_sentence():
    with pytest.raises(GdgError, match="a worker process was killed"):
        list(run_all(die, [1, 2], 2))


def test_leaving_early_stops_the_workers():
    results = run_all(double, [1, 2, 3], 2)
    next(results)
    results.close()
    with pytest.raises(StopIteration):
        next(results)
