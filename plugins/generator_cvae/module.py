"""Training of the network, as a Lightning module."""

from __future__ import annotations

import torch
from lightning.pytorch import LightningModule
from torch import Tensor

from gdg.training.batches import MapBatch
from gdg.training.randomness import step_generator

from .loss import RECONSTRUCTION_WEIGHT, kl_divergence, kl_weight, reconstruction_loss
from .network import LATENT, PointNetCvae


class CvaeModule(LightningModule):
    """The network with the release's loss, schedule and optimiser.

    Args:
        learning_rate: of Adam.
        seed: of the initial weights, and, with the step's place in the run, of latent noise.
    """

    def __init__(self, learning_rate: float, seed: int):
        super().__init__()
        self.network = PointNetCvae()
        self.network.initialise(torch.Generator().manual_seed(seed))
        self._learning_rate = learning_rate
        self._seed = seed

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam on all weights."""
        return torch.optim.Adam(self.parameters(), lr=self._learning_rate)

    def training_step(self, batch: MapBatch, batch_index: int) -> Tensor:
        """The loss of a batch."""
        random = step_generator(self, self._seed, batch_index)
        noise = torch.randn(len(batch.points), LATENT, generator=random, device=self.device)
        reconstructed, mean, log_variance = self.network(batch.points, batch.values, noise)
        reconstruction = reconstruction_loss(batch.values, reconstructed)
        divergence = kl_divergence(mean, log_variance)
        weight = kl_weight(self.current_epoch)
        loss = RECONSTRUCTION_WEIGHT * reconstruction + weight * divergence
        self._log(batch, train_loss=loss, train_recon=reconstruction, train_kl=divergence)
        self._log(batch, kl_weight=torch.tensor(weight))
        return loss

    def validation_step(self, batch: MapBatch, batch_index: int) -> None:
        """Logs how well the latent's mean reconstructs maps of objects never trained on."""
        noise = batch.points.new_zeros(len(batch.points), LATENT)
        reconstructed, mean, log_variance = self.network(batch.points, batch.values, noise)
        self._log(
            batch,
            val_recon=reconstruction_loss(batch.values, reconstructed),
            val_kl=kl_divergence(mean, log_variance),
        )

    def _log(self, batch: MapBatch, **values: Tensor) -> None:
        size = len(batch.points)
        self.log_dict(dict(values), on_step=False, on_epoch=True, batch_size=size, sync_dist=True)
