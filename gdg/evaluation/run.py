"""Runs the cells of a grid in parallel, never one twice, and keeps what was finished."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gdg.config import RunConfig
from gdg.data.atomic import write_text_atomically
from gdg.data.grasps import GraspSet, load_grasps
from gdg.engine import Engine, Outcome, TaskTimedOut, WorkersKilled, make_engine
from gdg.engine.threads import usable_cores
from gdg.errors import GdgError
from gdg.evaluation.agenda import Agenda
from gdg.evaluation.agreement import Agreement, agreements, write_agreements
from gdg.evaluation.cell import Cell, Result, open_cells, stored
from gdg.evaluation.figure import draw_rows
from gdg.evaluation.rows import Row, summarise
from gdg.evaluation.tables import write_summary
from gdg.evaluation.tasks import Task, forget_pairs, run_task
from gdg.pipeline.jobs import EvalJob
from gdg.yaml_files import dump_yaml

#: Called with (cells done, cells in all, what was just finished).
Report = Callable[[int, int, str], None]


class Evaluation:
    """What an evaluation gave.

    Attributes:
        rows: one per combination of settings, objects and seeds pooled.
        agreements: of simulators, where the grid has several.
        folder: where everything lies.
    """

    def __init__(self, rows: list[Row], agreements: list[Agreement], folder: Path):
        self.rows, self.agreements, self.folder = rows, agreements, folder


def run_eval(configs: Sequence[RunConfig], report: Report | None = None) -> Evaluation:
    """Runs every cell that has no result yet, sums up all, and writes tables and a figure.

    Args:
        configs: one per cell.
        report: see ``Report``.

    Raises:
        GdgError: the mistakes of all cells, once the others are done; or at once: workers can't
            start.
    """
    results, mistakes = run_cells(configs, report)
    mistakes += [result.error for result in results if result.error]
    if mistakes:
        raise GdgError("\n".join(dict.fromkeys(mistakes)))
    cells = [(r.cell.config, r.grasps) for r in results if r.grasps is not None]
    rows, folder = summarise(cells), Path(configs[0].job.out)
    write_summary(folder, rows)
    draw_rows(rows, folder / "summary.png")
    compared = agreements(results)
    if compared:
        write_agreements(folder, compared)
    return Evaluation(rows, compared, folder)


def run_cells(
    configs: Sequence[RunConfig], report: Report | None = None
) -> tuple[list[Result], list[str]]:
    """Runs every cell that has no result yet.

    Results lie in ``out/cells/KEY/grasps.json``, KEY being the hash of all that shapes them
    (``gdg.pipeline.fingerprint``); a cell that is complete is not run again. What cells have in
    common, the grasps before any test, is planned once and lies in ``out/plans/KEY``. Workers give
    results to this process, which alone writes, each file whole: a worker that is killed loses
    what it was at.

    Args:
        configs: one per cell; settings of engine, workers and folder are the first one's.
        report: see ``Report``.

    Returns:
        One result per cell, in the order of the configs, and the mistakes of configs that have no
        cell (a hand that is not found, say).

    Raises:
        GdgError: workers can't start.
        Exception: the first bug in a component, once the other cells are done.
    """
    job: EvalJob = configs[0].job
    cells, mistakes = open_cells(configs, Path(job.out))
    run = _Run(cells, report or (lambda *_: None))
    run.go(job)
    return run.results(), mistakes


class _Run:
    """The driver's side: gives out tasks, writes what comes back."""

    def __init__(self, cells: list[Cell], report: Report):
        self._cells = {cell.key: cell for cell in cells}
        found = {key: stored(cell) for key, cell in self._cells.items()}
        self._done = {key: grasps for key, grasps in found.items() if grasps is not None}
        self._agenda = Agenda([c for key, c in self._cells.items() if key not in self._done])
        self._errors: dict[str, str] = {}
        self._bug: BaseException | None = None
        self._report = report

    def results(self) -> list[Result]:
        """What became of each cell."""
        return [
            Result(cell, self._done.get(key), self._errors.get(key, ""))
            for key, cell in self._cells.items()
        ]

    def go(self, job: EvalJob) -> None:
        """Runs what is missing."""
        self._tell("")
        if not self._agenda.size:
            return
        outcomes = _engine(job, self._agenda.size).run(run_task, self._agenda.take)
        try:
            for outcome in outcomes:
                self._take_in(outcome)
        finally:
            outcomes.close()
            forget_pairs()
        if self._bug is not None:
            raise self._bug

    def _take_in(self, outcome: Outcome[Task, GraspSet]) -> None:
        """Writes what a worker made, or notes why there is nothing."""
        task, error = outcome.task, outcome.error
        planning = task.planned is None
        cells = self._agenda.planned(task) if planning else [self._cells[task.key]]
        if outcome.result is not None and planning:
            error = _kept_plan(cells[0], outcome.result)
        elif outcome.result is not None:
            self._keep(cells[0], outcome.result)
        if error is not None:
            self._agenda.drop(cells)
            for cell in cells:
                self._fail(cell, error)

    def _keep(self, cell: Cell, grasps: GraspSet) -> None:
        config = dump_yaml(cell.config.as_tree())
        write_text_atomically(cell.path.parent / "config.yaml", config)
        grasps.save(cell.path)
        # as a later run reads it, so that both sum up the same numbers
        self._done[cell.key] = load_grasps(cell.path)
        self._tell(cell.name)

    def _fail(self, cell: Cell, error: BaseException) -> None:
        if isinstance(error, (TaskTimedOut, WorkersKilled)):
            self._errors[cell.key] = f"{cell.name}: {error}"
        else:
            self._errors[cell.key] = str(error)
        if not isinstance(error, GdgError):
            self._bug = self._bug or error
        self._tell(cell.name)

    def _tell(self, what: str) -> None:
        self._report(len(self._done) + len(self._errors), len(self._cells), what)


def _kept_plan(cell: Cell, grasps: GraspSet) -> GdgError | None:
    """Writes a plan; gives the mistake in it, if there is one, and keeps no such plan."""
    grasps.save(cell.plan_path)
    try:
        load_grasps(cell.plan_path)
    except GdgError as error:
        cell.plan_path.unlink()
        return error
    return None


def _engine(job: EvalJob, tasks: int) -> Engine:
    workers = job.workers
    if job.engine == "local":
        workers = min(workers or usable_cores(), tasks)
    return make_engine(
        job.engine,
        workers,
        threads=job.threads,
        timeout_s=job.cell_timeout_s,
        address=job.ray_address,
        gpu=job.device.startswith("cuda"),
    )
