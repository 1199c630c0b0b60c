"""What a pool remembers of its tasks, with workers that are no processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from gdg.engine import Outcome, TaskTimedOut
from gdg.engine.answer import answer
from gdg.engine.pool import News, Worker, WorkerPool

DIES, HANGS, ENDS = "dies", "hangs", "ends"


class Scripted(WorkerPool):
    """One worker at a time, which does with each task it gets what the script says."""

    def __init__(self, script: Sequence[str]):
        super().__init__(timeout_s=0.001)
        self._script: Iterator[str] = iter(script)
        self._act = ""

    def _capacity(self) -> int:
        return 1

    def _start(self) -> Worker:
        return Worker()

    def _send(self, worker: Worker, function: Callable[[Any], Any], task: Any) -> None:
        self._act = next(self._script)
        # time passes only for the one that hangs
        worker.since += -1e9 if self._act == HANGS else 1e9

    def _wait(self, workers: Sequence[Worker], seconds: float) -> list[News]:
        (worker,) = workers
        if not worker.ready:
            return [News(worker, b"")]
        if self._act == DIES:
            return [News(worker, None, "killed")]
        return [News(worker, answer(id, None))] if self._act == ENDS else []

    def _kill(self, worker: Worker) -> None:
        pass


def test_a_task_that_was_stopped_starts_with_a_clean_record():
    task = object()
    waiting = [task, task]
    pool = Scripted([DIES, DIES, HANGS, DIES, DIES, ENDS])
    outcomes: list[Outcome] = list(pool.run(id, lambda _: waiting.pop() if waiting else None))
    assert [type(outcome.error) for outcome in outcomes] == [TaskTimedOut, type(None)]
