"""Worker processes that share the machine's cores instead of fighting for them."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import TypeVar

from gdg.errors import GdgError

Item = TypeVar("Item")
Result = TypeVar("Result")


def run_all(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int
) -> Iterator[tuple[Item, Result]]:
    """Yields (item, result) as each ends, from ``workers`` processes (1: from this one).

    On Ctrl-C, and on any other exception, what waits is dropped and the workers are stopped.

    Raises:
        GdgError: a worker was killed, by the system for want of memory, say.
    """
    if workers == 1 or len(items) <= 1:
        for item in items:
            yield item, function(item)
        return
    pool = ProcessPoolExecutor(
        min(workers, len(items)),
        mp_context=get_context("spawn"),
        initializer=_start_worker,
        initargs=(workers,),
    )
    try:
        futures = {pool.submit(function, item): item for item in items}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as error:
        raise GdgError(
            "a worker process was killed (out of memory?); what was finished is kept: run the "
            "same command again, with fewer workers."
        ) from error
    except BaseException:
        for process in (pool._processes or {}).values():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _start_worker(workers: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers itself
    limit_threads(workers)


def limit_threads(workers: int) -> None:
    """Gives this process its share of the cores that it may use, for torch and numba alike."""
    import numba
    import torch

    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    share = max(1, cores // workers)
    torch.set_num_threads(share)
    # numba refuses more than it started with (NUMBA_NUM_THREADS, or the cores that it saw)
    numba.set_num_threads(min(share, numba.get_num_threads()))
