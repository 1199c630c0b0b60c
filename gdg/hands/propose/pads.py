"""Which side of each link is the inner one, and the contact regions there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from jaxtyping import Float

from gdg.hands.geometry import ConvexPart
from gdg.hands.propose.palm import PalmFace
from gdg.hands.propose.regions import Corners, inner_regions
from gdg.hands.propose.structure import Finger, Structure
from gdg.kinds.hand_model import HandModel

#: A link that closing moves less than this has no inner side, m/rad or m/m.
LEAST_SPEED = 1e-3
#: Step of the finite differences, as a share of the way from open to closed.
STEP = 1e-3
#: A link bends inward if it turns by this share of what its own joint does; pads that a linkage
#: keeps parallel don't turn at all.
BENDS = 0.3
#: Where between open and closed the hand is looked at.
HALFWAY = 0.5


@dataclass(frozen=True)
class _Inner:
    """Inner side of a link: outward direction and that of the phalanx, link frame."""

    outward: np.ndarray
    along: np.ndarray


def find_regions(
    hand: HandModel,
    structure: Structure,
    face: PalmFace,
    opened: Float[np.ndarray, "joint"],
    closed: Float[np.ndarray, "joint"],
) -> dict[str, list[Corners]]:
    """Link -> rectangles on its inner side; links without any are left out."""
    sides = {face.pad: _Inner(face.pad_outward, _flattest_axis(face.pad_outward))}
    for finger in structure.fingers:
        sides.update(_inner_sides(hand, finger, opened, closed))
    Ts_open = _poses(hand, opened)
    regions: dict[str, list[Corners]] = {}
    for link, inner in sides.items():
        parts = hand.hand.parts_of(link)
        if parts:
            others = _neighbours(hand, link, parts, Ts_open)
            found = inner_regions(parts, inner.outward, inner.along, others)
            if found:
                regions[link] = found
    return regions


def _flattest_axis(normal: np.ndarray) -> np.ndarray:
    """Of a link's axes the one that lies flattest in a surface."""
    return np.eye(3)[np.abs(normal).argmin()]


def _poses(hand: HandModel, joints: np.ndarray) -> np.ndarray:
    values = torch.as_tensor(joints, dtype=torch.float32)[None]
    return hand.link_poses_in_root(values)[0].double().numpy()


def _inner_sides(
    hand: HandModel,
    finger: Finger,
    opened: np.ndarray,
    closed: np.ndarray,
) -> dict[str, _Inner]:
    """Inner side of every link of a finger that closing moves.

    It is the side to which the link's own joint turns it. Where the whole mechanism moves the link
    another way, as in four-bar fingers whose pads stay parallel, that motion counts.
    """
    middle = opened + HALFWAY * (closed - opened)
    Ts, Ts_after = _poses(hand, middle), _poses(hand, middle + STEP * (closed - opened))
    names, joint_above = hand.link_names, hand.hand.urdf.joint_above
    sides = {}
    for link in finger.links:
        parts = hand.hand.parts_of(link)
        if not parts:
            continue
        number = names.index(link)
        T, center = Ts[number], _middle_of(parts)
        moved = (Ts_after[number] - T) @ np.append(center, 1.0) / STEP
        mover = joint_above[link]
        while mover.type == "fixed":
            mover = joint_above[mover.parent]
        moved = moved[:3] @ T[:3, :3]
        spin, origin = _own_turn(hand, mover.name, T, Ts, closed - opened)
        own, turned = np.cross(spin, center - origin), _turned(T, Ts_after[number]) / STEP
        if np.linalg.norm(moved) < LEAST_SPEED * np.abs(closed - opened).max():
            continue
        bends = own @ moved > 0 and turned @ spin > BENDS * spin @ spin
        outward = own if bends else moved
        sides[link] = _Inner(outward / np.linalg.norm(outward), center - origin)
    return sides


def _own_turn(
    hand: HandModel, mover: str, T_root_link: np.ndarray, Ts: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far a link's own joint turns it, and the joint's origin; link frame.

    The turn is a vector along the axis, radians per way from open to closed; zero for a joint that
    slides or stays.
    """
    joint = hand.hand.urdf.joints[mover]
    T_link_child = np.linalg.inv(T_root_link) @ Ts[hand.link_names.index(joint.child)]
    row = hand.hand.moving_rows[mover]
    angle = 0.0 if joint.type == "prismatic" else float(hand.hand.coupling[0][row] @ change)
    return angle * T_link_child[:3, :3] @ joint.axis, T_link_child[:3, 3]


def _turned(T_before: np.ndarray, T_after: np.ndarray) -> np.ndarray:
    """The small rotation from one pose to another as a vector in the first one's frame, radians."""
    difference = T_before[:3, :3].T @ T_after[:3, :3]
    return np.array([difference[2, 1], difference[0, 2], difference[1, 0]])


def _middle_of(parts: Sequence[ConvexPart]) -> np.ndarray:
    volumes = np.array([abs(float(part.mesh.volume)) for part in parts])
    centers = np.stack([part.mesh.bounds.mean(0) for part in parts])
    return volumes @ centers / volumes.sum()


def _neighbours(
    hand: HandModel, link: str, parts: Sequence[ConvexPart], Ts: np.ndarray
) -> list[ConvexPart]:
    """Shapes of other links that come near, moved into the link's frame."""
    low = np.min([part.mesh.bounds[0] for part in parts], axis=0)
    high = np.max([part.mesh.bounds[1] for part in parts], axis=0)
    T_link_root = np.linalg.inv(Ts[hand.link_names.index(link)])
    near = []
    for part in hand.hand.parts:
        if part.link == link:
            continue
        T = T_link_root @ Ts[hand.link_names.index(part.link)]
        vertices = trimesh.transform_points(part.mesh.vertices, T)
        if (vertices.min(0) < high).all() and (vertices.max(0) > low).all():
            mesh = trimesh.Trimesh(vertices, part.mesh.faces, process=False)
            near.append(ConvexPart(part.link, part.kind, part.size, T @ part.T_link_part, mesh))
    return near
