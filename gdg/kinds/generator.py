"""Generator: object → contact maps. It knows no hand."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch

from gdg.components import Options
from gdg.data.contact_map import ContactMap
from gdg.objects.model import ObjectModel


class Generator(ABC):
    """Proposes where on an object a grasp touches.

    One that learns is ``gdg.kinds.trainable.Trainable``, too.

    Args:
        options: the component's options.
    """

    def __init__(self, options: Options):
        self.options = options

    @abstractmethod
    def generate(self, obj: ObjectModel, count: int, generator: torch.Generator) -> ContactMap:
        """``count`` maps on ``obj.points``; the same generator state gives the same maps."""
