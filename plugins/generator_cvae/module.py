"""Training of the network, as a Lightning module."""

from __future__ import annotations

import numpy as np
import torch
from lightning.pytorch import LightningModule
from torch import Tensor

from gdg.training.maps import MapBatch

from .loss import RECONSTRUCTION_WEIGHT, kl_divergence, kl_weight, reconstruction_loss
from .network import LATENT, PointNetCvae

#: Standard deviation of the noise on training points, metres (release).
JITTER_M = 0.001


class CvaeModule(LightningModule):
    """The network with the release's loss, schedule and optimiser.

    Args:
        learning_rate: of Adam.
        seed: of the initial weights, and, with the epoch and the process's rank, of jitter and
            latent noise.
    """

    def __init__(self, learning_rate: float, seed: int):
        super().__init__()
        self.network = PointNetCvae()
        self.network.initialise(torch.Generator().manual_seed(seed))
        self._learning_rate = learning_rate
        self._seed = seed
        self._random = torch.Generator()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam on all weights."""
        return torch.optim.Adam(self.parameters(), lr=self._learning_rate)

    def on_train_epoch_start(self) -> None:
        """Starts the epoch's own random sequence, which a resumed run repeats."""
        parts = np.random.SeedSequence([self._seed, self.current_epoch, self.global_rank])
        seed = int(parts.generate_state(1, np.uint64)[0] >> 1)
        self._random = torch.Generator(device=self.device).manual_seed(seed)

    def training_step(self, batch: MapBatch, batch_index: int) -> Tensor:
        """The loss of a batch with jittered points."""
        points = batch.points + JITTER_M * self._normal(batch.points.shape)
        noise = self._normal((len(batch.points), LATENT))
        reconstructed, mean, log_variance = self.network(points, batch.values, noise)
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

    def _normal(self, shape: tuple[int, ...]) -> Tensor:
        return torch.randn(shape, generator=self._random, device=self.device)

    def _log(self, batch: MapBatch, **values: Tensor) -> None:
        size = len(batch.points)
        self.log_dict(dict(values), on_step=False, on_epoch=True, batch_size=size, sync_dist=True)
