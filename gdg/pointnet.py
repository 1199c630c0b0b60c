"""Parts of networks on point clouds (PointNet, Qi et al. 2017)."""

from __future__ import annotations

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn


class SharedMlp(nn.Module):
    """Layers applied to every point alike: linear, batch norm over batch and points, ReLU.

    The last layer has no ReLU. In evaluation mode items of a batch don't mix.

    Args:
        widths: channels before, between and after the layers.
    """

    def __init__(self, *widths: int):
        super().__init__()
        self.linears = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.norms = nn.ModuleList(nn.BatchNorm1d(width) for width in widths[1:])

    def forward(
        self, features: Float[Tensor, "batch point feature"]
    ) -> Float[Tensor, "batch point output"]:
        """Features of every point."""
        shape, flat = features.shape, features.flatten(0, 1)
        for number, (linear, norm) in enumerate(zip(self.linears, self.norms, strict=True)):
            flat = norm(linear(flat if number == 0 else torch.relu(flat)))
        return flat.reshape(*shape[:2], flat.shape[-1])


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers with a ReLU between each two; none after the last."""
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


@torch.no_grad()
def initialise(network: nn.Module, generator: torch.Generator) -> None:
    """Kaiming-normal weights of all linear layers and zero biases, drawn from a generator."""
    for module in network.modules():
        if isinstance(module, nn.Linear):
            nn.init.kaiming_normal_(module.weight, nonlinearity="relu", generator=generator)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
