"""Planner: (hand, object, n) → grasps; what tables compare."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

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

        Where ``obj.table`` says that the object rests on a table, the hand must stay above it:
        ``gdg.penetration`` counts it, ``gdg.closure`` and ``gdg.initial_poses`` heed it. Grasps in
        the table, or reached through it, are left out after planning (``gdg.scenes.keep``).

        ``provenance["rejected"]`` counts the reasons for which candidates were dropped.
        """

    def plan_many(
        self,
        hand: HandModel,
        objects: Sequence[ObjectModel],
        count: int,
        generators: Sequence[torch.Generator],
        progress: Progress | None = None,
    ) -> list[GraspSet]:
        """As ``plan`` for each object in turn, with its own generator.

        A planner that can do so works on all objects at once, which fills a GPU. What an object
        gets must not depend on the others, but for rounding: draw its random numbers from its own
        generator alone.

        Args:
            hand: the hand.
            objects: on the hand's device; one may stand there twice.
            count: grasps of each object, at most.
            generators: one per object.
            progress: called as the whole call advances.
        """
        return [
            self.plan(hand, obj, count, generator, _share(progress, number, len(objects)))
            for number, (obj, generator) in enumerate(zip(objects, generators, strict=True))
        ]


def _share(progress: Progress | None, number: int, parts: int) -> Progress | None:
    """Progress of one of several parts, told as that of the whole."""
    if progress is None:
        return None
    return lambda done, total: progress(number * total + done, parts * total)
