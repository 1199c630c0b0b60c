"""Several processes give what one gives, and a killed one is told.

The functions are the standard library's, since workers can't import test modules.
"""

from __future__ import annotations

import operator
import os

import pytest

from gdg.errors import GdgError
from gdg.pipeline.workers import run_all


@pytest.mark.parametrize("workers", [1, 2])
def test_every_item_comes_back_with_its_result(workers: int):
    assert sorted(run_all(operator.neg, [1, 2, 3], workers)) == [(1, -1), (2, -2), (3, -3)]


def test_a_killed_worker_is_told_in_one_sentence():
    with pytest.raises(GdgError, match="a worker process was killed"):
        list(run_all(os._exit, [1, 2], 2))


def test_leaving_early_stops_the_workers():
    results = run_all(operator.neg, [1, 2, 3], 2)
    next(results)
    results.close()
    with pytest.raises(StopIteration):
        next(results)
