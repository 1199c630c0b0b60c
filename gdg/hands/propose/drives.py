"""Gains and force limits of the joints' drives."""

from __future__ import annotations

import torch

from gdg.hands.spec import Drive
from gdg.hands.urdf import Joint
from gdg.kinds.hand_model import HandModel

#: Forces at the farthest point that a finger's joint moves, N; efforts that give other ones are
#: placeholders.
PLAUSIBLE_FORCE_N = (1.0, 80.0)
#: What a finger is taken to press with where no plausible effort is stated, N.
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
    stated = plausible(hand, joint.name, joint.effort)
    limit = joint.effort if stated else max(LEAST_TORQUE, FINGER_FORCE_N * _arm(hand, joint))
    limit = float(f"{limit:.2g}")
    stiffness = float(f"{limit / FULL_FORCE_AT[kind]:.2g}")
    damping = float(f"{stiffness * DAMPING_TIME_S:.2g}")
    return Drive(stiffness=stiffness, damping=damping, force_limit=limit), stated


def plausible(hand: HandModel, joint: str, effort: float) -> bool:
    """Whether an effort, N m or N, gives a force at the fingertip that a hand can have."""
    arm = _arm(hand, hand.hand.urdf.joints[joint])
    low, high = PLAUSIBLE_FORCE_N
    return low * arm <= effort <= high * arm


def _arm(hand: HandModel, joint: Joint) -> float:
    """What turns a joint's effort into a force: metres, or 1 for a prismatic joint."""
    return 1.0 if joint.type == "prismatic" else lever(hand, joint)


def lever(hand: HandModel, joint: Joint) -> float:
    """Distance of the farthest point that a joint turns from its axis, metres."""
    middle = ((hand.lower + hand.upper) / 2)[None]
    after, step = middle.clone(), 1e-3
    after[0, hand.joint_names.index(joint.name)] += step
    first, second = (
        hand.place_surface(hand.link_poses_in_root(values)) for values in (middle, after)
    )
    return float(torch.linalg.norm(second - first, dim=-1).max()) / step
