"""A function over a fixed list of items, in processes that share the machine's cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from gdg.engine.local import LocalEngine
from gdg.engine.threads import usable_cores

Item = TypeVar("Item")
Result = TypeVar("Result")


def run_all(
    function: Callable[[Item], Result], items: Sequence[Item], workers: int
) -> Iterator[tuple[Item, Result]]:
    """Yields (item, result) as each ends, from ``workers`` processes (1: from this one).

    What the function raises is raised here. On that, on Ctrl-C and on any other exception, what
    waits is dropped and the workers are stopped.

    Raises:
        GdgError: an item's worker was killed three times, by the system for want of memory, say.
    """
    # by number: items may be equal, or None
    waiting = list(reversed(list(enumerate(items))))
    workers = max(1, min(workers, len(items)))
    engine = LocalEngine(workers, threads=max(1, usable_cores() // workers))
    outcomes = engine.run(_OfItem(function), lambda _: waiting.pop() if waiting else None)
    try:
        for outcome in outcomes:
            if outcome.error is not None:
                raise outcome.error
            yield outcome.task[1], outcome.result  # type: ignore[misc]
    finally:
        outcomes.close()


@dataclass(frozen=True)
class _OfItem(Generic[Item, Result]):
    """The function, for numbered items."""

    function: Callable[[Item], Result]

    def __call__(self, task: tuple[int, Item]) -> Result:
        return self.function(task[1])
