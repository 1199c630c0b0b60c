"""Progress on stderr: bars, one per stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from gdg.kinds.fitter import Progress as Report
from gdg.pipeline.grasp import Stages


class BarStages(Stages):
    """Shows each stage of a run as a bar."""

    def __init__(self, progress: Bar):
        self._progress = progress

    def stage(self, name: str) -> Report:
        """Adds a bar and gives the callback that moves it."""
        task = self._progress.add_task(name, total=None)

        def report(done: int, total: int) -> None:
            self._progress.update(task, completed=done, total=total)

        return report


@contextmanager
def bars() -> Iterator[Bar]:
    """A live display of progress bars; silent when stderr is no terminal."""
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=console, disable=not console.is_terminal) as progress:
        yield progress
