"""What engines with worker processes share: who gets which task, and what if a worker dies."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from gdg.engine.answer import unpacked
from gdg.engine.base import Engine, Outcome, Result, Task, TaskTimedOut, WorkersKilled

#: A task, or the start of workers, is given up after this many killed processes.
ATTEMPTS = 3
#: How often a pool looks at the clock and at its capacity, seconds.
TICK_S = 1.0


def one(task: Any) -> int:
    """The size of any task that is no group of others."""
    return 1


@dataclass(eq=False)
class Worker:
    """One worker process, as its pool sees it.

    Attributes:
        ready: whether it has started.
        task: what it runs, or None.
        since: when it began that, by the monotonic clock.
        last: what it ran last.
    """

    ready: bool = False
    task: Any = None
    since: float = 0.0
    last: Any = None


@dataclass(frozen=True)
class News:
    """What happened to a worker.

    Attributes:
        worker: which.
        answer: bytes of ``gdg.engine.answer``; b"" when it has started; None when it died.
        reason: why it died, for messages.
    """

    worker: Worker
    answer: bytes | None = None
    reason: str = ""


@dataclass
class _State:
    """The tasks of one run that wait for a worker, and how often each lost one."""

    backlog: deque[Any] = field(default_factory=deque)
    deaths: Counter[int] = field(default_factory=Counter)
    failed_starts: int = 0


class WorkerPool(Engine):
    """An engine that hands tasks to processes and replaces those that die.

    Args:
        timeout_s: a task that takes longer is stopped by killing its worker; 0 for no limit.
        size: how many times ``timeout_s`` a task may take.
    """

    def __init__(self, timeout_s: float = 0.0, size: Callable[[Any], int] = one):
        self._timeout_s, self._size = timeout_s, size
        self._workers: list[Worker] = []

    def run(
        self, function: Callable[[Task], Result], take: Callable[[Task | None], Task | None]
    ) -> Generator[Outcome[Task, Result], None, None]:
        """See the interface."""
        state = _State()
        try:
            self._open()
            while True:
                self._hand_out(function, take, state)
                if not state.backlog and all(worker.task is None for worker in self._workers):
                    return
                for news in self._wait(self._workers, TICK_S):
                    yield from self._heard(news, state)
                yield from self._overdue(state)
        finally:
            for worker in self._workers:
                self._kill(worker)
            self._workers.clear()
            self._close()

    def _hand_out(
        self, function: Callable[[Any], Any], take: Callable[[Any], Any], state: _State
    ) -> None:
        """Gives free workers tasks, and starts workers while there are tasks for them."""
        for worker in self._workers:
            if worker.ready and worker.task is None:
                task = state.backlog.popleft() if state.backlog else take(worker.last)
                if task is None:
                    break
                worker.task, worker.last, worker.since = task, task, time.monotonic()
                self._send(worker, function, task)
        capacity = self._capacity()
        while len(self._workers) < capacity:
            starting = sum(not worker.ready for worker in self._workers)
            if len(state.backlog) <= starting:
                task = take(None)
                if task is None:
                    break
                state.backlog.append(task)
            self._workers.append(self._start())

    def _heard(self, news: News, state: _State) -> Iterator[Outcome[Any, Any]]:
        worker = news.worker
        if news.answer is None:
            self._workers.remove(worker)
            self._kill(worker)
            yield from self._died(worker, news.reason, state)
        elif not worker.ready:
            worker.ready, state.failed_starts = True, 0
        else:
            task, worker.task = worker.task, None
            state.deaths.pop(id(task), None)
            result, error = unpacked(news.answer)
            yield Outcome(task, result, error)

    def _died(self, worker: Worker, reason: str, state: _State) -> Iterator[Outcome[Any, Any]]:
        """Has the task run again, or gives it up."""
        task = worker.task
        if task is None:
            # one that dies idle only has to be replaced, but a start that fails may do so for ever
            state.failed_starts += not worker.ready
            if state.failed_starts >= ATTEMPTS:
                raise WorkersKilled(
                    f"{ATTEMPTS} worker processes died as they started ({reason}): out of memory? "
                    f"Run the same command again, with fewer workers."
                )
            return
        state.deaths[id(task)] += 1
        if state.deaths[id(task)] < ATTEMPTS:
            state.backlog.appendleft(task)
            return
        del state.deaths[id(task)]
        error = WorkersKilled(
            f"a worker process was killed {ATTEMPTS} times over this ({reason}): out of memory? "
            f"What was finished is kept: run the same command again, with fewer workers."
        )
        yield Outcome(task, None, error)

    def _overdue(self, state: _State) -> Iterator[Outcome[Any, Any]]:
        """Stops tasks that took too long."""
        if self._timeout_s:
            now = time.monotonic()
            for worker in [w for w in self._workers if w.task is not None]:
                limit = self._limit_s(worker.task)
                if now - worker.since > limit:
                    self._workers.remove(worker)
                    self._kill(worker)
                    # ids are given anew: a later task must not inherit the count
                    state.deaths.pop(id(worker.task), None)
                    yield Outcome(worker.task, None, timed_out(limit))

    def _limit_s(self, task: Any) -> float:
        """How long a task may take; 0 for no limit."""
        return self._timeout_s * self._size(task)

    def _open(self) -> None:
        """Called before the first worker starts."""

    def _close(self) -> None:
        """Called after the last worker has been killed."""

    @abstractmethod
    def _capacity(self) -> int:
        """How many workers there may be now."""

    @abstractmethod
    def _start(self) -> Worker:
        """Starts a worker; it is ready once it has said so."""

    @abstractmethod
    def _send(self, worker: Worker, function: Callable[[Any], Any], task: Any) -> None:
        """Has a free worker call the function; never raises when the worker has just died."""

    @abstractmethod
    def _wait(self, workers: Sequence[Worker], seconds: float) -> list[News]:
        """What happened; returns as soon as something has, one news per worker at most."""

    @abstractmethod
    def _kill(self, worker: Worker) -> None:
        """Ends a worker at once, if it still runs."""


def timed_out(seconds: float) -> TaskTimedOut:
    """The error of a task that took longer than ``seconds``."""
    return TaskTimedOut(f"took longer than {seconds:g} s")
