"""Keeps a hand above a table: on its way to a grasp, in the grasp, and while it squeezes."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.closure import moved_links
from gdg.data.table import Table
from gdg.kinds.hand_model import HandModel
from gdg.penetration.table import hand_height, link_heights
from gdg.rotations import ROOT_DIM

#: A hand comes from so far away, against the direction in which its palm looks, metres.
APPROACH_M = 0.10
#: Places on its way that are looked at, both ends included: one per centimetre.
STATIONS = 11
#: Joint targets that lead into the table are halved so often, and then left out.
HALVINGS = 4
#: Heights are compared to this accuracy, metres.
ROUNDING_M = 1e-6


@torch.no_grad()
def approach_height(
    hand: HandModel, table: Table, q: Float[Tensor, "batch dof"]
) -> Float[Tensor, "batch"]:
    """Height of the lowest point of a hand on its way to each grasp, metres; exact at the stations.

    The hand starts ``APPROACH_M`` away, against its palm's normal, with its joints in the open
    posture; it moves straight to the grasp, and its joints straight to theirs, both evenly.
    """
    _, normal = hand.palm(q)
    lowest = torch.full_like(q[:, 0], torch.inf)
    for share in torch.linspace(0.0, 1.0, STATIONS).tolist():
        position = q[:, :3] - share * APPROACH_M * normal
        joints = q[:, ROOT_DIM:] + share * (hand.open_posture - q[:, ROOT_DIM:])
        moved = torch.cat((position, q[:, 3:ROOT_DIM], joints), dim=-1)
        lowest = torch.minimum(lowest, hand_height(hand, table, moved))
    return lowest


@torch.no_grad()
def targets_above(
    hand: HandModel,
    table: Table,
    q: Float[Tensor, "batch dof"],
    targets: Float[Tensor, "batch joint"],
) -> Float[Tensor, "batch joint"]:
    """Joint targets that lead no link into a table, or deeper than it is in q.

    Joints that would carry a link there go half as far, a quarter, …, and in the end stay.
    """
    moves = moved_links(hand)
    joints = q[:, ROOT_DIM:]
    least = link_heights(hand, table, hand.link_poses(q)).clamp(max=0.0) - ROUNDING_M
    share = torch.ones_like(targets)
    # joints that stay may leave a link low that those which go on would have raised
    for halving in range(2 * HALVINGS):
        moved = torch.cat((q[:, :ROOT_DIM], joints + share * (targets - joints)), dim=-1)
        sunk = link_heights(hand, table, hand.link_poses(moved)) < least
        if not sunk.any():
            break
        factor = 0.5 if halving < HALVINGS else 0.0
        share = torch.where((sunk[:, None] & moves).any(-1), factor * share, share)
    return joints + share * (targets - joints)
