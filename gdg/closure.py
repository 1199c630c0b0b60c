"""Closes a hand's fingers until they touch the object."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration_depth
from gdg.penetration.table import hand_height, link_heights, raised
from gdg.penetration.touching import crossing_pairs, link_pairs, touching_links
from gdg.rotations import ROOT_DIM

#: Steps from the open to the closed posture; each is some 2 mm at a fingertip.
STEPS = 64
#: Heights above a table are compared to this accuracy, metres.
ROUNDING_M = 1e-6
#: A hand that rises may press links so deep into the object, metres.
SLIDING_M = 3e-4


@torch.no_grad()
def close_until_touch(
    hand: HandModel,
    obj: ObjectModel,
    q: Float[Tensor, "batch dof"],
    margin_m: float = 0.0,
    rise: bool = False,
) -> Float[Tensor, "batch dof"]:
    """q with every finger that is off the object flexed toward the closed posture.

    A joint stops when a link that it moves touches the object or another link, or at the closed
    posture; joints further out on the same finger go on, as in an underactuated hand. The root,
    joints that take no part in closing, and joints that touch already or are beyond the closed
    posture stay. A link touches from ``margin_m`` on, metres.

    On a table, a joint also stops when it would move a link down onto it. With ``rise`` the hand
    moves up instead, so that fingertips sweep along the table, as long as that presses no link
    into the object.
    """
    closed, q = hand.closed_posture, q.clone()
    step = (closed - hand.open_posture) / STEPS
    moves = moved_links(hand)
    first, second = link_pairs(hand).unbind(-1)
    parts = moves[:, first] ^ moves[:, second]
    closing = torch.arange(len(q), device=q.device)
    held = _held(hand, obj, q, moves, parts, margin_m)
    for _ in range(STEPS):
        now = q[closing]
        ahead = (closed - now[:, ROOT_DIM:]) * step.sign() > step.abs() / 2
        tried = free = ahead & ~held
        # a joint that would press a link into the object keeps its value; twice, since joints
        # that stop change where those that go on take their links
        for _ in range(2):
            tried = free
            trial = _moved(hand, obj, now, torch.where(tried, step, 0.0), margin_m, rise)
            held = _held(hand, obj, trial, moves, parts, margin_m)
            free = tried & ~held & ~_lowered(hand, obj, now, trial, moves, margin_m)
        going, stopped = free.any(-1), (free != tried).any(-1)
        moved = _moved(hand, obj, now, torch.where(free, step, 0.0), margin_m, rise)
        if (again := going & stopped).any():
            held[again] = _held(hand, obj, moved[again], moves, parts, margin_m)
        closing, held = closing[going], held[going]
        if not len(closing):
            break
        q[closing] = moved[going]
    return q


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


def _moved(
    hand: HandModel,
    obj: ObjectModel,
    q: Float[Tensor, "batch dof"],
    step: Float[Tensor, "batch joint"],
    margin_m: float,
    rise: bool,
) -> Float[Tensor, "batch dof"]:
    """q after a step of the joints, with hands raised that would come down on the table."""
    trial = torch.cat((q[:, :ROOT_DIM], q[:, ROOT_DIM:] + step), dim=-1)
    if not rise or obj.table is None:
        return trial
    least = hand_height(hand, obj.table, q).clamp(max=margin_m)
    higher = raised(hand, obj.table, trial, least)
    depth = penetration_depth(hand, obj, q).clamp(min=SLIDING_M)
    clear = penetration_depth(hand, obj, higher) <= depth
    return torch.where(clear[:, None], higher, trial)


def _lowered(
    hand: HandModel,
    obj: ObjectModel,
    now: Float[Tensor, "batch dof"],
    trial: Float[Tensor, "batch dof"],
    moves: Bool[Tensor, "joint link"],
    margin_m: float,
) -> Bool[Tensor, "batch joint"]:
    """Which joints move a link that comes nearer to the table than ``margin_m``, or sinks there.

    A link that lies on the table may still move, but not down.
    """
    if obj.table is None:
        return torch.zeros(len(now), len(moves), dtype=torch.bool, device=now.device)
    least = link_heights(hand, obj.table, hand.link_poses(now)).clamp(max=margin_m)
    sunk = link_heights(hand, obj.table, hand.link_poses(trial)) < least - ROUNDING_M
    return (sunk[:, None] & moves).any(-1)
