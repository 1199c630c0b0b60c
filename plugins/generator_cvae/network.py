"""The network: PointNet encoder and decoder of a conditional variational auto-encoder.

Architecture of the GenDexGrasp release (Li et al., ICRA 2023). Three choices that its description
leaves open were settled by comparing what each alternative sends into the released networks'
batch-norm layers with the running statistics stored there: the concatenation is (pointwise,
global, latent), and neither the second pointwise layer nor a layer before a max pool is followed
by a ReLU.

Differences in form, not in value: a 1×1 convolution is a linear layer on the last axis, and the
part of the first decoding layer that is the same for all points of an object is computed once.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor, nn

LATENT = 128
POINT_FEATURES, GLOBAL_FEATURES = 64, 512

Points: TypeAlias = Float[Tensor, "batch object_point 3"]
Values: TypeAlias = Float[Tensor, "batch object_point"]
Latent: TypeAlias = Float[Tensor, "batch latent"]


class SharedLayer(nn.Module):
    """A linear layer applied to every point, then batch norm over batch and points.

    Args:
        inputs: channels of a point.
        outputs: channels of its result.
    """

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.linear = nn.Linear(inputs, outputs)
        self.norm = nn.BatchNorm1d(outputs)

    def forward(
        self,
        features: Float[Tensor, "batch object_point feature"],
        shared: Float[Tensor, "batch shared_feature"] | None = None,
    ) -> Float[Tensor, "batch object_point output"]:
        """The layer on ``features``, to each of which ``shared`` is appended if given."""
        weight, bias = (self.linear.weight, self.linear.bias) if self.training else self._folded()
        if shared is None:
            mixed = nn.functional.linear(features, weight, bias)
        else:
            own, common = weight.split((features.shape[-1], shared.shape[-1]), dim=1)
            offset = nn.functional.linear(shared, common, bias)
            # the batched product adds the offset in passing
            mixed = torch.baddbmm(offset[:, None], features, own.T.expand(len(features), -1, -1))
        return self.norm(mixed.flatten(0, 1)).view_as(mixed) if self.training else mixed

    def _folded(self) -> tuple[Tensor, Tensor]:
        """Weight and bias of the linear layer that equals this one in evaluation mode."""
        norm = self.norm
        assert norm.running_mean is not None
        assert norm.running_var is not None
        scale = norm.weight * (norm.running_var + norm.eps).rsqrt()
        shift = norm.bias + scale * (self.linear.bias - norm.running_mean)
        return scale[:, None] * self.linear.weight, shift


def shared_layers(*widths: int) -> nn.ModuleList:
    """A shared layer for each pair of neighbouring widths."""
    return nn.ModuleList(SharedLayer(a, b) for a, b in pairwise(widths))


class Encoder(nn.Module):
    """Object points with contact values → mean and log-variance of the latent."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = shared_layers(4, 64, 128, GLOBAL_FEATURES)
        self.mean = nn.Linear(GLOBAL_FEATURES, LATENT)
        self.log_variance = nn.Linear(GLOBAL_FEATURES, LATENT)

    def forward(self, points: Points, values: Values) -> tuple[Latent, Latent]:
        """Mean and log-variance; ``points`` in metres in the object frame."""
        pooled = _pooled(self.layers, torch.cat((points, values[..., None]), dim=-1))
        return self.mean(pooled).float(), self.log_variance(pooled).float()


class Decoder(nn.Module):
    """Object points and a latent → contact values."""

    def __init__(self) -> None:
        super().__init__()
        self.pointwise = shared_layers(3, 64, POINT_FEATURES)
        self.overall = shared_layers(POINT_FEATURES, 128, GLOBAL_FEATURES)
        self.layers = shared_layers(POINT_FEATURES + GLOBAL_FEATURES + LATENT, 512, 64, 64, 1)

    def forward(self, points: Float[Tensor, "object object_point 3"], latent: Latent) -> Values:
        """Contact values in (0, 1); ``points`` in metres in the object frame.

        ``points`` may be one object for many latents: then its batch size is 1.
        """
        own, overall = self.features(points)
        return self.decode(own, overall, latent)

    def features(
        self, points: Points
    ) -> tuple[Float[Tensor, "batch object_point 64"], Float[Tensor, "batch 512"]]:
        """Features of every point and of the whole object, the same for every latent."""
        first, second = self.pointwise
        own = second(torch.relu(first(points)))
        return own, _pooled(self.overall, own)

    def decode(
        self,
        own: Float[Tensor, "object object_point 64"],
        overall: Float[Tensor, "object 512"],
        latent: Latent,
    ) -> Values:
        """Contact values of each latent; one object's features serve all latents."""
        size = len(latent)
        shared = torch.cat((overall.expand(size, -1), latent), dim=-1)
        features = self.layers[0](own.expand(size, -1, -1), shared)
        for layer in self.layers[1:]:
            features = layer(torch.relu(features))
        # in mixed precision the values would otherwise come in steps of 1/256
        return torch.sigmoid(features[..., 0].float())


class PointNetCvae(nn.Module):
    """The conditional variational auto-encoder; in evaluation mode items don't mix."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.decoder = Decoder()

    def forward(
        self, points: Points, values: Values, noise: Latent
    ) -> tuple[Values, Latent, Latent]:
        """Reconstructed values, latent mean and log-variance.

        Args:
            points: metres, object frame.
            values: contact values to encode.
            noise: standard-normal numbers; zeros decode the latent's mean.
        """
        mean, log_variance = self.encoder(points, values)
        latent = mean + noise * (0.5 * log_variance).exp()
        return self.decoder(points, latent), mean, log_variance

    @torch.no_grad()
    def initialise(self, generator: torch.Generator) -> None:
        """Xavier-normal weights, biases uniform in ±1/√inputs, batch norms as the identity."""
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.xavier_normal_(module.weight, generator=generator)
                bound = module.in_features**-0.5
                nn.init.uniform_(module.bias, -bound, bound, generator=generator)
            elif isinstance(module, nn.BatchNorm1d):
                module.reset_parameters()


def _pooled(
    layers: nn.ModuleList, features: Float[Tensor, "batch object_point feature"]
) -> Float[Tensor, "batch output"]:
    """Shared layers with ReLU between them, then the maximum over points."""
    for index, layer in enumerate(layers):
        features = layer(torch.relu(features) if index else features)
    # not amax, whose gradient, shared among ties, costs three times as much on a CPU
    return features.max(dim=1).values
