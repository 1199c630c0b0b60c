"""The generator: contact maps by decoding random latents."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import torch

from gdg.components import Options
from gdg.data.contact_map import ContactMap
from gdg.kinds.generator import Generator
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import BatchKind, Trainable
from gdg.objects.model import ObjectModel

from .network import LATENT, PointNetCvae
from .options import CvaeOptions
from .weights import Weights, load_weights, save_weights

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule


class CvaeGenerator(Generator, Trainable):
    """Decodes latents z ~ N(0, temperature²) on an object's points.

    Args:
        options: the weights to use and how to sample.
    """

    options: CvaeOptions
    batch_kind: ClassVar[BatchKind] = "maps"

    @cached_property
    def weights(self) -> Weights:
        """The weights, read on first use."""
        return load_weights(self.options.weights)

    @cached_property
    def _network(self) -> PointNetCvae:
        return self.weights.network()

    @torch.no_grad()
    def generate(self, obj: ObjectModel, count: int, generator: torch.Generator) -> ContactMap:
        """``count`` maps on ``obj.points``; the same generator state gives the same maps.

        Latents are drawn on the generator's device, one after the other: the first maps of a
        larger ``count`` are those of a smaller one.

        Raises:
            GdgError: the weights can't be found, read or fitted to the network.
        """
        decoder = self._network.decoder.to(obj.points.device)
        drawn = torch.randn(count, LATENT, generator=generator, device=generator.device)
        latents = self.options.temperature * drawn.to(obj.points.device)
        features = decoder.features(obj.points[None])
        values = [decoder.decode(*features, part) for part in latents.split(self.options.batch)]
        return ContactMap(
            object_name=obj.name,
            values=torch.cat(values),
            distance=self.weights.distance,
            provenance={
                "generator": "cvae",
                "weights": self.weights.path.name,
                "weights_sha256": self.weights.sha256,
                "temperature": self.options.temperature,
                "training": self.weights.provenance,
            },
        )

    @classmethod
    def trainable(
        cls, options: Options, learning_rate: float, seed: int, hand: HandModel | None = None
    ) -> LightningModule:
        """A fresh network with the release's loss; ``options`` matter to inference only."""
        from .module import CvaeModule  # Lightning takes seconds to import

        return CvaeModule(learning_rate, seed)

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        """Writes safetensors with the metadata as provenance."""
        network = module.network
        assert isinstance(network, PointNetCvae)
        save_weights(path, network, metadata)
