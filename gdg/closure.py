"""Closes a hand's fingers until they touch the object."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration.touching import crossing_pairs, link_pairs, touching_links
from gdg.rotations import ROOT_DIM

#: Steps from the open to the closed posture; each is some 2 mm at a fingertip.
STEPS = 64


@torch.no_grad()
def close_until_touch(
    hand: HandModel, obj: ObjectModel, q: Float[Tensor, "batch dof"], margin_m: float = 0.0
) -> Float[Tensor, "batch dof"]:
    """q with every finger that is off the object flexed toward the closed posture.

    A joint stops when a link that it moves touches the object or another link, or at the closed
    posture; joints further out on the same finger go on, as in an underactuated hand. The root,
    joints that take no part in closing, and joints that touch already or are beyond the closed
    posture stay. A link touches from ``margin_m`` on, metres.
    """
    joints, root = q[:, ROOT_DIM:].clone(), q[:, :ROOT_DIM]
    goal = hand.closed_posture.expand_as(joints)
    step = (hand.closed_posture - hand.open_posture) / STEPS
    moves = moved_links(hand)
    first, second = link_pairs(hand).unbind(-1)
    parts = moves[:, first] ^ moves[:, second]
    for _ in range(STEPS):
        ahead = (goal - joints) * step.sign() > step.abs() / 2
        free = ahead & ~_held(hand, obj, torch.cat((root, joints), dim=-1), moves, parts, margin_m)
        # a joint that would press a link into the object keeps its value; twice, since joints
        # that stop change where those that go on take their links
        for _ in range(2):
            trial = joints + torch.where(free, step, torch.zeros_like(step))
            free &= ~_held(hand, obj, torch.cat((root, trial), dim=-1), moves, parts, margin_m)
        if not free.any():
            break
        joints = joints + torch.where(free, step, torch.zeros_like(step))
    return torch.cat((root, joints), dim=-1)


def moved_links(hand: HandModel) -> Bool[Tensor, "joint link"]:
    """Which links each actuated joint moves relative to the root, mimic joints included."""
    coupling, above = hand.hand.coupling[0], hand.hand.rows_above
    moves = [(coupling[sorted(above[name])] != 0).any(0) for name in hand.link_names]
    return torch.as_tensor(np.stack(moves, axis=1), device=hand.device)


def _held(
    hand: HandModel,
    obj: ObjectModel,
    q: Float[Tensor, "batch dof"],
    moves: Bool[Tensor, "joint link"],
    parts: Bool[Tensor, "joint link_pair"],
    margin_m: float,
) -> Bool[Tensor, "batch joint"]:
    """Which joints move a link that touches the object, or ``parts`` two links that cross."""
    Ts = hand.link_poses(q)
    on_object = touching_links(hand, obj, Ts, margin_m)[:, None] & moves
    on_hand = crossing_pairs(hand, Ts)[:, None] & parts
    return on_object.any(-1) | on_hand.any(-1)
