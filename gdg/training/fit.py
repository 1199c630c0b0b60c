"""Fits a module to maps with Lightning: logs, checkpoints, resume."""

from __future__ import annotations

import importlib.util
import pickle
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger
from torch.utils.data import DataLoader

from gdg.errors import GdgError
from gdg.training.job import TrainJob
from gdg.training.maps import EpochShuffle, MapDataset, MapGroup, as_batch

#: The release's batch, and the least number of steps per epoch for which it is kept.
BATCH, MIN_STEPS = 128, 16
MONITORED = "val_recon"


@dataclass(frozen=True)
class Fitted:
    """The outcome of a fit.

    Attributes:
        module: with the weights of the kept epoch.
        epoch: of these weights, from 0.
        val_recon: their reconstruction error on the validation objects, or None without any.
        batch: maps per step that was used.
        seconds: wall time of this fit (after a resume, of the rest).
        device: where it ran.
    """

    module: LightningModule
    epoch: int
    val_recon: float | None
    batch: int
    seconds: float
    device: str


def fit(
    module: LightningModule,
    train: Sequence[MapGroup],
    validation: Sequence[MapGroup],
    job: TrainJob,
    out: Path,
) -> Fitted:
    """Trains a module and gives it back with the weights of the epoch to keep.

    Writes ``out/checkpoints/{last,best}.ckpt`` and ``out/logs/version_N/metrics.csv``.

    Args:
        module: what ``Generator.trainable`` gave.
        train: maps to learn from.
        validation: maps to choose the best epoch by; may be empty if ``job.keep`` is ``last``.
        job: the run's settings.
        out: the run's folder.

    Raises:
        GdgError: an unreadable checkpoint to resume from.
    """
    data = MapDataset(train, job.points, job.seed)
    batch = job.batch or max(2, min(BATCH, len(data) // MIN_STEPS))
    train_loader, validation_loader = _loader(data, batch, job, shuffled=True), None
    if validation:
        whole = MapDataset(validation, points=len(validation[0].points), seed=job.seed)
        validation_loader = _loader(whole, batch, job, shuffled=False)
    folder = out / "checkpoints"
    resumed = _last_checkpoint(folder) if job.resume else None
    checkpoints = _checkpoints(folder, bool(validation))
    trainer = _trainer(job, out, checkpoints)
    start = time.perf_counter()
    trainer.fit(module, train_loader, validation_loader, ckpt_path=resumed, weights_only=True)
    seconds = time.perf_counter() - start
    kept = read_checkpoint(folder / f"{job.keep}.ckpt")
    module.load_state_dict(kept["state_dict"])
    score = checkpoints[0].best_model_score if job.keep == "best" else None
    score = trainer.callback_metrics.get(MONITORED) if score is None else score
    return Fitted(
        module.eval(),
        epoch=int(kept["epoch"]),
        val_recon=None if score is None else float(score),
        batch=batch,
        seconds=seconds,
        device=str(trainer.strategy.root_device),
    )


def read_checkpoint(path: Path) -> dict[str, Any]:
    """A Lightning checkpoint as plain tensors and values; nothing in it is executed.

    Raises:
        GdgError: it can't be read, or holds anything else.
    """
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise GdgError(f"{path}: refused, because it holds more than plain values.") from error
    except (OSError, RuntimeError, EOFError, ValueError, KeyError) as error:
        raise GdgError(f"{path}: is no readable checkpoint: {error}") from error


def _last_checkpoint(folder: Path) -> Path | None:
    """The checkpoint to go on from; None where the run was stopped before its first one."""
    last = folder / "last.ckpt"
    if not last.is_file():
        return None
    read_checkpoint(last)
    return last


def _loader(data: MapDataset, batch: int, job: TrainJob, shuffled: bool) -> DataLoader:
    return DataLoader(
        data,
        batch_size=batch,
        sampler=EpochShuffle(data, job.seed) if shuffled else None,
        # a last batch of one map has no spread for batch norm to learn from
        drop_last=shuffled and len(data) % batch == 1,
        collate_fn=as_batch,
        num_workers=job.workers,
        persistent_workers=job.workers > 0,
    )


def _checkpoints(folder: Path, with_validation: bool) -> list[ModelCheckpoint]:
    common: dict[str, Any] = {"dirpath": folder, "enable_version_counter": False}
    last = ModelCheckpoint(filename="last", save_on_train_epoch_end=not with_validation, **common)
    if not with_validation:
        return [last]
    return [ModelCheckpoint(filename="best", monitor=MONITORED, mode="min", **common), last]


def _trainer(job: TrainJob, out: Path, checkpoints: list[ModelCheckpoint]) -> Trainer:
    loggers: list[Logger] = [CSVLogger(out, name="logs")]
    if importlib.util.find_spec("tensorboard") is not None:
        loggers.append(TensorBoardLogger(out, name="tensorboard"))
    return Trainer(
        max_epochs=job.epochs,
        accelerator=job.accelerator,
        devices=job.devices,
        strategy=job.strategy,
        precision=job.precision,  # type: ignore[arg-type]
        gradient_clip_val=job.gradient_clip,
        callbacks=list(checkpoints),
        logger=loggers,
        enable_progress_bar=job.progress,
        enable_model_summary=job.progress,
        log_every_n_steps=10,
        num_sanity_val_steps=0,
        default_root_dir=out,
    )
