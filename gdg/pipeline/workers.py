"""Worker processes that share the machine's cores instead of fighting for them."""

from __future__ import annotations

import os


def limit_threads(workers: int) -> None:
    """Gives this worker its share of the cores, for torch and numba alike."""
    import numba
    import torch

    share = max(1, (os.cpu_count() or 1) // workers)
    torch.set_num_threads(share)
    numba.set_num_threads(share)
