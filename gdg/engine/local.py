"""Processes of this machine."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

from gdg.engine.base import Outcome, Result, Task
from gdg.engine.pool import News, Worker, WorkerPool, one, timed_out
from gdg.engine.process import ProcessEnded, WorkerProcess
from gdg.engine.threads import limit_threads, usable_cores


class LocalEngine(WorkerPool):
    """Spawned processes that end with this one, however it ends; one worker is this process.

    Args:
        workers: processes at once; 0 for one per core that may be used. With 1, tasks run in this
            process, where nothing is started and nothing is replaced if it is killed.
        threads: of each worker.
        timeout_s: a task that takes longer is stopped; 0 for no limit. With one worker it is
            stopped at its next Python statement, and only where the system has timers (not on
            Windows) and this is the main thread.
        size: how many times ``timeout_s`` a task may take.
    """

    def __init__(
        self,
        workers: int = 0,
        *,
        threads: int = 1,
        timeout_s: float = 0.0,
        size: Callable[[Any], int] = one,
    ):
        super().__init__(timeout_s, size)
        self.workers = workers or usable_cores()
        self._threads = threads

    def run(
        self, function: Callable[[Task], Result], take: Callable[[Task | None], Task | None]
    ) -> Generator[Outcome[Task, Result], None, None]:
        """See the interface."""
        if self.workers > 1:
            return super().run(function, take)
        return self._run_here(function, take)

    def _run_here(
        self, function: Callable[[Task], Result], take: Callable[[Task | None], Task | None]
    ) -> Generator[Outcome[Task, Result], None, None]:
        last: Task | None = None
        while (task := take(last)) is not None:
            last = task
            before, limit = limit_threads(self._threads), self._limit_s(task)
            try:
                with _alarm(limit):
                    outcome = Outcome(task, function(task))
            except _Alarm:
                outcome = Outcome(task, None, timed_out(limit))
            except Exception as error:  # as a worker does: a bug in one leaves the others alone
                outcome = Outcome(task, None, error)
            finally:
                limit_threads(before)
            yield outcome

    def _capacity(self) -> int:
        return self.workers

    def _start(self) -> Worker:
        return _LocalWorker(process=WorkerProcess(self._threads))

    def _send(self, worker: Worker, function: Callable[[Any], Any], task: Any) -> None:
        assert isinstance(worker, _LocalWorker)
        worker.process.send(function, task)

    def _wait(self, workers: Sequence[Worker], seconds: float) -> list[News]:
        by_connection = {w.process.connection: w for w in workers if isinstance(w, _LocalWorker)}
        news = []
        for connection in wait(list(by_connection), seconds):
            worker = by_connection[connection]  # type: ignore[index]
            try:
                news.append(News(worker, worker.process.receive()))
            except ProcessEnded as ended:
                news.append(News(worker, None, str(ended)))
        return news

    def _kill(self, worker: Worker) -> None:
        assert isinstance(worker, _LocalWorker)
        worker.process.kill()


@dataclass(eq=False)
class _LocalWorker(Worker):
    process: WorkerProcess = None  # type: ignore[assignment]


class _Alarm(BaseException):
    """Time is up; no ``except Exception`` on the way swallows it."""


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """Raises ``_Alarm`` inside the body after so many seconds; 0 for never."""
    main = threading.current_thread() is threading.main_thread()
    if not seconds or not main or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(*_: object) -> None:
        raise _Alarm

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
