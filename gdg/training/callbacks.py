"""What Lightning calls while it trains: checkpoints, random streams, the learning curve."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint

from gdg.training.curves import draw_curves, write_table
from gdg.training.order import Place
from gdg.training.randomness import derived_seed

#: Tell the seeds of the global random stream from those that modules and data use.
IN_TRAINING, IN_VALIDATION = 2, 3


class LastCheckpoint(Checkpoint):
    """Keeps ``last.ckpt``, from which a run goes on: after every epoch, and now and then within.

    Args:
        path: the file; it is replaced atomically.
        steps: write after so many steps; None for never.
        minutes: write after so many minutes; None for never.
    """

    def __init__(self, path: Path, steps: int | None, minutes: float | None):
        self._path, self._steps, self._minutes = path, steps, minutes
        self._written = time.monotonic()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Writes if it is time; not after an epoch's last step, which validation follows."""
        if batch_idx + 1 < trainer.num_training_batches and self._is_due(trainer, batch_idx + 1):
            self._write(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Writes; validation and all that it decides are done."""
        self._write(trainer)

    def _is_due(self, trainer: Trainer, steps_done: int) -> bool:
        if self._steps is not None and steps_done % self._steps == 0:
            return True
        if self._minutes is None:
            return False
        # the processes' clocks differ, and all of them have to take part in writing
        late = time.monotonic() - self._written >= 60 * self._minutes
        return bool(trainer.strategy.broadcast(late)) if trainer.world_size > 1 else late

    def _write(self, trainer: Trainer) -> None:
        trainer.save_checkpoint(self._path, weights_only=False)  # the optimiser, too
        self._written = time.monotonic()


def place_of(checkpoint: Mapping[str, Any]) -> Place:
    """Where in the run a checkpoint of ``LastCheckpoint`` was written."""
    loops = checkpoint["loops"]["fit_loop"]
    epochs = loops["epoch_progress"]["current"]["processed"]
    if loops["epoch_progress"]["current"]["ready"] == epochs:
        return Place(epochs)
    return Place(epochs, loops["epoch_loop.batch_progress"]["current"]["processed"])


class StepRandomness(Callback):
    """Seeds torch's global random stream before every step by its place in the run.

    Layers such as dropout draw from that stream; so a resumed run equals an uninterrupted one, and
    every validation sees the same noise. The processor's stream is given back as it was found.

    Args:
        seed: of the run.
    """

    def __init__(self, seed: int):
        self._seed = seed
        self._before: torch.Tensor | None = None

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Keeps the stream."""
        self._before = torch.random.get_rng_state()

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Seeds it by epoch, step and process."""
        place = (trainer.current_epoch, batch_idx, trainer.global_rank, IN_TRAINING)
        torch.manual_seed(derived_seed(self._seed, *place))

    def on_validation_batch_start(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Seeds it by step and process, the same in every epoch."""
        place = (batch_idx, trainer.global_rank, IN_VALIDATION)
        torch.manual_seed(derived_seed(self._seed, *place))

    def teardown(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Gives the stream back."""
        if self._before is not None:
            torch.random.set_rng_state(self._before)
            self._before = None


class History(Callback):
    """Every epoch's figures: kept in checkpoints, written as a table and as a picture.

    Args:
        folder: gets ``curves.csv`` and ``curves.png``.

    Attributes:
        rows: name -> figure of each epoch so far; a figure that an epoch lacks is absent.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self.rows: list[dict[str, float]] = []

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Adds the epoch's figures and draws."""
        figures = {name: float(value) for name, value in trainer.callback_metrics.items()}
        finite = {name: value for name, value in figures.items() if math.isfinite(value)}
        place = {"epoch": trainer.current_epoch + 1.0, "steps": float(trainer.global_step)}
        self.rows.append({**place, **finite})
        if trainer.is_global_zero:
            write_table(self.rows, self._folder / "curves.csv")
            draw_curves(self.rows, self._folder / "curves.png")

    def state_dict(self) -> dict[str, Any]:
        """All rows."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Takes up the rows of the epochs before."""
        self.rows = [dict(row) for row in state_dict["rows"]]
