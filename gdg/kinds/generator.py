"""Generator: object → contact maps. It knows no hand."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from gdg.components import Options
from gdg.data.contact_map import ContactMap
from gdg.errors import GdgError
from gdg.objects.model import ObjectModel

if TYPE_CHECKING:
    from lightning.pytorch import LightningModule


class Generator(ABC):
    """Proposes where on an object a grasp touches.

    Args:
        options: the component's options.
    """

    def __init__(self, options: Options):
        self.options = options

    @abstractmethod
    def generate(self, obj: ObjectModel, count: int, generator: torch.Generator) -> ContactMap:
        """``count`` maps on ``obj.points``; the same generator state gives the same maps."""

    @classmethod
    def trainable(cls, options: Options, learning_rate: float, seed: int) -> LightningModule:
        """A fresh network to be trained by ``gdg train``; only for generators that learn.

        Its steps get a ``gdg.training.maps.MapBatch``; ``validation_step`` must log
        ``val_recon``, the lower the better, by which the best epoch is chosen. All randomness
        comes from generators seeded with ``seed`` and the epoch, so that a resumed run equals an
        uninterrupted one.

        Raises:
            GdgError: the generator has nothing to train.
        """
        raise GdgError(f"{cls.__name__} has nothing to train; choose another generator=….")

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        """Writes a trained module's weights to ``path`` (``.safetensors``), atomically.

        Args:
            module: what ``trainable`` gave, trained.
            path: the file to write; the generator's ``weights`` option takes it.
            metadata: JSON values to store in the file: ``distance``, the label of the maps'
                distance, and where the training data came from.

        Raises:
            GdgError: the generator has nothing to train.
        """
        raise GdgError(f"{cls.__name__} has nothing to export; choose another generator=….")
