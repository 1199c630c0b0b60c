"""Tells the bars of a linkage from fingers."""

from __future__ import annotations

from dataclasses import replace

import torch
from scipy.spatial import KDTree

from gdg.hands.propose.sampling import random_postures
from gdg.hands.propose.structure import Finger, Structure
from gdg.kinds.hand_model import HandModel

#: A bar stays this near to the finger that it carries in every posture, metres.
PINNED_M = 0.006
#: Postures in which that is tried.
POSTURES = 12


def without_linkages(hand: HandModel, structure: Structure) -> Structure:
    """The structure without subtrees that are bars of another finger's linkage.

    A four-bar finger comes as two subtrees of the palm, since a tree holds no loop: the finger and
    the bar that keeps it parallel. The bar has one joint, moved by the finger's own drive, and its
    far end stays on the finger whatever the posture.
    """
    points = hand.place_surface(hand.link_poses_in_root(random_postures(hand, POSTURES)))
    drives = {finger: _drives_of(hand, finger) for finger in structure.fingers}

    def bar(finger: Finger) -> bool:
        return len(finger.joints) == 1 and any(
            len(other.joints) > 1
            and drives[finger] <= drives[other]
            and _pinned(hand, points, finger, other)
            for other in structure.fingers
        )

    kept = tuple(finger for finger in structure.fingers if not bar(finger))
    return replace(structure, fingers=kept)


def _drives_of(hand: HandModel, finger: Finger) -> frozenset[int]:
    """The actuated joints that move a finger."""
    rows = [hand.hand.moving_rows[name] for name in finger.joints]
    coupling = hand.hand.coupling[0][rows]
    return frozenset(coupling.any(0).nonzero()[0].tolist())


def _pinned(hand: HandModel, points: torch.Tensor, bar: Finger, finger: Finger) -> bool:
    own, other = (_points_of(hand, which.links) for which in (bar, finger))
    if not len(own) or not len(other):
        return False
    gaps = [float(KDTree(p[other].numpy()).query(p[own].numpy())[0].min()) for p in points]
    return max(gaps) < PINNED_M


def _points_of(hand: HandModel, links: tuple[str, ...]) -> torch.Tensor:
    wanted = torch.tensor([hand.link_names.index(name) for name in links])
    return torch.isin(hand.surface.link_index, wanted).nonzero()[:, 0]
