"""How long the stages of some work take. Light."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up the seconds of named stages.

    Attributes:
        seconds: stage -> seconds, in the order in which the stages began first.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts what is done within."""
        self.seconds.setdefault(name, 0.0)
        started = time.perf_counter()
        yield
        self.seconds[name] += time.perf_counter() - started
