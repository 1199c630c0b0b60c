"""Poses and shapes, in few words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdg.hands.urdf import Shape

Vector = Sequence[float] | np.ndarray


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """The pose at a point, axes as the parent's."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def facing(z: Vector, x: Vector, point: Vector) -> np.ndarray:
    """The pose whose z axis has direction ``z`` and whose x axis is ``x`` made orthogonal to it."""
    z_axis = np.array(z, float) / np.linalg.norm(z)
    x_axis = np.array(x, float) - np.dot(x, z_axis) * z_axis
    x_axis /= np.linalg.norm(x_axis)
    pose = at(*point)
    pose[:3, :3] = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)
    return pose


def box(x: float, y: float, z: float, pose: np.ndarray | None = None) -> Shape:
    """A box by its edges, its centre at ``pose``."""
    return Shape("box", (x, y, z), at() if pose is None else pose)


def cylinder(radius: float, length: float, pose: np.ndarray | None = None) -> Shape:
    """A cylinder along the z axis of ``pose``, its centre there."""
    return Shape("cylinder", (radius, length), at() if pose is None else pose)


def sphere(radius: float, pose: np.ndarray) -> Shape:
    """A sphere by its radius."""
    return Shape("sphere", (radius,), pose)


def crosswise(radius: float, length: float, z: float = 0.0) -> Shape:
    """A cylinder along y, as a hinge or motor has it."""
    return cylinder(radius, length, facing((0, 1, 0), (1, 0, 0), (0, 0, z)))
