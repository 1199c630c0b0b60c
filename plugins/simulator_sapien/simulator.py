"""The simulator component: verdicts by PhysX on the CPU."""

from __future__ import annotations

from gdg.hands.hand import Hand
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.simulation.simulator import WorldSimulator

from .engine import sapien
from .options import SapienOptions
from .scene import GraspScene


class SapienSimulator(WorldSimulator):
    """PhysX through SAPIEN: no GPU, no display, one scene for all grasps of a pair.

    The hand's root is fixed; every moving joint, mimic and passive ones included, is held by a
    drive whose target follows from the actuated joints. Links of the hand don't collide with each
    other, since the hulls of neighbours overlap.
    """

    options: SapienOptions
    engine = f"sapien {sapien.__version__}"

    def __init__(self, options: SapienOptions):
        super().__init__(options)

    def build_world(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> GraspScene:
        """A fresh scene; subclasses may alter it before trials run in it."""
        return GraspScene(hand, obj, protocol, self.options)

    def left_out(self, protocol: Protocol) -> tuple[str, ...]:
        """PhysX has no torsional friction."""
        if not protocol.torsional_friction:
            return ()
        return (
            f"PhysX has no torsional friction; the protocol's {protocol.torsional_friction:g} m "
            f"is left out.",
        )
