"""Planner: (hand, object, n) → grasps; what tables compare."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch

from gdg.components import Options
from gdg.data.grasps import GraspSet
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel


class Planner(ABC):
    """Plans grasps of a hand on an object.

    Args:
        options: the component's options. Further keyword arguments are the components that the
            record says it ``uses``.
    """

    def __init__(self, options: Options):
        self.options = options

    @abstractmethod
    def plan(
        self,
        hand: HandModel,
        obj: ObjectModel,
        count: int,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        """At most ``count`` grasps, best first; fewer (even none) when no more were found.

        ``provenance["rejected"]`` counts the reasons for which candidates were dropped.
        """
