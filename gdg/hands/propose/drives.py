"""Gains and force limits of the joints' drives."""

from __future__ import annotations

import numpy as np
import torch

from gdg.hands.hand import Hand
from gdg.hands.spec import Drive
from gdg.hands.urdf import Joint
from gdg.kinds.hand_model import HandModel

#: Efforts that a hand's joint can have; what lies outside is a placeholder: N m, and N.
PLAUSIBLE_EFFORT = {"turning": (0.02, 50.0), "sliding": (1.0, 1000.0)}
#: What a finger is taken to press with where no effort is stated, N.
FINGER_FORCE_N = 15.0
#: Least torque of an estimate, N m.
LEAST_TORQUE = 0.1
#: A drive gives its full force at this error: rad, and m.
FULL_FORCE_AT = {"turning": 0.05, "sliding": 0.005}
#: Damping as a share of the stiffness, s.
DAMPING_TIME_S = 0.05


def drive_of(hand: HandModel, joint: Joint) -> tuple[Drive, bool]:
    """A joint's drive, and whether its force limit is the effort that the URDF states."""
    kind = "sliding" if joint.type == "prismatic" else "turning"
    low, high = PLAUSIBLE_EFFORT[kind]
    stated = low <= joint.effort <= high
    limit = joint.effort if stated else _estimate(hand, joint, kind)
    limit = float(f"{limit:.2g}")
    stiffness = float(f"{limit / FULL_FORCE_AT[kind]:.2g}")
    damping = float(f"{stiffness * DAMPING_TIME_S:.2g}")
    return Drive(stiffness=stiffness, damping=damping, force_limit=limit), stated


def _estimate(hand: HandModel, joint: Joint, kind: str) -> float:
    if kind == "sliding":
        return 2 * FINGER_FORCE_N
    return max(LEAST_TORQUE, FINGER_FORCE_N * lever(hand, hand.hand, joint))


def lever(model: HandModel, hand: Hand, joint: Joint) -> float:
    """Distance of the farthest point that a joint turns from its axis, metres."""
    actuated = hand.spec.joints.index(joint.name)
    middle = ((model.lower + model.upper) / 2)[None]
    other, step = middle.clone(), 1e-3
    other[0, actuated] += step
    before, after = (
        model.place_surface(model.link_poses_in_root(values)) for values in (middle, other)
    )
    speed = torch.linalg.norm(after - before, dim=-1) / step
    return float(np.percentile(speed.numpy(), 100))
