"""The oracle: maps of known grasps, which bound what any generator can give a fitter."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import torch

from gdg.contact_maps import contact_maps_of_grasps
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet, load_grasps
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.kinds.distance import Distance
from gdg.kinds.generator import Generator
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.registry import get_registry

from .options import OracleOptions


class OracleGenerator(Generator):
    """Gives the maps of the grasps in a file, in the file's order, again and again.

    Args:
        options: the file and its hand.
        distance: what the maps are made with.
    """

    options: OracleOptions

    def __init__(self, options: OracleOptions, *, distance: Distance):
        super().__init__(options)
        self._distance = distance

    @cached_property
    def _grasps(self) -> GraspSet:
        grasps = load_grasps(Path(self.options.grasps).expanduser())
        if not len(grasps):
            raise GdgError(f"generator.grasps: {self.options.grasps} holds no grasps.")
        return grasps

    @cached_property
    def _hand(self) -> HandModel:
        record = get_registry().find("hand-model", self.options.hand_model)
        hand = find_hand(self.options.hand or self._grasps.hand)
        return record.load()(record.options(), hand, torch.device("cpu"))

    def generate(self, obj: ObjectModel, count: int, generator: torch.Generator) -> ContactMap:
        """``count`` maps on ``obj.points``; nothing is random, so ``generator`` stays unused.

        Raises:
            GdgError: no readable grasps, or they are of another object, or of another hand.
        """
        grasps = self._grasps
        if grasps.object_name != obj.name:
            raise GdgError(
                f"generator.grasps: {self.options.grasps} holds grasps of '{grasps.object_name}', "
                f"not of '{obj.name}'; give the file of the object to grasp."
            )
        rows = list(range(min(count, len(grasps))))
        device = obj.points.device
        known = contact_maps_of_grasps(
            self._hand, obj.to(self._hand.device), grasps.select(rows), self._distance
        )
        repeated = torch.arange(count) % max(len(rows), 1)
        return ContactMap(
            object_name=obj.name,
            values=known.values[repeated].to(device),
            distance=known.distance,
            provenance={
                "generator": "oracle",
                "hand": grasps.hand,
                "grasps": grasps.provenance,
            },
        )
