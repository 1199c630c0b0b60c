"""Options that all physics simulators share. Light: imports no torch."""

from __future__ import annotations

from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from gdg.components import Options


class SimulatorOptions(Options):
    """Options of every ``WorldSimulator``.

    Attributes:
        trials: ``all`` of the protocol's, the unshifted one to its end; ``decisive``: only until
            the majority is decided, and each of them until its outcome is. Success and the
            failure's name are the same; what did not run isn't known, so displacements may be
            NaN (of a grasp that fails at least one trial), and ``stable`` of a passing one None.
            For synthesis, and what verified grasps are tested by.
        force_limits: whether the hand's own force limits bound the drives of a protocol that
            sets their gains. The releases' drives are practically unlimited, and crush what they
            hold. A protocol without gains takes gains and limits from the hand.
        armature: inertia of the motors' rotors as each joint feels it, kg m². Zero in the
            releases; PhysX then delivers only a small part of a stiff drive's torque, the less the
            lighter the link and the fewer the iterations. At 1e-3, with ``force_limits``, grip
            forces are those of the drives, whatever the number of iterations.
    """

    one_by_one = True
    for_verified = MappingProxyType({"trials": "decisive"})
    trials: Literal["all", "decisive"] = "all"
    force_limits: bool = True
    armature: Annotated[float, Field(ge=0, le=1)] = 1e-3
