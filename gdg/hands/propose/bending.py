"""The drive that moves a fingertip most directly, and how it moves points of the tip."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.hands.propose.structure import Finger
from gdg.kinds.hand_model import HandModel


@dataclass(frozen=True)
class Mover:
    """One joint of a finger that follows a drive.

    Attributes:
        link: index of its child link.
        axis: unit vector in that link's frame.
        rate: its change per change of the drive.
        turns: whether it turns; otherwise it slides.
    """

    link: int
    axis: Float[Tensor, "3"]
    rate: float
    turns: bool


@dataclass(frozen=True)
class TipDrive:
    """The actuated joint that moves a fingertip with the fewest links between.

    Attributes:
        joint: its index among the actuated joints.
        movers: the joints between palm and tip that follow it, from the palm outward: one for an
            ordinary finger, several where it is coupled (a four-bar, an underactuated finger).
    """

    joint: int
    movers: tuple[Mover, ...]

    def velocity(
        self, Ts: Float[Tensor, "grip link 4 4"], points: Float[Tensor, "grip point 3"]
    ) -> Float[Tensor, "grip point 3"]:
        """How points of the tip move per change of the drive, the frame of ``Ts``."""
        total = torch.zeros_like(points)
        for mover in self.movers:
            T = Ts[:, mover.link]
            motion = (T[:, :3, :3] @ mover.axis)[:, None].expand_as(points)
            if mover.turns:
                motion = torch.linalg.cross(motion, points - T[:, None, :3, 3])
            total = total + mover.rate * motion
        return total


def tip_drive(hand: HandModel, finger: Finger) -> TipDrive | None:
    """The drive of a fingertip; None if nothing drives the finger."""
    coupling, rows = hand.hand.coupling[0], hand.hand.moving_rows
    above = hand.hand.urdf.joint_above
    inward, link = [], finger.distal[0]
    while link in above and link in finger.links:
        if above[link].name in rows:
            inward.append(above[link])
        link = above[link].parent
    driven = [joint for joint in inward if coupling[rows[joint.name]].any()]
    if not driven:
        return None
    drive = int(coupling[rows[driven[0].name]].nonzero()[0][0])
    movers = tuple(
        Mover(
            link=hand.link_names.index(joint.child),
            axis=torch.as_tensor(joint.axis, dtype=torch.float32),
            rate=float(coupling[rows[joint.name], drive]),
            turns=joint.type != "prismatic",
        )
        for joint in reversed(driven)
        if coupling[rows[joint.name], drive] != 0
    )
    return TipDrive(drive, movers)
