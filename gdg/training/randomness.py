"""Random numbers of a training step that depend on nothing but where in the run it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule


def derived_seed(*parts: int) -> int:
    """A seed of 63 bits that follows from several whole numbers, none of them negative."""
    return int(np.random.SeedSequence(parts).generate_state(1, np.uint64)[0] >> 1)


def step_generator(module: LightningModule, seed: int, batch_index: int) -> torch.Generator:
    """The random numbers of one training step, on the module's device.

    They follow from the seed, the epoch, the number of the batch and the process's rank, so that
    a run that is resumed in the middle of an epoch draws what an uninterrupted one would have.
    """
    parts = (seed, module.current_epoch, batch_index, module.global_rank)
    return torch.Generator(device=module.device).manual_seed(derived_seed(*parts))
