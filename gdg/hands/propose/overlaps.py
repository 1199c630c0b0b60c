"""How deep the links of a hand lie in each other, for many postures at once."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.kinds.hand_model import HandModel

Pair = tuple[str, str]


def link_overlaps(
    hand: HandModel,
    joints: Float[Tensor, "posture joint"],
    apart: Bool[np.ndarray, "link link"],
) -> dict[Pair, Float[np.ndarray, "posture"]]:
    """Largest depth of a surface point of one link in another, metres; pairs that never touch
    are left out.

    Args:
        hand: the hand.
        joints: postures.
        apart: pairs of links that are looked at.
    """
    Ts_root_link = hand.link_poses_in_root(joints).double().numpy()
    surface = hand.surface
    points, owner = surface.points.double().numpy(), surface.link_index.numpy()
    found: dict[Pair, np.ndarray] = {}
    for part in hand.hand.parts:
        number = hand.link_names.index(part.link)
        planes = np.asarray(part.mesh.face_normals)
        offsets = np.einsum("ij,ij->i", planes, part.mesh.triangles[:, 0])
        low, high = part.mesh.bounds
        for other in np.unique(owner):
            if not apart[number, other]:
                continue
            T = np.linalg.inv(Ts_root_link[:, number]) @ Ts_root_link[:, other]
            placed = points[owner == other] @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
            posture, point = np.nonzero(((placed > low) & (placed < high)).all(-1))
            if len(posture) == 0:
                continue
            depth = -(placed[posture, point] @ planes.T - offsets).max(-1)
            names = sorted((part.link, hand.link_names[other]))
            deepest = found.setdefault((names[0], names[1]), np.zeros(len(joints)))
            np.maximum.at(deepest, posture, depth)
    return {pair: depth for pair, depth in found.items() if depth.max() > 0}


def random_postures(hand: HandModel, count: int, seed: int = 0) -> Float[Tensor, "posture joint"]:
    """Postures spread over the joints' ranges."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(count, len(hand.joint_names), generator=generator)
    return hand.lower + share * (hand.upper - hand.lower)
