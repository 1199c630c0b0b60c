"""Actors of a Ray cluster: Ray places and watches them, results travel through it.

Nodes need gdg, and the folders of hands and objects that are given by path; they share no disk.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gdg.engine.answer import answer
from gdg.engine.pool import News, Worker, WorkerPool, one
from gdg.engine.threads import limit_threads, usable_cores
from gdg.errors import GdgError

try:
    import ray
    from ray.exceptions import RayError
except ModuleNotFoundError as _error:
    raise GdgError("engine=ray needs 'ray', not installed here: pip install 'gdg[ray]'") from _error


#: How long a cluster may take to answer a first call, seconds.
KNOCK_S = 10.0


class RayEngine(WorkerPool):
    """One actor per core of a Ray cluster; actors of a lost node are made again elsewhere.

    Nodes that join later are used, too.

    Args:
        workers: actors at once; 0 for one per CPU that the cluster offers.
        threads: of each actor.
        timeout_s: a task that takes longer is stopped; 0 for no limit.
        address: as ``ray.init`` takes it: ``auto``, ``host:port``, ``ray://host:port``. Empty:
            ``RAY_ADDRESS`` where it is set, else a Ray of its own on this machine, which ends
            with this process. A Ray that this process is connected to is used as it is.
        gpu: share the cluster's GPUs evenly among the actors.
        size: how many times ``timeout_s`` a task may take.
    """

    def __init__(
        self,
        workers: int = 0,
        *,
        threads: int = 1,
        timeout_s: float = 0.0,
        address: str = "",
        gpu: bool = False,
        size: Callable[[Any], int] = one,
    ):
        super().__init__(timeout_s, size)
        self._wanted, self._threads, self._gpu = workers, threads, gpu
        self._address = address
        self._ours = False

    def _open(self) -> None:
        if ray.is_initialized():
            return
        address = self._address or os.environ.get("RAY_ADDRESS", "")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        where: dict[str, Any] = {"address": address}
        if not address:
            cores = self._wanted or usable_cores()
            where = {"address": "local", "include_dashboard": False, "num_cpus": cores}
        try:
            _knock(address)
            ray.init(**where, log_to_driver=False, logging_level=logging.ERROR)
        except (RayError, ConnectionError, RuntimeError, ValueError, OSError) as error:
            reason = " ".join(str(error).split())
            raise GdgError(
                f"ray_address={address or 'local'}: no connection to Ray: {reason} (Is it up, with "
                f"this version of Ray and Python? One that asks for a token wants "
                f"RAY_AUTH_MODE=token beside an address.)"
            ) from error
        self._ours = True

    def _close(self) -> None:
        if self._ours:
            ray.shutdown()
            self._ours = False

    def _capacity(self) -> int:
        offered = int(ray.cluster_resources().get("CPU", 0))
        # with no node left it waits for one to come
        return min(self._wanted, offered) if self._wanted else offered

    def _start(self) -> Worker:
        actor: Any = _ACTOR.options(num_gpus=self._gpu_share()).remote(self._threads)
        return _RayWorker(actor=actor, reply=actor.ready.remote())

    def _gpu_share(self) -> float:
        if not self._gpu:
            return 0.0
        resources = ray.cluster_resources()
        if not resources.get("GPU"):
            raise GdgError("device=cuda: the Ray cluster offers no GPU; write device=cpu.")
        actors = self._wanted or resources["CPU"]
        # Ray counts in steps of 1/10000
        return min(1.0, int(1e4 * resources["GPU"] / actors) / 1e4)

    def _send(self, worker: Worker, function: Callable[[Any], Any], task: Any) -> None:
        assert isinstance(worker, _RayWorker)
        worker.reply = worker.actor.call.remote(function, task)

    def _wait(self, workers: Sequence[Worker], seconds: float) -> list[News]:
        by_reply = {w.reply: w for w in workers if isinstance(w, _RayWorker) and w.reply}
        if not by_reply:
            time.sleep(seconds)
            return []
        done, _ = ray.wait(list(by_reply), num_returns=1, timeout=seconds)
        if done:  # all that are there by now
            done, _ = ray.wait(list(by_reply), num_returns=len(by_reply), timeout=0)
        return [self._news(by_reply[reply]) for reply in done]

    def _news(self, worker: _RayWorker) -> News:
        reply, worker.reply = worker.reply, None
        try:
            return News(worker, ray.get(reply))
        except RayError as error:
            return News(worker, None, f"Ray: {type(error).__name__}")

    def _kill(self, worker: Worker) -> None:
        assert isinstance(worker, _RayWorker)
        ray.kill(worker.actor)


def _knock(address: str) -> None:
    """Tries ``host:port``, for which Ray itself would wait minutes.

    Raises:
        OSError: nobody answers there.
    """
    host, _, port = address.rpartition(":")
    if "/" not in host and port.isdigit():
        socket.create_connection((host, int(port)), KNOCK_S).close()


@dataclass(eq=False)
class _RayWorker(Worker):
    actor: Any = None
    reply: Any = None


class _Actor:
    """A worker process somewhere in the cluster."""

    def __init__(self, threads: int):
        limit_threads(threads)

    def ready(self) -> bytes:
        """Answers once the actor has started."""
        return b""

    def call(self, function: Callable[[Any], Any], task: Any) -> bytes:
        """What the function returns or raises, packed."""
        return answer(function, task)


# the pool replaces dead actors itself, so that a task is counted as given up in one way only
_ACTOR: Any = ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy="SPREAD")(_Actor)
