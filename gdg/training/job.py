"""What ``gdg train`` takes. Light: imports no torch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from gdg.config import JobConfig


def _as_tuple(value: object) -> object:
    return (value,) if isinstance(value, str) else value


def _ascending(span: tuple[float, float]) -> tuple[float, float]:
    if not 0 < span[0] <= span[1]:
        raise ValueError("must be [smallest, largest], both above 0, e.g. [0.9, 1.1]")
    return span


Names = Annotated[tuple[str, ...], BeforeValidator(_as_tuple)]


class AugmentOptions(BaseModel):
    """How training items are varied; validation items never are.

    Attributes:
        jitter_m: standard deviation of the noise on every coordinate of the object's points,
            metres (the release: 0.001).
        rotation: items are turned about the object frame's origin: not at all, about its z axis,
            or by any rotation; points, normals and root poses turn together.
        scale: [smallest, largest] factor on the object's points; of contact maps only, which keep
            their values.
        partial: share of the items of which only what a random direction sees is given.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False
    )

    jitter_m: Annotated[float, Field(ge=0, le=0.1)] = 0.001
    rotation: Literal["none", "yaw", "full"] = "none"
    scale: Annotated[tuple[float, float], AfterValidator(_ascending)] = (1.0, 1.0)
    partial: Annotated[float, Field(ge=0, le=1)] = 0.0


class TrainJob(JobConfig):
    """One training run.

    Attributes:
        data: folder of a grasp dataset, as ``gdg synth`` writes it.
        out: the run's folder.
        hand: the hand to train a planner for, name or folder; a generator learns from all hands.
        exclude_hand: hands to hold out; one name or a list.
        exclude_object: objects to hold out; one name or a list.
        split: name or file of a split lock, which says what may be learned from and which objects
            choose the best epoch (``val_fraction`` does not count then); none by default.
        epochs: passes over the training items (the release: 36).
        patience: stop after so many epochs in a row without a lower ``val_recon``; never by
            default.
        batch: items per step and process; by default 128 as in the release, fewer where that
            would give less than 16 steps per epoch.
        balance: in an epoch of as many items as there are, every item comes once (none), or each
            hand-object pair, or each hand, comes equally often.
        learning_rate: of the optimiser (the release: 1e-4).
        points: object points per item, a random choice of the 2048 in each step; fewer train
            faster, and validation always uses all.
        augment: how training items are varied.
        maps: contact maps are made once and kept in the cache in half precision, 4 kB per grasp
            (cached), or made anew for every batch (computed).
        ema_decay: export, and validate with, an exponential moving average of the weights with
            this decay per step, e.g. 0.999; none by default.
        val_fraction: share of the train objects that are held out to choose the best epoch.
        keep: which epoch's weights are exported.
        seed: of the initial weights, the order of the items, all noise and the choice of
            validation objects.
        resume: go on from the last checkpoint in ``out``, or begin where there is none yet.
        checkpoint_steps: steps between checkpoints; one is written after every epoch, too.
        checkpoint_minutes: minutes between checkpoints.
        gradient_clip: largest norm of a step's gradient; none by default, as in the release.
        workers: processes that read items; 0 reads in the training process.
        accelerator: Lightning's; ``auto`` takes a GPU if there is one, and says so.
        devices: Lightning's: how many, or ``auto``.
        strategy: Lightning's, e.g. ``ddp``.
        precision: Lightning's; ``bf16-mixed`` is about three times as fast on processors with
            bf16 instructions.
        progress: show progress bars.
    """

    data: Annotated[str, Field(min_length=1)]
    out: Annotated[str, Field(min_length=1)] = "runs/train"
    hand: str = ""
    exclude_hand: Names = ()
    exclude_object: Names = ()
    split: str = ""
    epochs: Annotated[int, Field(ge=1)] = 36
    patience: Annotated[int, Field(ge=1)] | None = None
    batch: Annotated[int, Field(ge=2)] | None = None
    balance: Literal["none", "pairs", "hands"] = "none"
    learning_rate: Annotated[float, Field(gt=0)] = 1e-4
    points: Annotated[int, Field(ge=16, le=2048)] = 2048
    augment: AugmentOptions = AugmentOptions()
    maps: Literal["cached", "computed"] = "cached"
    ema_decay: Annotated[float, Field(gt=0, lt=1)] | None = None
    val_fraction: Annotated[float, Field(ge=0, lt=1)] = 0.1
    keep: Literal["best", "last"] = "best"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    resume: bool = False
    checkpoint_steps: Annotated[int, Field(ge=1)] | None = None
    checkpoint_minutes: Annotated[float, Field(gt=0)] | None = 10.0
    gradient_clip: Annotated[float, Field(gt=0)] | None = None
    workers: Annotated[int, Field(ge=0)] = 0
    accelerator: str = "auto"
    devices: Annotated[int, Field(ge=1)] | Literal["auto"] = "auto"
    strategy: str = "auto"
    precision: str = "32-true"
    progress: bool = True
