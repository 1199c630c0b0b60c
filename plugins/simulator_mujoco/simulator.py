"""The simulator component: verdicts by MuJoCo."""

from __future__ import annotations

import mujoco

from gdg.hands.hand import Hand
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.simulation.simulator import WorldSimulator

from .options import MujocoOptions
from .world import MujocoWorld


class MujocoSimulator(WorldSimulator):
    """MuJoCo: no GPU, no display, one compiled scene for all grasps of a pair.

    Hand, drives, shapes, mass and friction are those of the PhysX simulator. What differs:

    - Steps are those of the protocol, divided until they are ``max_timestep_ms`` or less. Damping
      of the object takes 1 - d·dt of its velocity in each step of the engine, so with damping a
      free object goes somewhat farther than in PhysX, whose steps are longer.
    - Contacts are springs, see ``Surface``; there is no limit to the speed of depenetration.
    - Contacts are points, where PhysX has patches that resist a twist about their normal even in a
      protocol without torsional friction. In exchange torsional friction is simulated.
    - Friction cones are MuJoCo's, convex: what slides also wants to part. That may be why objects
      that fingers only just touch, unpressed, more often stay than in PhysX.
    """

    options: MujocoOptions
    engine = f"mujoco {mujoco.__version__}"

    def __init__(self, options: MujocoOptions):
        super().__init__(options)

    def build_world(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> MujocoWorld:
        """A fresh scene; subclasses may alter it before trials run in it."""
        return MujocoWorld(hand, obj, protocol, self.options)

    def left_out(self, protocol: Protocol) -> tuple[str, ...]:
        """MuJoCo's springs push overlaps apart as fast as their time constant says."""
        return (
            f"MuJoCo has no limit to the speed of depenetration; the protocol's "
            f"{protocol.start.max_depenetration_velocity:g} m/s is left out.",
        )
