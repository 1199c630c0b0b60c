"""The simulator component: verdicts by MuJoCo."""

from __future__ import annotations

import mujoco

from gdg.hands.hand import Hand
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.simulation.simulator import WorldSimulator
from gdg.simulation.table import Table

from .options import MujocoOptions
from .world import MujocoWorld


class MujocoSimulator(WorldSimulator):
    """MuJoCo: no GPU, no display, one compiled scene for all grasps of a call."""

    options: MujocoOptions
    engine = f"mujoco {mujoco.__version__}"

    def __init__(self, options: MujocoOptions):
        super().__init__(options)

    def build_world(
        self, hand: Hand, obj: ObjectModel, protocol: Protocol, table: Table | None = None
    ) -> MujocoWorld:
        """A fresh scene; subclasses may alter it before trials run in it."""
        return MujocoWorld(hand, obj, protocol, self.options, table)
