"""The training loss of the GenDexGrasp release (Li et al., ICRA 2023)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

#: L = RECONSTRUCTION_WEIGHT · reconstruction + kl_weight(epoch) · KL.
RECONSTRUCTION_WEIGHT = 1000.0
KL_WEIGHT, KL_GROWTH, KL_GROWTH_EPOCHS = 0.05, 1.5, 2
#: Exponent of the weight that lets contacts count more than the far side.
CONTACT_EXPONENT = 3.0


def reconstruction_loss(
    values: Float[Tensor, "batch object_point"], reconstructed: Float[Tensor, "batch object_point"]
) -> Float[Tensor, ""]:
    """sqrt(Σ w (c − ĉ)² / Σ w) over points, w = exp(3 c), averaged over the batch."""
    weight = torch.exp(CONTACT_EXPONENT * values)
    squared = (weight * (values - reconstructed).square()).sum(-1) / weight.sum(-1)
    return squared.sqrt().mean()


def kl_divergence(
    mean: Float[Tensor, "batch latent"], log_variance: Float[Tensor, "batch latent"]
) -> Float[Tensor, ""]:
    """KL of N(mean, exp(log_variance)) from N(0, I): summed over the latent, batch average."""
    summands = mean.square() + log_variance.exp() - 1 - log_variance
    return 0.5 * summands.sum(-1).mean()


def kl_weight(epoch: int) -> float:
    """λ = 0.05 in the epochs 0 and 1, times 1.5 every 2 epochs."""
    return KL_WEIGHT * KL_GROWTH ** (epoch // KL_GROWTH_EPOCHS)
