"""What is planned or tested next, so that nothing is planned twice and workers stay warm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gdg.data.grasps import load_grasps
from gdg.evaluation.cell import Cell
from gdg.evaluation.tasks import Task
from gdg.pipeline.jobs import EvalJob

#: Hand, object and scale: what a worker has loaded.
_Pair = tuple[str, str, float]


class Agenda:
    """Hands out the tasks of unfinished cells: each plan once, then the tests of its cells.

    Tests go before plans, and a worker gets what concerns the hand and object that it has
    loaded while there is such a task.

    Args:
        cells: without a result, each once.
    """

    def __init__(self, cells: Sequence[Cell]):
        self._plans: dict[str, list[Cell]] = {}
        self._tests: dict[str, Cell] = {}
        self._waiting: dict[str, list[Cell]] = {}
        for cell in cells:
            if cell.plan_path.is_file():
                self._tests[cell.key] = cell
            else:
                self._plans.setdefault(cell.plan_key, []).append(cell)

    @property
    def size(self) -> int:
        """Tasks that are not handed out yet, those included that wait for a plan."""
        waiting = sum(map(len, (*self._plans.values(), *self._waiting.values())))
        return len(self._tests) + len(self._plans) + waiting

    def take(self, last: Task | None) -> Task | None:
        """The next task for a worker that ran ``last``, or None when there is none (yet)."""
        near = None if last is None else _pair(last.config.job)
        key = _nearest({key: cell.job for key, cell in self._tests.items()}, near)
        if key is not None:
            cell = self._tests.pop(key)
            return Task(cell.key, cell.plan_key, cell.config, load_grasps(cell.plan_path))
        key = _nearest({key: cells[0].job for key, cells in self._plans.items()}, near)
        if key is None:
            return None
        cells = self._waiting[key] = self._plans.pop(key)
        return Task(key, key, cells[0].config)

    def planned(self, task: Task) -> list[Cell]:
        """The cells of a plan that has ended, whose tests may start now."""
        cells = self._waiting.pop(task.key)
        self._tests.update((cell.key, cell) for cell in cells)
        return cells

    def drop(self, cells: Sequence[Cell]) -> None:
        """Takes back the tests of cells whose plan failed."""
        for cell in cells:
            self._tests.pop(cell.key, None)


def _pair(job: EvalJob) -> _Pair:
    return job.hand, job.object, job.object_scale


def _nearest(jobs: Mapping[str, EvalJob], near: _Pair | None) -> str | None:
    """Key of the first task that is of this pair, else of the first."""
    first = next(iter(jobs), None)
    return next((key for key, job in jobs.items() if _pair(job) == near), first)
