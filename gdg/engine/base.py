"""Engine: runs a function over tasks in workers that may die at any time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Generic, TypeVar

from gdg.errors import GdgError

Task = TypeVar("Task")
Result = TypeVar("Result")


class WorkersKilled(GdgError):
    """A task, or the start of workers, ended in killed processes again and again."""


class TaskTimedOut(GdgError):
    """A task took longer than the engine lets one take."""


@dataclass(frozen=True)
class Outcome(Generic[Task, Result]):
    """What became of one task.

    Attributes:
        task: the task.
        result: what the function returned, or None where there is an error.
        error: what the function raised, ``TaskTimedOut`` or ``WorkersKilled``; None on success.
    """

    task: Task
    result: Result | None = None
    error: BaseException | None = None


class Engine(ABC):
    """Runs tasks at once in several workers."""

    @abstractmethod
    def run(
        self, function: Callable[[Task], Result], take: Callable[[Task | None], Task | None]
    ) -> Generator[Outcome[Task, Result], None, None]:
        """Yields outcomes as tasks end, and ends when none runs and ``take`` gives no more.

        The engine never asks for more than it has workers for, so what runs next can depend on
        all outcomes so far: ``take`` is called whenever a worker is free, and again after every
        outcome.

        What a task raises is its outcome and leaves the others alone. A worker that is killed is
        replaced and its task run again, three times at most; so a function must not mind being
        run twice. Closing the iterator stops every worker.

        Args:
            function: importable by its name in a fresh process; called in one worker at a time.
            take: gives the next task, or None when there is none (yet). Its argument is the task
                that the free worker ran last, or None: a task that shares what that worker has
                loaded is run faster there.

        Raises:
            WorkersKilled: workers die before they take a task.
        """
