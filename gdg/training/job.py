"""What ``gdg train`` takes. Light: imports no torch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from gdg.config import JobConfig


def _as_tuple(value: object) -> object:
    return (value,) if isinstance(value, str) else value


class TrainJob(JobConfig):
    """One training run.

    Attributes:
        data: folder of a grasp dataset, as ``gdg synth`` writes it.
        out: the run's folder.
        exclude_hand: hands to hold out; one name or a list.
        split: name or file of a split lock, which says what may be learned from and which objects
            choose the best epoch (``val_fraction`` does not count then); none by default.
        epochs: passes over the training maps (the release: 36).
        batch: maps per step; by default 128 as in the release, fewer where that would give less
            than 16 steps per epoch.
        learning_rate: of the optimiser (the release: 1e-4).
        points: object points per item, a random choice of the 2048 in each step; fewer train
            faster, and validation always uses all.
        val_fraction: share of the train objects that are held out to choose the best epoch.
        keep: which epoch's weights are exported.
        seed: of the initial weights, the order of the maps, the jitter and the choice of
            validation objects.
        resume: go on from the last checkpoint in ``out``, or begin where there is none yet.
        gradient_clip: largest norm of a step's gradient; none by default, as in the release.
        workers: processes that read maps; 0 reads in the training process.
        accelerator: Lightning's; ``auto`` takes a GPU if there is one, and says so.
        devices: Lightning's: how many, or ``auto``.
        strategy: Lightning's, e.g. ``ddp``.
        precision: Lightning's; ``bf16-mixed`` is about three times as fast on processors with
            bf16 instructions.
        progress: show a progress bar.
    """

    data: Annotated[str, Field(min_length=1)]
    out: Annotated[str, Field(min_length=1)] = "runs/train"
    exclude_hand: Annotated[tuple[str, ...], BeforeValidator(_as_tuple)] = ()
    split: str = ""
    epochs: Annotated[int, Field(ge=1)] = 36
    batch: Annotated[int, Field(ge=2)] | None = None
    learning_rate: Annotated[float, Field(gt=0)] = 1e-4
    points: Annotated[int, Field(ge=16, le=2048)] = 2048
    val_fraction: Annotated[float, Field(ge=0, lt=1)] = 0.1
    keep: Literal["best", "last"] = "best"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    resume: bool = False
    gradient_clip: Annotated[float, Field(gt=0)] | None = None
    workers: Annotated[int, Field(ge=0)] = 0
    accelerator: str = "auto"
    devices: Annotated[int, Field(ge=1)] | Literal["auto"] = "auto"
    strategy: str = "auto"
    precision: str = "32-true"
    progress: bool = True
