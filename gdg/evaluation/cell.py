"""Cells of an evaluation and where their results lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.config import RunConfig
from gdg.data.grasps import GraspSet, load_grasps
from gdg.errors import GdgError
from gdg.pipeline.fingerprint import fingerprint, plan_fingerprint
from gdg.pipeline.jobs import EvalJob
from gdg.protocols import load_protocol
from gdg.scenes.place import check_protocol


@dataclass(frozen=True)
class Cell:
    """One point of the grid.

    Attributes:
        config: what is planned and tested.
        key: hash of all that shapes its result.
        plan_key: hash of all that shapes its grasps before they are tested; cells that differ in
            protocol, simulator and refinement alone share it.
        folder: the evaluation's folder.
    """

    config: RunConfig
    key: str
    plan_key: str
    folder: Path

    @classmethod
    def of(cls, config: RunConfig, folder: Path) -> Cell:
        """The cell of a config.

        Raises:
            GdgError: hand, object or protocol can't be found, or the protocol is not for the scene.
        """
        job: EvalJob = config.job
        check_protocol(load_protocol(job.protocol), job.scene == "tabletop")
        n = job.n
        return cls(config, fingerprint(config, n), plan_fingerprint(config, n), folder)

    @property
    def job(self) -> EvalJob:
        """The cell's job."""
        return self.config.job

    @property
    def path(self) -> Path:
        """The tested grasps."""
        return self.folder / "cells" / self.key / "grasps.json"

    @property
    def plan_path(self) -> Path:
        """The grasps before the test."""
        return self.folder / "plans" / self.plan_key / "grasps.json"

    @property
    def name(self) -> str:
        """Hand and object, for messages."""
        return f"{self.job.hand} · {self.job.object}"


@dataclass(frozen=True)
class Result:
    """What became of a cell.

    Attributes:
        cell: the cell.
        grasps: tested, or None where there is an error.
        error: the user's mistake, or killed or overdue workers, in a sentence; "" if none.
    """

    cell: Cell
    grasps: GraspSet | None = None
    error: str = ""


def open_cells(configs: Sequence[RunConfig], folder: Path) -> tuple[list[Cell], list[str]]:
    """The cells of configs, each once, and the mistakes of the configs that have none."""
    cells: dict[str, Cell] = {}
    mistakes = []
    for config in configs:
        try:
            cell = Cell.of(config, folder)
        except GdgError as error:
            mistakes.append(str(error))
        else:
            cells.setdefault(cell.key, cell)
    return list(cells.values()), mistakes


def stored(cell: Cell) -> GraspSet | None:
    """The cell's tested grasps, or None where it is not finished.

    Raises:
        GdgError: the file was altered and can't be read.
    """
    return load_grasps(cell.path) if cell.path.is_file() else None
