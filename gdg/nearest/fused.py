"""Exhaustive search as one kernel that torch's compiler generates; for GPUs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec

import torch
from jaxtyping import Float, Int
from torch import Tensor

#: GPUs older than this are refused by Triton.
CAPABILITY = (7, 0)


@cache
def can_fuse(device: torch.device) -> bool:
    """Whether torch's compiler has what it generates kernels with: Triton, and a C compiler."""
    return (
        device.type == "cuda"
        and torch.cuda.get_device_capability(device) >= CAPABILITY
        and find_spec("triton") is not None
        and any(map(shutil.which, (os.environ.get("CC", "cc"), "gcc", "clang")))
    )


def nearest_fused(
    object_points: Float[Tensor, "object_point 3"],
    object_normals: Float[Tensor, "object_point 3"],
    hand_points: Float[Tensor, "batch hand_point 3"],
    gamma: float,
    epsilon: float,
) -> Int[Tensor, "batch object_point"]:
    """See ``gdg.nearest.nearest_hand_points``.

    Scores are reduced where they are computed: no pair is written to memory. The first call
    compiles (seconds; torch keeps the kernel on disk).
    """
    clouds = (object_points, object_normals, hand_points)
    # what is laid out alike needs no kernel of its own
    return _compiled()(*(cloud.contiguous() for cloud in clouds), float(gamma), epsilon)


@cache
def _compiled() -> Callable[..., Tensor]:
    return torch.compile(_nearest, dynamic=True)


def _nearest(
    points: Tensor, normals: Tensor, hands: Tensor, gamma: float, epsilon: float
) -> Tensor:
    x, y, z = (hands[:, None, :, axis] - points[:, axis, None] for axis in range(3))
    along = x * normals[:, 0, None] + y * normals[:, 1, None] + z * normals[:, 2, None]
    length = (x * x + y * y + z * z).clamp(min=1e-30).sqrt()
    return (length.log() - 2 * gamma * along / (length + epsilon)).argmin(-1)
