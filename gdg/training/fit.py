"""Fits a module to items with Lightning: logs, checkpoints, resume, early stopping."""

from __future__ import annotations

import importlib.util
import pickle
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import EarlyStopping, EMAWeightAveraging, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger

from gdg.errors import GdgError
from gdg.training.callbacks import History, LastCheckpoint, StepRandomness, place_of
from gdg.training.data import TrainingData
from gdg.training.job import TrainJob

MONITORED = "val_recon"
#: Lightning's, about what is taken care of here: the steps go on where they were, few steps per
#: epoch are logged per epoch, there may be no validation, checkpoints are replaced; or not ours.
NEEDLESS_WARNINGS = (
    ".*resuming from a checkpoint that ended before the epoch ended",
    ".*smaller than the logging interval",
    "Total length of .* across ranks is zero",
    "Checkpoint directory .* exists and is not empty",
    ".*does not have many workers",
    ".*treespec, LeafSpec.* is deprecated",
)


@dataclass(frozen=True)
class Fitted:
    """The outcome of a fit.

    Attributes:
        module: with the weights of the kept epoch.
        epoch: of these weights, from 0.
        epochs: that were trained.
        figures: of the kept epoch, by name.
        val_recon: its reconstruction error on the validation objects, or None without any.
        batch: items per step and process.
        seconds: wall time of this fit (after a resume, of the rest).
        device: where it ran.
        is_first: whether this process is the one that writes the outcome.
    """

    module: LightningModule
    epoch: int
    epochs: int
    figures: dict[str, float]
    val_recon: float | None
    batch: int
    seconds: float
    device: str
    is_first: bool


def fit(module: LightningModule, data: TrainingData, job: TrainJob, out: Path) -> Fitted:
    """Trains a module and gives it back with the weights of the epoch to keep.

    Writes ``out/checkpoints/{last,best}.ckpt``, ``out/curves.{csv,png}`` and
    ``out/logs/version_N/metrics.csv``.

    Args:
        module: what ``Trainable.trainable`` gave.
        data: what to learn from; without validation items ``job.keep`` must be ``last``.
        job: the run's settings.
        out: the run's folder.

    Raises:
        GdgError: an unreadable checkpoint to resume from, no validation items to stop early by,
            or a training that diverged.
    """
    if job.patience and not data.has_validation:
        raise GdgError("patience: stopping early needs validation objects; leave it out.")
    folder, start = out / "checkpoints", time.perf_counter()
    history = History(out)
    trainer = _trainer(job, out, [*_callbacks(folder, data, job), history])
    resumed = _last_checkpoint(folder) if job.resume else None
    if resumed is not None:
        data.start = place_of(read_checkpoint(resumed))
    if resumed is not None and _has_stopped(read_checkpoint(resumed), job):
        history.load_state_dict(read_checkpoint(resumed)["callbacks"]["History"])
    else:
        with warnings.catch_warnings():
            for message in NEEDLESS_WARNINGS:
                warnings.filterwarnings("ignore", message)
            trainer.fit(module, datamodule=data, ckpt_path=resumed, weights_only=True)
    seconds = time.perf_counter() - start
    return _kept(module, data, job, folder, trainer, history, seconds)


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


def _kept(
    module: LightningModule,
    data: TrainingData,
    job: TrainJob,
    folder: Path,
    trainer: Trainer,
    history: History,
    seconds: float,
) -> Fitted:
    """The outcome, with the weights of the epoch to keep."""
    path = folder / f"{job.keep}.ckpt"
    if not path.is_file():
        raise GdgError(
            f"no epoch gave a finite {MONITORED}: the training diverged; lower learning_rate or "
            f"set gradient_clip."
        )
    kept = read_checkpoint(path)
    module.load_state_dict(kept["state_dict"])
    if not all(tensor.isfinite().all() for tensor in module.state_dict().values()):
        raise GdgError(
            "the training diverged: weights are not finite; lower learning_rate or set "
            "gradient_clip."
        )
    epoch = int(kept["epoch"])
    figures = next((dict(row) for row in history.rows if row["epoch"] == epoch + 1), {})
    return Fitted(
        module.eval(),
        epoch=epoch,
        epochs=len(history.rows),
        figures=figures,
        val_recon=figures.get(MONITORED),
        batch=data.batch,
        seconds=seconds,
        device=str(trainer.strategy.root_device),
        is_first=trainer.is_global_zero,
    )


def _last_checkpoint(folder: Path) -> Path | None:
    """The checkpoint to go on from; None where the run was stopped before its first one."""
    last = folder / "last.ckpt"
    return last if last.is_file() else None


def _has_stopped(checkpoint: dict[str, Any], job: TrainJob) -> bool:
    """Whether a run has already stopped early."""
    if job.patience is None:
        return False
    states = checkpoint["callbacks"]
    waited = [state["wait_count"] for name, state in states.items() if "EarlyStopping" in name]
    return bool(waited) and waited[0] >= job.patience


def _callbacks(folder: Path, data: TrainingData, job: TrainJob) -> list[Callback]:
    found: list[Callback] = [
        StepRandomness(job.seed),
        LastCheckpoint(folder / "last.ckpt", job.checkpoint_steps, job.checkpoint_minutes),
    ]
    if job.ema_decay is not None:
        found.append(EMAWeightAveraging(decay=job.ema_decay))
    if data.has_validation:
        found.append(
            ModelCheckpoint(
                dirpath=folder,
                filename="best",
                monitor=MONITORED,
                mode="min",
                save_on_train_epoch_end=False,
                enable_version_counter=False,
            )
        )
    if job.patience is not None:
        found.append(
            EarlyStopping(
                MONITORED,
                min_delta=0.0,
                patience=job.patience,
                check_on_train_epoch_end=False,
            )
        )
    return found


def _trainer(job: TrainJob, out: Path, callbacks: list[Callback]) -> Trainer:
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
        callbacks=callbacks,
        logger=loggers,
        enable_progress_bar=job.progress,
        enable_model_summary=job.progress,
        log_every_n_steps=10,
        num_sanity_val_steps=0,
        use_distributed_sampler=False,  # our own steps know of the processes
        default_root_dir=out,
    )
