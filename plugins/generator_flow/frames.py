"""A frame of an object's own, in which the network sees it, however the object was placed.

Grasps of a free object don't depend on where it lies, so neither shall its contact maps. Rotations
need not be learned then: the axes are the principal axes of the surface, up to half turns, which
are drawn. For round and cubic things principal axes mean little and change with the least change
of shape; therefore they are taken from a small random sample of the points, which leaves the axes
of long things nearly as they are and turns those of round things anywhere.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

#: Points whose principal axes are taken.
SAMPLE = 48

Vectors = Float[Tensor, "object object_point 3"]


def in_own_frames(
    points: Vectors, normals: Vectors, generator: torch.Generator
) -> tuple[Vectors, Vectors]:
    """Points and normals in a drawn frame of each object, in full precision."""
    with torch.autocast(points.device.type, enabled=False):
        center, axes = draw_frames(points, generator)
        return (points - center) @ axes, normals @ axes


def draw_frames(
    points: Vectors, generator: torch.Generator
) -> tuple[Float[Tensor, "object 1 3"], Float[Tensor, "object 3 3"]]:
    """Origin and axes of a frame for each object.

    The same generator state gives, for an object that was moved, frames that moved with it.

    Args:
        points: metres.
        generator: which points are sampled and which half turns are made.

    Returns:
        The points' mean, and the axes as columns: right-handed, longest first.
    """
    objects, count, _ = points.shape
    center = points.mean(1, keepdim=True)
    rank = torch.rand(objects, count, generator=generator, device=generator.device)
    # two spare half turns per object, drawn always, so that later draws don't depend on them
    half_turns = torch.rand(objects, 2, generator=generator, device=generator.device) < 0.5
    chosen = rank.argsort(1)[:, :SAMPLE].to(points.device)
    sample = points.gather(1, chosen[..., None].expand(-1, -1, 3)).double()
    sample = sample - sample.mean(1, keepdim=True)
    _, vectors = torch.linalg.eigh(sample.mT @ sample)
    first, second = vectors[..., 2], vectors[..., 1]
    signs = 1.0 - 2.0 * half_turns.to(points.device, torch.float64)
    first = _toward_the_skew(first, points - center) * signs[:, :1]
    second = _toward_the_skew(second, points - center) * signs[:, 1:]
    axes = torch.stack((first, second, torch.linalg.cross(first, second)), dim=-1)
    return center, axes.to(points.dtype)


def _toward_the_skew(
    axis: Float[Tensor, "object 3"], centered: Vectors
) -> Float[Tensor, "object 3"]:
    """The axis or its opposite: toward where the surface reaches farther out."""
    along = (centered.double() @ axis[..., None])[..., 0]
    skew = along.pow(3).sum(1, keepdim=True)
    return torch.where(skew < 0, -axis, axis)
