"""Compiled passes over a batch, on as many cores as torch may use.

numba's own threads (``parallel=True``) would take three times as long to compile, start a second
OpenMP beside torch's, and have their number set apart. Compiled code that lets go of the GIL runs
as well in ordinary threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, wraps
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import torch

#: Rows of a batch in one thread at a time: handing them over takes some 20 µs, and passes that the
#: fit spends its time in some 10 µs per row; few enough for threads to end together.
LEAST_ROWS, PARTS_PER_THREAD = 16, 4

Pass = TypeVar("Pass", bound=Callable[..., Any])


def over_batch(*batched: int) -> Callable[[Pass], Pass]:
    """Decorates a compiled pass (``nogil``) whose results have the batch as first axis.

    Args:
        batched: positions of its arguments that may have the batch as first axis, the first one
            always; others of length 1 hold for all rows.
    """

    def decorate(compiled: Pass) -> Pass:
        @wraps(compiled)
        def run(*arguments: Any) -> Any:
            rows, threads = len(arguments[batched[0]]), torch.get_num_threads()
            parts = min(rows // LEAST_ROWS, PARTS_PER_THREAD * threads)
            if threads == 1 or parts < 2:
                return compiled(*arguments)
            bounds = [rows * part // parts for part in range(parts + 1)]
            slices = [slice(*ends) for ends in pairwise(bounds)]

            def on_part(part: slice) -> Any:
                own = list(arguments)
                for position in batched:
                    if len(own[position]) == rows:
                        own[position] = own[position][part]
                return compiled(*own)

            return _joined(list(_pool(threads).map(on_part, slices)))

        return run  # type: ignore[return-value]

    return decorate


def _joined(parts: list[Any]) -> Any:
    if isinstance(parts[0], tuple):
        return tuple(np.concatenate(one) for one in zip(*parts))
    return np.concatenate(parts)


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="gdg-batch")


if hasattr(os, "register_at_fork"):  # threads don't survive a fork
    os.register_at_fork(after_in_child=_pool.cache_clear)
