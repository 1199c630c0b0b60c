"""The data module: loads, orders and augments the items of a run, from any step on."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from lightning.pytorch import LightningDataModule
from torch.utils.data import DataLoader

from gdg.errors import GdgError
from gdg.kinds.trainable import BatchKind
from gdg.training.augment import augmented
from gdg.training.batches import AnyBatch
from gdg.training.items import (
    Drawn,
    ItemDataset,
    ItemGroup,
    MapMaker,
    as_drawn,
    class_sizes,
    sorted_groups,
)
from gdg.training.job import TrainJob
from gdg.training.order import ItemOrder, Place, TrainingSteps, ValidationSteps

#: The release's batch, and the least number of steps per epoch for which it is kept.
BATCH, MIN_STEPS = 128, 16


class TrainingData(LightningDataModule):
    """The items of a run as Lightning takes them.

    Args:
        train: to learn from.
        validation: to choose the best epoch by; may be empty.
        job: the run's settings.
        kind: of the batches.
        maker: makes the maps of groups that have none.

    Attributes:
        batch: items per step and process.
        start: where training goes on; set it before a resumed run.

    Raises:
        GdgError: a single item, from which nothing can be learned.
    """

    def __init__(
        self,
        train: Sequence[ItemGroup],
        validation: Sequence[ItemGroup],
        job: TrainJob,
        kind: BatchKind,
        maker: MapMaker | None = None,
    ):
        super().__init__()
        groups = sorted_groups(train)
        self._train = ItemDataset(groups, kind, job.points, maker)
        self._validation = ItemDataset(sorted_groups(validation), kind, job.points, maker)
        if len(self._train) < 2:
            raise GdgError(f"data: {job.data} has one grasp to train on; nothing can be learned.")
        self._order = ItemOrder(class_sizes(groups, job.balance), job.seed)
        self._job = job
        self.batch = job.batch or max(2, min(BATCH, len(self._train) // MIN_STEPS))
        self.start = Place()

    @property
    def has_validation(self) -> bool:
        """Whether there are items to choose an epoch by."""
        return len(self._validation) > 0

    def train_dataloader(self) -> DataLoader:
        """Steps of this process; from ``start`` on in its epoch."""
        rank, processes = self._place_among_processes()
        steps = TrainingSteps(
            self._order, self.batch, self._job.seed, rank, processes, start=self.start
        )
        if not len(steps):
            raise GdgError(
                f"data: {len(self._train)} items are too few for {processes} processes; write "
                f"devices=1."
            )
        return self._loader(self._train, steps)

    def val_dataloader(self) -> DataLoader | list[DataLoader]:
        """All validation items, in order; none where there are none."""
        if not self.has_validation:
            return []
        steps = ValidationSteps(len(self._validation), self.batch, *self._place_among_processes())
        return self._loader(self._validation, steps)

    def on_after_batch_transfer(self, batch: Drawn, dataloader_idx: int) -> AnyBatch:
        """The items of a step, augmented on their device if they are for training."""
        if batch.seed is None:
            return batch.items
        random = torch.Generator(device=batch.items.points.device).manual_seed(batch.seed)
        return augmented(batch.items, self._job.augment, random)

    def _loader(self, data: ItemDataset, steps: TrainingSteps | ValidationSteps) -> DataLoader:
        workers = self._job.workers
        return DataLoader(
            data,
            batch_sampler=steps,  # type: ignore[arg-type]
            collate_fn=as_drawn,
            num_workers=workers,
            persistent_workers=workers > 0,
            # threads of the compiled distance do not survive a fork
            multiprocessing_context="spawn" if workers and self._job.maps == "computed" else None,
        )

    def _place_among_processes(self) -> tuple[int, int]:
        if self.trainer is None:
            return 0, 1
        return self.trainer.global_rank, self.trainer.world_size
