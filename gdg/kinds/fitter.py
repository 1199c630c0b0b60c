"""Fitter: contact map × hand → grasps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import torch

from gdg.components import Options
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel

#: Called with (steps done, steps in all) while a fit runs.
Progress = Callable[[int, int], None]


class Fitter(ABC):
    """Moves a hand until its own contact map equals a given one.

    Args:
        options: the component's options.
        distance: the metric that the hand's contact map is measured with.
    """

    def __init__(self, options: Options, *, distance: Distance):
        self.options = options
        self.distance = distance

    @abstractmethod
    def fit(
        self,
        hand: HandModel,
        obj: ObjectModel,
        maps: ContactMap,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """The best grasps of each map, in the order of the maps.

        Equally many of each map, the lowest energy first: one or, if so configured, several for a
        planner to choose among. No maps give no grasps.

        Energies carry ``total`` and the terms it is the weighted sum of.

        Raises:
            GdgError: the maps lie on other points than ``obj.points``, or were made with another
                distance and can't be rewritten (``gdg.contact_maps.values_on`` sees to both).
        """
