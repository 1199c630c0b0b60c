"""Where a hand starts: outside the object, its palm facing it, fingers open. No per-hand code."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.table import Table
from gdg.geometry.mesh import sample_surface
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration.table import raised
from gdg.rotations import q_from_pose, random_rotations

#: Share of the way from the open to the closed posture within which joints start.
LARGEST_CLOSURE = 0.5
#: Standard deviation of the noise on starting joints, as a share of their range.
JOINT_NOISE = 0.05
#: Near a table: points drawn per start, of those whose normals lie higher than this (sine).
TABLE_OVERSAMPLING, LOWEST_NORMAL = 6, -0.1


def random_joints(
    hand: HandModel, count: int, generator: torch.Generator
) -> Float[Tensor, "count joint"]:
    """Postures between open and half closed, a little noisy, within limits; rad or m."""
    closure = LARGEST_CLOSURE * torch.rand(count, 1, generator=generator).to(hand.device)
    noise = torch.randn(count, len(hand.joint_names), generator=generator).to(hand.device)
    joints = hand.open_posture + closure * (hand.closed_posture - hand.open_posture)
    joints = joints + JOINT_NOISE * noise * (hand.upper - hand.lower)
    return torch.maximum(torch.minimum(joints, hand.upper), hand.lower)


def facing(
    hand: HandModel,
    joints: Float[Tensor, "batch joint"],
    palm_centers: Float[Tensor, "batch 3"],
    rotations: Float[Tensor, "batch 3 3"],
) -> Float[Tensor, "batch dof"]:
    """q with the given root rotations and the palm's centre at the given points (metres)."""
    pose = torch.eye(4, device=hand.device).repeat(len(joints), 1, 1)
    pose[:, :3, :3] = rotations
    center, _ = hand.palm(q_from_pose(pose, joints))
    pose[:, :3, 3] = palm_centers - center
    return q_from_pose(pose, joints)


def around_sphere(
    hand: HandModel, obj: ObjectModel, count: int, generator: torch.Generator, factor: float = 1.0
) -> Float[Tensor, "count dof"]:
    """Starts with uniform root rotations and the palm on the object's enclosing sphere (paper).

    The palm's normal points at the object's centre; ``factor`` scales the sphere's radius. On a
    table the palm looks down or sideways: rotations that let it look up are mirrored.
    """
    rotations = random_rotations(count, generator).to(hand.device)
    joints = random_joints(hand, count, generator)
    normal = _palm_normal(hand, joints, rotations)
    if obj.table is None:
        return facing(hand, joints, -factor * obj.radius * normal, rotations)
    down = -_turned_up(-normal, obj.table)
    rotations = rotation_between(normal, down) @ rotations
    starts = facing(hand, joints, -factor * obj.radius * down, rotations)
    return raised(hand, obj.table, starts)


def above_surface(
    hand: HandModel,
    obj: ObjectModel,
    count: int,
    generator: torch.Generator,
    gap_m: tuple[float, float] = (0.02, 0.08),
    tilt_rad: float = 0.5,
) -> Float[Tensor, "count dof"]:
    """Starts with the palm above random points of the object's inflated convex hull.

    The palm faces the surface (as in DexGraspNet, Wang et al. 2023), tilted by a random angle of
    standard deviation ``tilt_rad``, rolled at random, ``gap_m`` (lower, upper) off the hull. On a
    table it stands above the sides and the top of the hull, and as high as the hand needs.
    """
    points, normals = _on_hull(hand, obj, count, generator)
    noise = torch.randn(count, 3, generator=generator).to(hand.device)
    outward = torch.nn.functional.normalize(normals + tilt_rad * 0.577 * noise, dim=-1)
    if obj.table is not None:
        outward = _turned_up(outward, obj.table)
    low, high = gap_m
    gap = low + (high - low) * torch.rand(count, 1, generator=generator).to(hand.device)
    joints = random_joints(hand, count, generator)
    rotations = random_rotations(count, generator).to(hand.device)
    turned = rotation_between(_palm_normal(hand, joints, rotations), -outward) @ rotations
    starts = facing(hand, joints, points + gap * normals, turned)
    return starts if obj.table is None else raised(hand, obj.table, starts)


def _on_hull(
    hand: HandModel, obj: ObjectModel, count: int, generator: torch.Generator
) -> tuple[Float[Tensor, "count 3"], Float[Tensor, "count 3"]]:
    """Random points of the object's convex hull and their normals, without those on a table."""
    seed = int(torch.randint(2**31, (1,), generator=generator))
    drawn = count if obj.table is None else TABLE_OVERSAMPLING * count
    points, normals = sample_surface(obj.mesh.convex_hull, drawn, seed)
    if obj.table is not None:
        # a body has no more surface below than above and around it, so some are always left
        seen = np.flatnonzero(normals @ obj.table.up > LOWEST_NORMAL)
        chosen = np.resize(seen, count)
        points, normals = points[chosen], normals[chosen]
    return (
        torch.as_tensor(points, dtype=torch.float32, device=hand.device),
        torch.as_tensor(normals, dtype=torch.float32, device=hand.device),
    )


def _turned_up(directions: Float[Tensor, "batch 3"], table: Table) -> Float[Tensor, "batch 3"]:
    """Unit vectors, those that point into the table mirrored at it."""
    up = torch.as_tensor(table.up).to(directions)
    return directions - 2 * (directions @ up).clamp(max=0.0)[:, None] * up


def rotation_between(
    source: Float[Tensor, "batch 3"], target: Float[Tensor, "batch 3"]
) -> Float[Tensor, "batch 3 3"]:
    """The rotation that turns unit vectors ``source`` to ``target`` about their common normal.

    Opposite vectors (to 1e-3 rad) are turned about an arbitrary perpendicular axis.
    """
    # two mirrors: the first turns source around, the second, halfway to target, onto target
    middle = source + target
    farthest_axis = torch.nn.functional.one_hot(source.abs().argmin(-1), 3).to(source)
    perpendicular = torch.linalg.cross(source, farthest_axis)
    opposite = middle.norm(dim=-1, keepdim=True) < 1e-3
    return _mirror(torch.where(opposite, perpendicular, middle)) @ _mirror(source)


def _mirror(direction: Float[Tensor, "batch 3"]) -> Float[Tensor, "batch 3 3"]:
    unit = torch.nn.functional.normalize(direction, dim=-1)
    return torch.eye(3, device=unit.device) - 2 * unit[:, :, None] * unit[:, None, :]


def _palm_normal(
    hand: HandModel, joints: Float[Tensor, "batch joint"], rotations: Float[Tensor, "batch 3 3"]
) -> Float[Tensor, "batch 3"]:
    pose = torch.eye(4, device=hand.device).repeat(len(joints), 1, 1)
    pose[:, :3, :3] = rotations
    return hand.palm(q_from_pose(pose, joints))[1]
