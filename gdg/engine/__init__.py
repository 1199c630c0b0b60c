"""Where tasks run: processes of this machine, or a Ray cluster, behind one interface. Light."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gdg.engine.base import Engine, Outcome, TaskTimedOut, WorkersKilled
from gdg.engine.pool import one

__all__ = ["Engine", "Outcome", "TaskTimedOut", "WorkersKilled", "make_engine"]


def make_engine(
    name: str,
    workers: int = 0,
    *,
    threads: int = 1,
    timeout_s: float = 0.0,
    address: str = "",
    gpu: bool = False,
    size: Callable[[Any], int] = one,
) -> Engine:
    """The engine called ``local`` or ``ray``.

    Args:
        name: ``local`` or ``ray``.
        workers: processes at once; 0 for one per core that may be used.
        threads: of each worker; results that must not depend on the machine ask for 1.
        timeout_s: a task that takes longer is stopped; 0 for no limit.
        address: of the Ray cluster; see ``RayEngine``.
        gpu: whether tasks use a GPU; Ray then places workers where there is one.
        size: how many times ``timeout_s`` a task may take: the number of its parts, say.

    Raises:
        GdgError: Ray is not installed, or there is no cluster at the address.
    """
    if name == "ray":
        from gdg.engine.ray import RayEngine

        return RayEngine(
            workers, threads=threads, timeout_s=timeout_s, address=address, gpu=gpu, size=size
        )
    from gdg.engine.local import LocalEngine

    return LocalEngine(workers, threads=threads, timeout_s=timeout_s, size=size)
