"""Augmentation: training items seen from elsewhere, in part, at other sizes, with noise.

It runs on the device of the batch. One generator decides everything, so that the same step of the
same run varies its items in the same way.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.rotations import (
    ROOT_DIM,
    rot6d_from_rotation,
    rotation_from_quaternion,
    rotation_from_rot6d,
)
from gdg.training.batches import AnyBatch, GraspBatch
from gdg.training.job import AugmentOptions

#: Cells along the longest side of the picture that decides which points hide others.
CELLS = 20
#: A point is hidden by one in the same cell that lies nearer by more than this many cells; so
#: surface that is seen at less than about 18 degrees may be taken as hidden.
DEPTH_CELLS = 3.0

Points = Float[Tensor, "batch object_point 3"]


def augmented(batch: AnyBatch, options: AugmentOptions, generator: torch.Generator) -> AnyBatch:
    """A batch of varied items.

    Args:
        batch: maps or grasps; grasps must not be scaled, since no joint angles fit another size.
        options: what to vary.
        generator: on the batch's device.
    """
    if options.partial:
        batch = _partly_seen(batch, options.partial, generator)
    if options.scale != (1.0, 1.0):
        assert not isinstance(batch, GraspBatch), "grasps can't be scaled"
        batch = batch._replace(points=batch.points * _factors(batch, options.scale, generator))
    if options.rotation != "none":
        batch = turned(batch, _rotations(batch, options.rotation, generator))
    if options.jitter_m:
        noise = _normal(batch.points, batch.points.shape, generator)
        batch = batch._replace(points=batch.points + options.jitter_m * noise)
    return batch


def turned(batch: AnyBatch, rotations: Float[Tensor, "batch 3 3"]) -> AnyBatch:
    """Each item turned about the object frame's origin; contact values stay what they are."""
    across = rotations.transpose(1, 2)
    batch = batch._replace(points=batch.points @ across, normals=batch.normals @ across)
    if not isinstance(batch, GraspBatch):
        return batch
    translation, rot6d, joints = batch.q.split((3, ROOT_DIM - 3, batch.q.shape[1] - ROOT_DIM), 1)
    moved = (rotations @ translation[..., None])[..., 0]
    root = rot6d_from_rotation(rotations @ rotation_from_rot6d(rot6d))
    return batch._replace(q=torch.cat((moved, root, joints), dim=1))


def seen_from(
    points: Points, normals: Points, directions: Float[Tensor, "batch 3"]
) -> Bool[Tensor, "batch object_point"]:
    """Which points an orthographic camera sees: they face it, and no point hides them.

    Points hide each other in a picture of ``CELLS`` cells along the objects' longest side, which
    is coarse enough that 2048 points leave no holes to look through.

    Args:
        points: metres.
        normals: outward.
        directions: unit vectors from the object toward the camera.
    """
    facing = (normals @ directions[..., None])[..., 0] > 0
    depth = (points @ directions[..., None])[..., 0]
    right, up = _picture_axes(directions)
    flat = torch.stack(((points * right[:, None]).sum(-1), (points * up[:, None]).sum(-1)), -1)
    corner = flat.amin(1, keepdim=True)
    size = (flat.amax(1, keepdim=True) - corner).amax(-1, keepdim=True).clamp(min=1e-6) / CELLS
    column = ((flat - corner) / size).floor().long().clamp(0, CELLS - 1)
    cell = column[..., 0] * CELLS + column[..., 1]
    nearest = torch.full((len(points), CELLS * CELLS), -torch.inf, device=points.device)
    in_front = depth.masked_fill(~facing, -torch.inf)
    nearest = nearest.scatter_reduce(1, cell, in_front, reduce="amax")
    return facing & (depth >= nearest.gather(1, cell) - DEPTH_CELLS * size[..., 0])


def _partly_seen(batch: AnyBatch, share: float, generator: torch.Generator) -> AnyBatch:
    """Some items with hidden points replaced by copies of visible ones, equally often each."""
    points = batch.points
    directions = torch.nn.functional.normalize(_normal(points, (len(points), 3), generator), dim=-1)
    whole = torch.rand(len(points), generator=generator, device=points.device) >= share
    seen = seen_from(points, batch.normals, directions)
    seen |= whole[:, None] | ~seen.any(1, keepdim=True)
    first = seen.int().argsort(dim=1, descending=True, stable=True)
    places = torch.arange(points.shape[1], device=points.device) % seen.sum(1, keepdim=True)
    chosen = first.gather(1, places)
    in_space = chosen[..., None].expand(-1, -1, 3)
    return batch._replace(
        points=points.gather(1, in_space),
        normals=batch.normals.gather(1, in_space),
        values=batch.values.gather(1, chosen),
    )


def _picture_axes(
    directions: Float[Tensor, "batch 3"],
) -> tuple[Float[Tensor, "batch 3"], Float[Tensor, "batch 3"]]:
    """Unit vectors to the right and up in the pictures of cameras in these directions."""
    # the axis that is least along the direction is surely not parallel to it
    least = torch.nn.functional.one_hot(directions.abs().argmin(-1), 3).to(directions)
    right = torch.nn.functional.normalize(torch.linalg.cross(least, directions), dim=-1)
    return right, torch.linalg.cross(directions, right)


def _factors(
    batch: AnyBatch, span: tuple[float, float], generator: torch.Generator
) -> Float[Tensor, "batch 1 1"]:
    drawn = torch.rand(len(batch.points), 1, 1, generator=generator, device=batch.points.device)
    return span[0] + (span[1] - span[0]) * drawn


def _rotations(
    batch: AnyBatch, about: str, generator: torch.Generator
) -> Float[Tensor, "batch 3 3"]:
    """Uniform over all rotations, or over those about the z axis."""
    quat_wxyz = _normal(batch.points, (len(batch.points), 4), generator)
    if about == "yaw":
        quat_wxyz = quat_wxyz * quat_wxyz.new_tensor((1.0, 0.0, 0.0, 1.0))
    return rotation_from_quaternion(torch.nn.functional.normalize(quat_wxyz, dim=-1))


def _normal(like: Tensor, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    return torch.randn(shape, generator=generator, device=like.device, dtype=like.dtype)
