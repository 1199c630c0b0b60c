"""Hand folders made by ``gdg hands new``'s code, and what their manifests say, told in the root."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import trimesh
from kinematics import link_poses

from gdg.hands.create import NewHand, create_hand
from gdg.hands.geometry import ConvexPart, link_parts
from gdg.hands.hand import Hand
from gdg.hands.spec import HandSpec, Palm, Provenance
from gdg.hands.urdf import read_urdf
from gdg.kinds.hand_model import HandModel
from gdg.testing.fixtures import model_of

#: As many surface points as the command line uses.
POINTS = 1000


def propose_hand(source: Path, folder: Path) -> NewHand:
    """The hand folder ``folder`` made from a bare description; its name is the folder's."""
    return create_hand(source, folder, folder.name, lambda hand: model_of(hand, POINTS))


def draft_model(urdf_path: Path, palm: str | None = None, points: int = POINTS) -> HandModel:
    """The model of a description of which nothing is decided: the palm is the root if not given."""
    urdf = read_urdf(urdf_path)
    shaped = any(link.collisions for link in urdf.links.values())
    geometry = "collision" if shaped else "visual"
    moving = [joint for joint in urdf.joints.values() if joint.type != "fixed"]
    spec = HandSpec(
        name="draft",
        urdf=urdf_path.name,
        geometry=geometry,
        root_link=urdf.root,
        palm=Palm(link=palm or urdf.root, normal=(0, 0, 1), center=(0, 0, 0)),
        joints=tuple(joint.name for joint in moving if joint.mimic is None),
        contact_regions={},
        provenance=Provenance(source="made for a test", licence="none"),
    )
    parts = link_parts(urdf, urdf_path.parent, geometry)
    return model_of(Hand(urdf_path.parent, spec, urdf, parts, content_hash=""), points)


def box_part(
    size: tuple[float, float, float],
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
    link: str = "link",
) -> ConvexPart:
    """A box of a link, its edges along the axes, metres."""
    T = trimesh.transformations.translation_matrix(center)
    return ConvexPart(link, "box", size, T, trimesh.creation.box(size, T))


def hull_part(mesh: trimesh.Trimesh, link: str = "link") -> ConvexPart:
    """A convex mesh as part of a link."""
    return ConvexPart(link, "hull", (), np.eye(4), mesh)


def palm_normal_in_root(hand: Hand) -> np.ndarray:
    """The palm's outward normal in the root's frame, all joints at zero."""
    palm = hand.spec.palm
    return link_poses(hand.urdf, {})[palm.link][:3, :3] @ palm.normal


def closing_signs(hand: Hand) -> dict[str, int]:
    """Moving joint -> which way it goes from open to closed, mimic joints included."""
    change = hand.coupling[0] @ (hand.posture("closed") - hand.posture("open"))
    names = [joint.name for joint in hand.moving_joints]
    return {name: int(np.sign(value)) for name, value in zip(names, np.round(change, 3))}


def closing_motions(hand: Hand, links: Iterable[str]) -> dict[str, float]:
    """Link -> how far its middle is moved from the open to the closed posture, metres."""
    matrix, offset = hand.coupling
    names = [joint.name for joint in hand.moving_joints]
    opened, closed = (
        link_poses(hand.urdf, dict(zip(names, matrix @ hand.posture(which) + offset)))
        for which in ("open", "closed")
    )
    motions = {}
    for link in links:
        boxes = [part.mesh.bounds.mean(0) for part in hand.parts if part.link == link]
        middle = np.append(np.mean(boxes, axis=0), 1.0)
        motions[link] = float(np.linalg.norm((closed[link] - opened[link]) @ middle))
    return motions


def normal_of(corners: object) -> np.ndarray:
    """Outward unit normal of four corners that run counter-clockwise seen from outside."""
    a, b, c, d = np.array(corners)
    across = np.cross(c - a, d - b)
    return across / np.linalg.norm(across)


def region_normals(hand: Hand, link: str) -> list[np.ndarray]:
    """Outward unit normals of a link's contact regions, link frame."""
    return [normal_of(corners) for corners in hand.spec.contact_regions.get(link, [])]


def grid_on(corners: object, steps: int = 9) -> np.ndarray:
    """Points all over a quadrilateral, (point, 3)."""
    a, b, c, d = np.array(corners)
    u, v = (t.ravel()[:, None] for t in np.meshgrid(*[np.linspace(0, 1, steps)] * 2))
    return (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c)


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two vectors."""
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
