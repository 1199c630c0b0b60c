"""How many cores there are, and how many threads one process uses of them."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """Cores that this process may run on (its affinity, where the system tells)."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def limit_threads(threads: int) -> int:
    """Lets torch, and compiled passes, use this many threads; gives the number before.

    Sums over several threads are rounded in another order than over one, so results that must
    be the same everywhere are computed with one.
    """
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    return before
