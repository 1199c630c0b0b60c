"""Compiled passes over a batch, on as many cores as torch may use.

numba's own threads (``parallel=True``) would take three times as long to compile, start a second
OpenMP beside torch's, and have their number set apart. Compiled code that lets go of the GIL runs
as well in ordinary threads.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache, wraps
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import torch

#: Rows of a batch that are worth a thread: handing them over takes some 20 µs, and passes that the
#: fit spends its time in some 10 µs per row.
LEAST_ROWS = 16

Pass = TypeVar("Pass", bound=Callable[..., Any])
Item = TypeVar("Item")
Result = TypeVar("Result")


class _Shared:
    """How many threads torch had before work left it one, with which new threads begin, too."""

    lock, users, threads = threading.Lock(), 0, 0


class _Left(threading.local):
    """What the work of this thread has left to passes, 0 for nothing."""

    threads = 0


_left = _Left()


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Leaves all of torch's threads but one to compiled passes while it lasts.

    For work that is mostly theirs: torch's own threads would wait, spinning, for small operations
    on the cores that the passes need.
    """
    outer = _left.threads
    with _Shared.lock:
        if not _Shared.users:
            _Shared.threads = torch.get_num_threads()
        _Shared.users += 1
        threads = outer or _Shared.threads
    try:
        _left.threads = threads
        torch.set_num_threads(1)
        yield
    finally:
        _left.threads = outer
        torch.set_num_threads(1 if outer else threads)
        with _Shared.lock:
            _Shared.users -= 1


def over_batch(*batched: int) -> Callable[[Pass], Pass]:
    """Decorates a compiled pass (``nogil``) whose results have the batch as first axis.

    Args:
        batched: positions of its arguments that may have the batch as first axis, the first one
            always; others of length 1 hold for all rows.
    """

    def decorate(compiled: Pass) -> Pass:
        @wraps(compiled)
        def run(*arguments: Any) -> Any:
            rows, threads = len(arguments[batched[0]]), _left.threads or torch.get_num_threads()
            parts = min(rows // LEAST_ROWS, threads)
            if parts < 2:
                return compiled(*arguments)
            bounds = [rows * part // parts for part in range(parts + 1)]
            own, *others = (slice(*ends) for ends in pairwise(bounds))

            def on_part(part: slice) -> Any:
                given = list(arguments)
                for position in batched:
                    if len(given[position]) == rows:
                        given[position] = given[position][part]
                return compiled(*given)

            rest = [_pool(threads - 1).submit(on_part, part) for part in others]
            return _joined([on_part(own), *(part.result() for part in rest)])

        return run  # type: ignore[return-value]

    return decorate


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The function's result for each item, in order, from as many threads as torch may use.

    For a function that mostly lets go of the GIL and doesn't call this one.
    """
    threads = torch.get_num_threads()
    if threads < 2:
        return [function(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, items))


def _joined(parts: list[Any]) -> Any:
    if isinstance(parts[0], tuple):
        return tuple(np.concatenate(one) for one in zip(*parts))
    return np.concatenate(parts)


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="gdg-batch")


if hasattr(os, "register_at_fork"):  # threads don't survive a fork
    os.register_at_fork(after_in_child=_pool.cache_clear)
