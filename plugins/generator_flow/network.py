"""The network: what a noisy contact map is a noisy version of.

A transformer on the patches of a surface. What belongs to the object is computed once for all its
maps and all integration steps (``Surface``): for each point two small vectors by which its value
enters its patch and is read from it, for each patch a token, and for each pair of patches how much
they attend to one another, from their distance and how they face each other (opposite patches make
grasps). A step then is linear per point, and the transformer sees 64 tokens.

Related work: the patches and the way the time enters follow diffusion transformers (Peebles and
Xie 2023; one modulation shared by all layers as in PixArt-α, Chen et al. 2023); that the clean map
is predicted instead of the velocity follows Li and He 2025, *Back to basics: let denoising
generative models denoise*, since maps are smooth and noise is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from .patches import Patches, split_into_patches

#: Patches of a surface; a patch of an object of 2048 points has 32 of them.
PATCHES = 64
#: Channels by which values of points enter and leave a patch.
KERNELS = 64
#: Metres that become one unit: about the radius of a graspable object.
UNIT_M = 0.05
#: Wavelengths of a patch's position, metres.
WAVELENGTHS_M = (0.4, 0.2, 0.1, 0.05)
TIME_FREQUENCIES = 32
MLP_RATIO = 3
PAIR_FEATURES, PAIR_HIDDEN = 5, 32
POINT_FEATURES = 7
PATCH_FEATURES = KERNELS + 7 + 6 * len(WAVELENGTHS_M)
#: Shift, scale and gate of attention and of the perceptron.
MODULATIONS = 6

Tokens = Float[Tensor, "object map patch channel"]
Values = Float[Tensor, "object map object_point"]
Times = Float[Tensor, "object map"]


@dataclass(frozen=True)
class Surface:
    """What the network knows of objects, whatever the map and the time.

    Attributes:
        patches: which points form which patch.
        enter: by which a point's value enters its patch.
        leave: by which it is read from the patch.
        tokens: of the patches.
        bias: added to the attention between patches, for each layer and head.
    """

    patches: Patches
    enter: Float[Tensor, "object patch member kernel"]
    leave: Float[Tensor, "object patch member kernel"]
    tokens: Float[Tensor, "object patch channel"]
    bias: Float[Tensor, "layer object head patch patch"]


class FlowNetwork(nn.Module):
    """Predicts clean maps from noisy ones.

    Args:
        width: channels of a patch.
        layers: transformer layers.
        heads: attention heads; they divide ``width``.

    Attributes:
        size: these three by name.
    """

    def __init__(self, width: int, layers: int, heads: int):
        super().__init__()
        self.size = {"width": width, "layers": layers, "heads": heads}
        self.point = _perceptron(POINT_FEATURES, KERNELS, KERNELS)
        self.kernels = nn.Linear(KERNELS, 2 * KERNELS)
        self.patch = _perceptron(PATCH_FEATURES, 2 * width, width)
        self.pair = _perceptron(PAIR_FEATURES, PAIR_HIDDEN, layers * heads)
        self.time = _perceptron(2 * TIME_FREQUENCIES, width, width)
        self.modulation = nn.Linear(width, MODULATIONS * width)
        self.value_in = nn.Linear(KERNELS, width)
        self.layers = nn.ModuleList(Layer(width, heads) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self.value_out = nn.Linear(width, KERNELS)

    def surface(
        self,
        points: Float[Tensor, "object object_point 3"],
        normals: Float[Tensor, "object object_point 3"],
    ) -> Surface:
        """What all maps on objects share.

        Args:
            points: metres, in the objects' own frames (``draw_frames``), origin at their mean.
            normals: outward unit normals, same frames.
        """
        patches = split_into_patches(points, PATCHES)
        gathered = patches.gather(torch.cat((points, normals), dim=-1))
        located, facing = gathered.split(3, dim=-1)
        center, normal = located.mean(2), facing.mean(2)
        offset = located - center[:, :, None]
        radius = (offset.square().sum(-1).mean(2) + 1e-12).sqrt()[..., None]
        size = (radius / UNIT_M).log()
        features = torch.cat(
            (
                offset / radius[:, :, None],
                facing,
                size[:, :, None].expand(-1, -1, offset.shape[2], -1),
            ),
            dim=-1,
        )
        hidden = functional.silu(self.point(features))
        enter, leave = self.kernels(hidden).split(KERNELS, dim=-1)
        described = (hidden.mean(2), center / UNIT_M, normal, size, _waves(center))
        tokens = self.patch(torch.cat(described, dim=-1))
        bias = self.pair(_pair_features(center, functional.normalize(normal, dim=-1)))
        bias = bias.unflatten(-1, (self.size["layers"], self.size["heads"])).permute(3, 0, 4, 1, 2)
        return Surface(patches, enter, leave, tokens, bias)

    def forward(self, surface: Surface, noisy: Values, time: Times) -> Values:
        """The clean maps that noisy ones most likely come from, on average.

        Args:
            surface: of the objects.
            noisy: standardised contact values, ``map`` for each object.
            time: of each map, 0 for pure noise and 1 for none.
        """
        members = surface.patches.gather(noisy.mT)  # object, patch, member, map
        pooled = (members.mT @ surface.enter) / members.shape[2] ** 0.5
        when = self.time(_time_features(time))
        modulation = self.modulation(functional.silu(when))[:, :, None]
        # layers add to them, in full precision
        tokens = surface.tokens.float()[:, None] + when[:, :, None]
        tokens = tokens + self.value_in(pooled.transpose(1, 2))
        for layer, bias in zip(self.layers, surface.bias):
            tokens = layer(tokens, modulation, bias)
        read = self.value_out(self.norm(tokens)).transpose(1, 2)
        # half precision would give the values steps that grow into errors near the end
        with torch.autocast(noisy.device.type, enabled=False):
            clean = surface.leave.float() @ read.float().mT / KERNELS**0.5
        return surface.patches.scatter(clean).mT

    @torch.no_grad()
    def initialise(self, generator: torch.Generator) -> None:
        """Xavier-uniform weights, biases 0; residual branches and the output start at 0."""
        for module in self.modules():
            if isinstance(module, nn.Linear):
                nn.init.xavier_uniform_(module.weight, generator=generator)
                nn.init.zeros_(module.bias)
        last_of_pair = self.pair[-1]
        assert isinstance(last_of_pair, nn.Linear)
        for module in (self.modulation, self.value_out, last_of_pair):
            nn.init.zeros_(module.weight)


class Layer(nn.Module):
    """Attention between patches, then a perceptron, both modulated by the time.

    Args:
        width: channels of a patch.
        heads: attention heads.
    """

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.modulation = nn.Parameter(torch.zeros(MODULATIONS, width))
        self.norms = nn.ModuleList(nn.LayerNorm(width, elementwise_affine=False) for _ in range(2))
        self.attention_in = nn.Linear(width, 3 * width)
        self.attention_out = nn.Linear(width, width)
        self.perceptron = nn.Sequential(
            nn.Linear(width, MLP_RATIO * width),
            nn.GELU(approximate="tanh"),
            nn.Linear(MLP_RATIO * width, width),
        )

    def forward(
        self,
        tokens: Tokens,
        modulation: Float[Tensor, "object map 1 all_modulations"],
        bias: Float[Tensor, "object head patch patch"],
    ) -> Tokens:
        """The tokens after this layer.

        Args:
            tokens: of each map's patches.
            modulation: what the time asks of all layers.
            bias: added to the attention between patches.
        """
        own = modulation.unflatten(-1, self.modulation.shape) + self.modulation
        shift, scale, gate, shift2, scale2, gate2 = own.unbind(-2)
        seen = self.norms[0](tokens) * (1 + scale) + shift
        tokens = tokens + gate * self._attend(seen, bias)
        seen = self.norms[1](tokens) * (1 + scale2) + shift2
        return tokens + gate2 * self.perceptron(seen)

    def _attend(self, seen: Tokens, bias: Float[Tensor, "object head patch patch"]) -> Tokens:
        parts = self.attention_in(seen).unflatten(-1, (3, self.heads, -1)).movedim(-3, 0)
        query, key, value = parts.transpose(-2, -3)  # object, map, head, patch, channel
        scores = query @ key.mT / math.sqrt(query.shape[-1]) + bias[:, None]
        mixed = scores.softmax(-1) @ value
        return self.attention_out(mixed.transpose(-2, -3).flatten(-2))


def _perceptron(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.SiLU(), nn.Linear(hidden, outputs))


def _waves(center: Float[Tensor, "object patch 3"]) -> Float[Tensor, "object patch wave"]:
    """Sines and cosines of positions."""
    numbers = 2 * math.pi / center.new_tensor(WAVELENGTHS_M)
    phases = (center[..., None] * numbers).flatten(-2)
    return torch.cat((phases.sin(), phases.cos()), dim=-1)


def _pair_features(
    center: Float[Tensor, "object patch 3"], normal: Float[Tensor, "object patch 3"]
) -> Float[Tensor, "object patch patch 5"]:
    """Distance of two patches, and how they face each other; no rotation changes it."""
    apart = center[:, None] - center[:, :, None]
    distance = (apart.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    toward = apart / (distance + 1e-3)
    own, other = normal[:, :, None], normal[:, None]
    dots = [
        (a * b).sum(-1, keepdim=True) for a, b in ((own, other), (own, toward), (other, toward))
    ]
    scaled = distance / UNIT_M
    return torch.cat((scaled, (-scaled.square()).exp(), *dots), dim=-1)


def _time_features(time: Times) -> Float[Tensor, "object map wave"]:
    frequencies = torch.logspace(0, 2, TIME_FREQUENCIES, device=time.device, dtype=time.dtype)
    phases = time[..., None] * frequencies
    return torch.cat((phases.sin(), phases.cos()), dim=-1)
