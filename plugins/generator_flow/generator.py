"""The generator: contact maps by following the flow from noise."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.components import Options
from gdg.data.contact_map import ContactMap
from gdg.kinds.generator import Generator
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import BatchKind, Trainable
from gdg.objects.model import ObjectModel

from .flow import contact_values, integrate
from .frames import in_own_frames
from .network import FlowNetwork, Surface
from .options import FlowOptions
from .weights import Weights, load_weights, save_weights

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule


class FlowGenerator(Generator, Trainable):
    """Integrates noise on an object's points into contact maps.

    Where and how the object lies in its frame doesn't matter: the network sees it in a frame of
    its own. Its size in metres does.

    Args:
        options: the weights to use and how to integrate.
    """

    options: FlowOptions
    batch_kind: ClassVar[BatchKind] = "maps"
    # patches of fewer points hold other points, and noise that averages less
    whole_surfaces: ClassVar[bool] = True
    follows_epochs: ClassVar[bool] = True

    @cached_property
    def weights(self) -> Weights:
        """The weights, read on first use."""
        return load_weights(self.options.weights)

    @cached_property
    def _network(self) -> FlowNetwork:
        return self.weights.network()

    @torch.no_grad()
    def generate(self, obj: ObjectModel, count: int, generator: torch.Generator) -> ContactMap:
        """``count`` maps on ``obj.points``; the same generator state gives the same maps.

        A frame is drawn, then the noise of one map after the other, on the generator's device:
        the first maps of a larger ``count`` are those of a smaller one.

        Raises:
            GdgError: the weights can't be found, read or fitted to the network.
        """
        network, device = self._network.to(obj.points.device), obj.points.device
        surface = network.surface(*in_own_frames(obj.points[None], obj.normals[None], generator))
        noise = obj.points.new_empty(count, len(obj.points))
        for row in noise:
            row.copy_(torch.randn(len(row), generator=generator, device=generator.device))
        parts = (self.options.temperature * noise).to(device).split(self.options.batch)
        return ContactMap(
            object_name=obj.name,
            values=torch.cat([self._maps(network, surface, part) for part in parts]),
            distance=self.weights.distance,
            provenance={
                "generator": "flow",
                "weights": self.weights.file.path.name,
                "weights_sha256": self.weights.file.sha256,
                "steps": self.options.steps,
                "temperature": self.options.temperature,
                "training": self.weights.provenance,
            },
        )

    def _maps(
        self, network: FlowNetwork, surface: Surface, noise: Float[Tensor, "map object_point"]
    ) -> Float[Tensor, "map object_point"]:
        """Contact values of the maps that the flow leads to from some noise."""

        def predict(maps: Tensor, time: float) -> Tensor:
            return network(surface, maps, maps.new_full(maps.shape[:2], time))

        return contact_values(integrate(predict, noise[None], self.options.steps)[0])

    @classmethod
    def trainable(
        cls, options: Options, learning_rate: float, seed: int, hand: HandModel | None = None
    ) -> LightningModule:
        """A fresh network of the options' size; it learns from maps of any hand."""
        from .module import FlowModule  # Lightning takes seconds to import

        assert isinstance(options, FlowOptions)
        return FlowModule(options, learning_rate, seed)

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        """Writes safetensors with the metadata as provenance."""
        network = module.network
        assert isinstance(network, FlowNetwork)
        save_weights(path, network, metadata)
