"""Surfaces and poses of a description that is not written yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import trimesh

from gdg.hands.geometry import shape_mesh
from gdg.hands.intake.description import Description
from gdg.hands.urdf import Shape, Urdf

#: Spheres are this coarse (see ``shape_mesh``): only volumes and extents are taken.
SPHERE_LEVEL = 2
#: A flat surface is taken to be this thick, metres.
THINNEST_M = 1e-3


def surface(description: Description, shape: Shape) -> trimesh.Trimesh:
    """A shape's surface in the link's frame, metres."""
    return shape_mesh(shape, lambda: description.meshes[shape.mesh].mesh.copy(), SPHERE_LEVEL)


def solid(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A closed surface for mass properties: the mesh itself, its hull, or its box."""
    if mesh.is_volume:
        return mesh
    try:
        hull = mesh.convex_hull
        if hull.is_volume:
            return hull
    except (ValueError, RuntimeError):  # scipy's QhullError is a RuntimeError: a flat mesh
        pass
    box = trimesh.creation.box(np.maximum(mesh.extents, THINNEST_M))
    return box.apply_translation(mesh.bounds.mean(0))


def zero_poses(urdf: Urdf) -> dict[str, np.ndarray]:
    """Link -> ``T_root_link`` with all joints at zero."""
    poses = {urdf.root: np.eye(4)}
    for joint in urdf.joints.values():
        poses[joint.child] = poses[joint.parent] @ joint.T_parent_child
    return poses


def bodies(urdf: Urdf) -> dict[str, str]:
    """Link -> the link at the root of its rigid body (links joined by fixed joints share one)."""
    body = {urdf.root: urdf.root}
    for joint in urdf.joints.values():
        body[joint.child] = body[joint.parent] if joint.type == "fixed" else joint.child
    return body


def extents(description: Description, role: str) -> np.ndarray:
    """Side lengths of the box around the shapes of a role with all joints at zero, metres."""
    corners = []
    for name, T_root_link in zero_poses(description.urdf).items():
        for shape in shapes_of(description, name, role):
            box = trimesh.bounds.corners(surface(description, shape).bounds)
            corners.append(trimesh.transform_points(box, T_root_link))
    return np.ptp(np.concatenate(corners), axis=0) if corners else np.zeros(3)


def shapes_of(description: Description, link: str, role: str) -> tuple[Shape, ...]:
    """A link's ``collision`` or ``visual`` shapes."""
    found = description.urdf.links[link]
    return found.collisions if role == "collision" else found.visuals


def change_shapes(description: Description, change: Callable[[Shape], Shape]) -> None:
    """Replaces every shape of the description by what ``change`` makes of it."""

    def changed(shapes: Sequence[Shape]) -> tuple[Shape, ...]:
        return tuple(change(shape) for shape in shapes)

    links = {
        name: replace(link, visuals=changed(link.visuals), collisions=changed(link.collisions))
        for name, link in description.urdf.links.items()
    }
    description.urdf = replace(description.urdf, links=links)
