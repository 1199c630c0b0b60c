"""Training of the network, as a Lightning module."""

from __future__ import annotations

import math

import torch
from lightning.pytorch import LightningModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor

from gdg.training.batches import MapBatch
from gdg.training.randomness import derived_seed, step_generator

from .flow import draw_times, flow_loss, on_the_way, standardised
from .frames import in_own_frames
from .network import FlowNetwork
from .options import FlowOptions

#: Steps in which the learning rate rises, and the share of it that is left at the end.
WARM_UP_STEPS, FINAL_SHARE = 200, 0.02
BETAS = (0.9, 0.98)
WEIGHT_DECAY = 0.01
#: Times of a validation map: the same in every epoch and for every training.
VALIDATION_TIMES = (0.02, 0.05, 0.1, 0.2, 0.4)


class FlowModule(LightningModule):
    """The network with the loss of flow matching.

    Args:
        options: size of the network and draws per map.
        learning_rate: of AdamW after the warm-up; it falls to ``FINAL_SHARE`` of it by a cosine.
        seed: of the initial weights and of the steps' frames, times and noise.
    """

    def __init__(self, options: FlowOptions, learning_rate: float, seed: int):
        super().__init__()
        self.network = FlowNetwork(options.width, options.layers, options.heads)
        self.network.initialise(torch.Generator().manual_seed(seed))
        self._draws = options.draws
        self._learning_rate = learning_rate
        self._seed = seed

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW with a warm-up and, epoch by epoch, a cosine over the whole run."""
        optimizer = torch.optim.AdamW(
            self.parameters(), lr=self._learning_rate, betas=BETAS, weight_decay=WEIGHT_DECAY
        )
        # a lambda, because a bound method would be stored in the checkpoint
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimizer, lambda step: self._learning_rate_share(step)
        )
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def _learning_rate_share(self, step: int) -> float:
        # by the epoch, since a resumed run doesn't know how many steps its first epoch had
        return learning_rate_share(step, self.current_epoch, self.trainer.max_epochs or 1)

    def training_step(self, batch: MapBatch, batch_index: int) -> Tensor:
        """The flow's loss at random times, in random frames."""
        random = step_generator(self, self._seed, batch_index)
        time = draw_times(batch.points.new_empty(len(batch.points), self._draws), random)
        loss = self._losses(batch, time, random).mean()
        self._log(batch, train_loss=loss)
        return loss

    def validation_step(self, batch: MapBatch, batch_index: int) -> None:
        """Logs how well maps of objects never trained on are told from their noisy versions.

        ``val_t0.2`` is the mean squared error of the map that is predicted at time 0.2, in units
        of ``flow.SCALE``²: about 1 for a network that always gives the average map. ``val_recon``
        is the mean over ``VALIDATION_TIMES``. Noise and frames are the same in every epoch and
        for every seed, so that networks can be compared by it.
        """
        random = torch.Generator(device=self.device).manual_seed(derived_seed(batch_index))
        times = batch.points.new_tensor(VALIDATION_TIMES).expand(len(batch.points), -1)
        losses = self._losses(batch, times, random) * (1 - times).square()
        per_time = losses.mean(0)
        named = {f"val_t{time:g}": value for time, value in zip(VALIDATION_TIMES, per_time)}
        self._log(batch, val_recon=per_time.mean(), **named)

    def _losses(self, batch: MapBatch, time: Tensor, random: torch.Generator) -> Tensor:
        """The loss of every map (rows) at every time (columns)."""
        surface = self.network.surface(*in_own_frames(batch.points, batch.normals, random))
        clean = standardised(batch.values)[:, None].expand(-1, time.shape[1], -1)
        noise = torch.randn(clean.shape, generator=random, device=random.device).to(clean)
        predicted = self.network(surface, on_the_way(clean, noise, time), time)
        return flow_loss(clean, predicted, time)

    def _log(self, batch: MapBatch, **values: Tensor) -> None:
        size = len(batch.points)
        self.log_dict(dict(values), on_step=False, on_epoch=True, batch_size=size, sync_dist=True)


def learning_rate_share(step: int, epoch: int, epochs: int) -> float:
    """Which share of the learning rate is used in a step, in one epoch of so many."""
    cosine = 0.5 * (1 + math.cos(math.pi * min(1.0, epoch / epochs)))
    warm = min(1.0, (step + 1) / WARM_UP_STEPS)
    return warm * (FINAL_SHARE + (1 - FINAL_SHARE) * cosine)
