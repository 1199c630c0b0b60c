"""Conversions between the optimiser's pose vector and 4×4 poses.

q is (translation 3 in metres, rot6d 6, joints N): rot6d holds the first two *rows* of the
rotation matrix. Published datasets store columns (``gdg.data.layouts.rotations``).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

#: Length of the root part of q: translation 3 + rot6d 6.
ROOT_DIM = 9


def rotation_from_rot6d(rot6d: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrix whose first two rows are the orthonormalised halves of ``rot6d``.

    Gram-Schmidt as in Zhou et al. 2019; the two halves must not be parallel or zero.
    """
    first = torch.nn.functional.normalize(rot6d[..., :3], dim=-1)
    second = rot6d[..., 3:] - (first * rot6d[..., 3:]).sum(-1, keepdim=True) * first
    second = torch.nn.functional.normalize(second, dim=-1)
    third = torch.linalg.cross(first, second)
    return torch.stack((first, second, third), dim=-2)


def rot6d_from_rotation(rotation: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 6"]:
    """The first two rows of a rotation matrix, concatenated."""
    return torch.cat((rotation[..., 0, :], rotation[..., 1, :]), dim=-1)


def root_pose(q: Float[Tensor, "*batch dof"]) -> Float[Tensor, "*batch 4 4"]:
    """T_world_root of pose vectors: the first nine entries of q."""
    pose = torch.zeros((*q.shape[:-1], 4, 4), dtype=q.dtype, device=q.device)
    pose[..., :3, :3] = rotation_from_rot6d(q[..., 3:ROOT_DIM])
    pose[..., :3, 3] = q[..., :3]
    pose[..., 3, 3] = 1.0
    return pose


def q_from_pose(
    pose: Float[Tensor, "*batch 4 4"], joints: Float[Tensor, "*batch joint"]
) -> Float[Tensor, "*batch dof"]:
    """Pose vectors from root poses and joint values (rad or m, declared order)."""
    return torch.cat((pose[..., :3, 3], rot6d_from_rotation(pose[..., :3, :3]), joints), dim=-1)


def random_rotations(count: int, generator: torch.Generator) -> Float[Tensor, "count 3 3"]:
    """Rotations uniform over SO(3), from normalised Gaussian quaternions."""
    quat_wxyz = torch.nn.functional.normalize(torch.randn(count, 4, generator=generator), dim=-1)
    return rotation_from_quaternion(quat_wxyz)


def rotation_from_quaternion(quat_wxyz: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrices of unit quaternions, wxyz."""
    w, x, y, z = quat_wxyz.unbind(-1)
    rows = (
        torch.stack((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)), -1),
        torch.stack((2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)), -1),
        torch.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), -1),
    )
    return torch.stack(rows, dim=-2)
