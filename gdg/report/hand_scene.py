"""What a picture of a hand by itself shows: its parts, contact regions, palm and root frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import trimesh

from gdg.hands.hand import Hand
from gdg.kinds.hand_model import HandModel
from gdg.report.markers import arrow_mesh, frame_axes, region_patch
from gdg.report.meshes import PictureMesh, part_meshes
from gdg.report.palette import AXES, CHAINS, HAND, OBJECT_PLAIN, PALM_ARROW, PALM_REGIONS
from gdg.report.views import Points, best_views

#: The palm's arrow and the root's axes, as shares of the reach from palm to farthest fingertip.
ARROW_SHARE, AXES_SHARE = 0.5, 0.25
#: What is farther from the palm than this share of the reach (a forearm) may be cut off.
NEAR_SHARE = 1.1
#: Fingers within this angle of the palm's normal grow out of the palm as from a gripper's base.
GRIPPER_ANGLE_DEG = 40.0
#: A region counts as seen from where its normal and the direction to the eye have at least this
#: cosine; two views differ by at least the angle of the other one.
MIN_FACING, MAX_SAME_VIEW = 0.3, 0.7
#: The upward direction snaps to an axis of the root link within this angle.
SNAP_ANGLE_DEG = 25.0

Rgb = tuple[int, int, int]


@dataclass(frozen=True)
class Chain:
    """A finger: all links beyond one joint of the palm; or the palm's own rigid body.

    Attributes:
        name: its first link, or ``palm``.
        links: indices of its links.
        color: of its contact regions.
        regions: how many contact regions it has.
    """

    name: str
    links: tuple[int, ...]
    color: Rgb
    regions: int


@dataclass(frozen=True)
class Item:
    """A mesh that moves with a link.

    Attributes:
        role: ``hand``, ``region``, ``palm`` or ``root``.
        link: index of the link that it is fixed to.
        mesh: in the link's frame, metres.
        color: 8-bit sRGB.
    """

    role: str
    link: int
    mesh: PictureMesh
    color: Rgb


@dataclass(frozen=True)
class HandScene:
    """A hand ready to be drawn; the picture frame has its origin at the root link's, z upward.

    Attributes:
        items: meshes in the frames of their links.
        chains: fingers, in the order of the tree.
        T_picture_root: rotation by which the fingers point upward.
        postures: name -> (link, 4, 4) poses in the picture frame, metres.
        eyes: (2, 3) unit vectors towards the eyes of two views.
        near: (n, 3) points of palm and fingers in either posture, picture frame, metres.
        whole: (n, 3) points of the whole hand (a forearm, too) and of the markers.
    """

    items: tuple[Item, ...]
    chains: tuple[Chain, ...]
    T_picture_root: np.ndarray
    postures: dict[str, np.ndarray]
    eyes: np.ndarray
    near: np.ndarray
    whole: np.ndarray


def build_hand_scene(model: HandModel) -> HandScene:
    """The scene of a hand's open and closed posture."""
    hand, chains = model.hand, finger_chains(model.hand)
    T_picture_root = _upright(model)
    joints = torch.stack((model.open_posture, model.closed_posture))
    with torch.no_grad():
        found = model.link_poses_in_root(joints).double().cpu().numpy()
    opened, closed = T_picture_root @ found
    points = np.concatenate([_placed(hand, poses) for poses in (opened, closed)])
    center, reach = _palm_center(hand, opened), _reach(hand, opened)
    arrow, axes = _palm_items(hand, ARROW_SHARE * reach), _root_items(hand, AXES_SHARE * reach)
    ends = np.concatenate([_corners(item, opened) for item in arrow])
    near = np.linalg.norm(points - center, axis=-1) < NEAR_SHARE * reach
    return HandScene(
        items=_hand_items(hand) + _region_items(hand, chains) + arrow + axes,
        chains=chains,
        T_picture_root=T_picture_root,
        postures={"open": opened, "closed": closed},
        eyes=_eyes(model, opened),
        near=np.concatenate((points[near], ends)),
        whole=np.concatenate((points, ends, *(_corners(item, opened) for item in axes))),
    )


def finger_chains(hand: Hand) -> tuple[Chain, ...]:
    """The palm's body and each branch beyond it; what lies before the palm is left out."""
    names, bodies = hand.link_names, hand.bodies
    palm = bodies[names.index(hand.spec.palm.link)]
    first: dict[str, str] = {}
    for joint in hand.urdf.joints.values():  # parents come before children
        if joint.parent in first:
            first[joint.child] = first[joint.parent]
        elif bodies[names.index(joint.parent)] == palm != bodies[names.index(joint.child)]:
            first[joint.child] = joint.child
    own = [name for name in names if bodies[names.index(name)] == palm]
    groups = {"palm": own} | {
        root: [link for link, start in first.items() if start == root]
        for root in dict.fromkeys(first.values())
    }
    listed = hand.spec.contact_regions
    return tuple(
        Chain(
            name,
            tuple(names.index(link) for link in links),
            PALM_REGIONS if number == 0 else CHAINS[(number - 1) % len(CHAINS)],
            sum(len(listed.get(link, ())) for link in links),
        )
        for number, (name, links) in enumerate(groups.items())
    )


def _hand_items(hand: Hand) -> tuple[Item, ...]:
    meshes = part_meshes(hand)
    palm = hand.link_names.index(hand.spec.palm.link)
    return tuple(
        Item("hand", link, mesh, OBJECT_PLAIN if hand.bodies[link] == hand.bodies[palm] else HAND)
        for link, mesh in meshes.items()
    )


def _region_items(hand: Hand, chains: tuple[Chain, ...]) -> tuple[Item, ...]:
    color = {link: chain.color for chain in chains for link in chain.links}
    items = []
    for link, regions in hand.spec.contact_regions.items():
        index, parts = hand.link_names.index(link), hand.parts_of(link)
        items += [
            Item("region", index, region_patch(np.array(r), parts), color.get(index, PALM_REGIONS))
            for r in regions
        ]
    return tuple(items)


def _palm_items(hand: Hand, length: float) -> tuple[Item, ...]:
    palm = hand.spec.palm
    mesh = arrow_mesh(np.array(palm.center), np.array(palm.normal), length)
    return (Item("palm", hand.link_names.index(palm.link), mesh, PALM_ARROW),)


def _root_items(hand: Hand, length: float) -> tuple[Item, ...]:
    root = hand.link_names.index(hand.urdf.root)
    return tuple(
        Item("root", root, mesh, color)
        for mesh, color in zip(frame_axes(length), AXES, strict=True)
    )


def _placed(hand: Hand, poses: np.ndarray) -> np.ndarray:
    """Vertices of all parts in given poses, (n, 3)."""
    placed = [
        trimesh.transform_points(part.mesh.vertices, poses[hand.link_names.index(part.link)])
        for part in hand.parts
    ]
    return np.concatenate(placed)


def _corners(item: Item, poses: np.ndarray) -> np.ndarray:
    return trimesh.transform_points(item.mesh.vertices, poses[item.link])


def _palm_center(hand: Hand, poses: np.ndarray) -> np.ndarray:
    palm = hand.spec.palm
    pose = poses[hand.link_names.index(palm.link)]
    return pose[:3, :3] @ np.array(palm.center) + pose[:3, 3]


def _fingertips(hand: Hand, poses: np.ndarray) -> np.ndarray:
    """Of each finger the point farthest from the palm's centre, (finger, 3)."""
    center, tips = _palm_center(hand, poses), []
    for chain in finger_chains(hand)[1:]:
        placed = [
            trimesh.transform_points(part.mesh.vertices, poses[index])
            for part in hand.parts
            if (index := hand.link_names.index(part.link)) in chain.links
        ]
        if placed:
            points = np.concatenate(placed)
            tips.append(points[np.linalg.norm(points - center, axis=-1).argmax()])
    return np.array(tips).reshape(-1, 3)


def _reach(hand: Hand, poses: np.ndarray) -> float:
    """From the palm's centre to the farthest fingertip, or vertex if there are no fingers."""
    tips = _fingertips(hand, poses)
    tips = tips if len(tips) else _placed(hand, poses)
    return float(np.linalg.norm(tips - _palm_center(hand, poses), axis=-1).max())


def _upright(model: HandModel) -> np.ndarray:
    """T_picture_root: the fingers point up, or the palm does where they grow along its normal."""
    hand = model.hand
    with torch.no_grad():
        poses = model.link_poses_in_root(model.open_posture[None])[0].double().cpu().numpy()
    normal = poses[hand.link_names.index(hand.spec.palm.link), :3, :3] @ hand.spec.palm.normal
    tips = _fingertips(hand, poses)
    toward = tips.mean(0) - _palm_center(hand, poses) if len(tips) else normal
    along = toward @ normal / max(float(np.linalg.norm(toward)), 1e-9)
    is_gripper = along > np.cos(np.radians(GRIPPER_ANGLE_DEG))
    up = normal if is_gripper else _snapped(toward - (toward @ normal) * normal, normal)
    T_picture_root = np.eye(4)
    T_picture_root[:3, :3] = _rows(up, normal)
    return T_picture_root


def _snapped(up: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The axis of the root link nearest to ``up``, if near and at right angles to the normal."""
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    best = axes[int((axes @ up).argmax())]
    near = best @ up > np.cos(np.radians(SNAP_ANGLE_DEG)) and abs(best @ normal) < 0.1
    return best if near else up


def _rows(up: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Rotation whose z row is ``up`` and whose x row is near ``front``."""
    z = up / np.linalg.norm(up)
    candidates = (front, *np.eye(3))
    x = next(c - (c @ z) * z for c in candidates if np.linalg.norm(c - (c @ z) * z) > 0.5)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(z, x), z))


def _eyes(model: HandModel, poses: np.ndarray) -> np.ndarray:
    """A view of most contact regions, and one of those that it hides; unit vectors, (2, 3)."""
    placed = torch.as_tensor(poses[None], dtype=torch.float32, device=model.device)
    surface, regions = model.surface, model.regions
    normals = model.turn(placed, surface.normals, surface.link_index)
    hand = Points(*(_array(v[0]) for v in (model.place_surface(placed), normals)))
    palm = model.hand.spec.palm
    direction = poses[model.link_names.index(palm.link), :3, :3] @ np.array(palm.normal)
    if len(regions.normals) == 0:
        return best_views(hand, hand, np.ones(len(hand.positions)), direction)
    middles = model.place(placed, regions.corners.mean(1), regions.link_index)
    facing = model.turn(placed, regions.normals, regions.link_index)
    spots = Points(*(_array(v[0]) for v in (middles, facing)))
    areas = np.linalg.norm(_array(_across(regions.corners)), axis=-1)
    first, second = best_views(spots, hand, areas, direction)
    hidden = areas * (spots.normals @ first < MIN_FACING)
    if hidden.sum() > 0:
        others = best_views(spots, hand, hidden, direction)
        second = next((eye for eye in others if eye @ first < MAX_SAME_VIEW), second)
    return np.stack((first, second))


def _across(corners: torch.Tensor) -> torch.Tensor:
    """Cross products of the diagonals of (region, 4, 3) corners."""
    return torch.linalg.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])


def _array(values: torch.Tensor) -> np.ndarray:
    return values.detach().cpu().double().numpy()
