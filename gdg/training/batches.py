"""What a training step gets: items of one kind, stacked. Everything is in the object frame."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor


class MapBatch(NamedTuple):
    """Contact maps of any hands on any objects.

    Attributes:
        points: points on the objects' surfaces, metres.
        values: contact values at the points, in [0, 1].
        normals: outward unit normals at the points.
    """

    points: Float[Tensor, "batch object_point 3"]
    values: Float[Tensor, "batch object_point"]
    normals: Float[Tensor, "batch object_point 3"]


class GraspBatch(NamedTuple):
    """Grasps of one hand, with the contact maps that they make.

    Attributes:
        points: points on the objects' surfaces, metres.
        normals: outward unit normals at the points.
        values: contact values at the points, in [0, 1].
        q: translation 3 (metres), rot6d 6 (``gdg.rotations``) and the joints in the hand's
            declared order (rad or m).
    """

    points: Float[Tensor, "batch object_point 3"]
    normals: Float[Tensor, "batch object_point 3"]
    values: Float[Tensor, "batch object_point"]
    q: Float[Tensor, "batch dof"]


AnyBatch = MapBatch | GraspBatch
