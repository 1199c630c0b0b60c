"""Two jaws around an object, protocols with other values, and verdicts of them in PhysX."""

from __future__ import annotations

import numpy as np
import torch
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from gripper import OPEN_M

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol, load_protocol

#: Height of the base under the middle of the object, so that the jaws close on its middle.
BASE_BELOW_M = 0.035


def protocol_of(name: str, shifts: int = 0, **changes: object) -> Protocol:
    """A preset with other values; ``pushes={"order": "reset"}`` changes one of a section."""
    preset = load_protocol(name)
    tree = preset.model_dump()
    tree["shifts"]["count"] = shifts
    for section, values in changes.items():
        old = tree.get(section)
        merged = isinstance(values, dict) and isinstance(old, dict)
        tree[section] = {**old, **values} if merged else values
    return Protocol(**tree)


def grasp_of(
    obj: ObjectModel,
    gap: float = 0.0,
    squeeze: float | None = 0.002,
    shift: float = 0.0,
    below: float = BASE_BELOW_M,
    from_above: bool = False,
) -> GraspSet:
    """The two jaws around the object, each inner face ``gap`` metres from it.

    Args:
        obj: what is grasped, along y.
        gap: distance of both faces from the object, metres.
        squeeze: how far the drives' targets lie beyond the joints, metres.
        shift: the hand's motion along x, metres.
        below: how far the palm is under the object's middle, metres.
        from_above: turns hand and base over, so that the palm looks down on the object.
    """
    pose = torch.eye(4)
    if from_above:
        pose[1, 1] = pose[2, 2] = -1.0
    pose[2, 3], pose[0, 3] = (below if from_above else -below), shift
    half = float(np.abs(obj.mesh.bounds[:, 1]).max())
    joints = torch.tensor([[OPEN_M - half - gap]], dtype=torch.float32)
    targets = None if squeeze is None else joints + squeeze
    return GraspSet("two_jaws", obj.name, ("close",), "base", pose[None], joints, targets)


def verdict_of(
    hand: HandModel,
    obj: ObjectModel,
    grasps: GraspSet,
    protocol: Protocol,
    **options: object,
) -> Verdict:
    """The verdict of PhysX on one grasp."""
    simulator = SapienSimulator(SapienOptions.model_validate(options))
    (verdict,) = simulator.simulate(hand, obj, grasps, protocol)
    return verdict
