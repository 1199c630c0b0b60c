"""Hand folders made by ``gdg hands new``'s code, and what their manifests say, told in the root."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from kinematics import link_poses

from gdg.hands.create import NewHand, create_hand
from gdg.hands.hand import Hand
from gdg.testing.fixtures import model_of

#: As many surface points as the command line uses.
POINTS = 1000


def propose_hand(source: Path, folder: Path, **options: object) -> NewHand:
    """The hand folder ``folder`` made from a bare description; its name is the folder's."""
    return create_hand(
        source, folder, folder.name, lambda hand: model_of(hand, POINTS), **options
    )  # fmt: skip


def palm_normal_in_root(hand: Hand) -> np.ndarray:
    """The palm's outward normal in the root's frame, all joints at zero."""
    palm = hand.spec.palm
    return link_poses(hand.urdf, {})[palm.link][:3, :3] @ palm.normal


def closing_signs(hand: Hand) -> dict[str, int]:
    """Moving joint -> which way it goes from open to closed, mimic joints included."""
    change = hand.coupling[0] @ (hand.posture("closed") - hand.posture("open"))
    names = [joint.name for joint in hand.moving_joints]
    return {name: int(np.sign(value)) for name, value in zip(names, np.round(change, 3))}


def region_normals(hand: Hand, link: str) -> list[np.ndarray]:
    """Outward unit normals of a link's contact regions, link frame."""
    normals = []
    for corners in map(np.array, hand.spec.contact_regions.get(link, [])):
        across = np.cross(corners[2] - corners[0], corners[3] - corners[1])
        normals.append(across / np.linalg.norm(across))
    return normals


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two vectors."""
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
