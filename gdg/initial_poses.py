"""Where a hand starts: outside the object, its palm facing it, fingers open. No per-hand code."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.geometry.mesh import sample_surface
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import q_from_pose, random_rotations

#: Share of the way from the open to the closed posture within which joints start.
LARGEST_CLOSURE = 0.5
#: Standard deviation of the noise on starting joints, as a share of their range.
JOINT_NOISE = 0.05


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

    The palm's normal points at the object's centre; ``factor`` scales the sphere's radius.
    """
    rotations = random_rotations(count, generator).to(hand.device)
    joints = random_joints(hand, count, generator)
    normal = _palm_normal(hand, joints, rotations)
    return facing(hand, joints, -factor * obj.radius * normal, rotations)


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
    standard deviation ``tilt_rad``, rolled at random, ``gap_m`` (lower, upper) off the hull.
    """
    hull = obj.mesh.convex_hull
    seed = int(torch.randint(2**31, (1,), generator=generator))
    points, normals = (
        torch.as_tensor(a, dtype=torch.float32, device=hand.device)
        for a in sample_surface(hull, count, seed)
    )
    noise = torch.randn(count, 3, generator=generator).to(hand.device)
    outward = torch.nn.functional.normalize(normals + tilt_rad * 0.577 * noise, dim=-1)
    low, high = gap_m
    gap = low + (high - low) * torch.rand(count, 1, generator=generator).to(hand.device)
    joints = random_joints(hand, count, generator)
    rotations = random_rotations(count, generator).to(hand.device)
    turned = rotation_between(_palm_normal(hand, joints, rotations), -outward) @ rotations
    return facing(hand, joints, points + gap * normals, turned)


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
