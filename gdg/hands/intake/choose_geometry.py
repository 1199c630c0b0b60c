"""Decides which shapes of a description are the hand's one geometry, and completes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import igl
import numpy as np
import trimesh

from gdg.errors import GdgError
from gdg.geometry.mesh import inside_convex, sample_surface
from gdg.hands.intake.description import Description, named
from gdg.hands.intake.surfaces import bodies, solid, surface, zero_poses
from gdg.hands.urdf import Link

Role = Literal["collision", "visual"]
#: Collision shapes whose surface is on average so far inside what is seen are placeholders, m.
PLACEHOLDER_M = 0.003
#: Points on each link's visual surface.
SAMPLES = 400


@dataclass(frozen=True)
class _Coverage:
    """Moving links whose visual surface lies outside the collision shapes of their body.

    Attributes:
        moving: links with shapes that joints move.
        placeholders: those of them that have collision shapes, far inside the visual surface.
        missing: links (moving or not) without any, whose body's others do not cover them.
    """

    moving: tuple[str, ...]
    placeholders: tuple[str, ...]
    missing: tuple[str, ...]


def choose_geometry(description: Description) -> Role:
    """The role of the shapes that gdg should use; links that lack them get the other's.

    Raises:
        GdgError: no link has any shape.
    """
    links = description.urdf.links.values()
    if not any(link.collisions or link.visuals for link in links):
        raise GdgError(f"{description.urdf.path}: no link has a shape; gdg needs the hand's form.")
    if not any(link.visuals for link in links):
        return "collision"
    if not any(link.collisions for link in links):
        description.repairs.append("No collision shapes: the visual shapes are used instead.")
        return "visual"
    coverage = _coverage(description)
    missing_moving = set(coverage.missing) & set(coverage.moving)
    if len(coverage.placeholders) >= max(2, len(coverage.moving) / 3):
        description.repairs.append(
            f"{named(list(coverage.placeholders))}: collision shapes far inside the visual surface "
            "(placeholders); the visual shapes are used for the whole hand."
        )
    elif 2 * len(missing_moving) > len(coverage.moving):
        description.repairs.append(
            f"{named(sorted(missing_moving))}: no collision shapes; the visual shapes are used "
            "for the whole hand."
        )
    else:
        _complete(description, "collision", set(coverage.missing))
        return "collision"
    _complete(description, "visual", {link.name for link in links if not link.visuals})
    return "visual"


def _complete(description: Description, role: Role, names: set[str]) -> None:
    """Gives the links named the shapes that they have in the other role."""

    def completed(link: Link) -> Link:
        if link.name not in names:
            return link
        if role == "collision":
            return replace(link, collisions=link.visuals)
        return replace(link, visuals=link.collisions)

    changed = [n for n, link in description.urdf.links.items() if completed(link) != link]
    links = {name: completed(link) for name, link in description.urdf.links.items()}
    description.urdf = replace(description.urdf, links=links)
    if changed:
        other = "visual" if role == "collision" else "collision"
        description.repairs.append(f"{named(changed)}: no {role} shapes; got the {other} ones.")


def _coverage(description: Description) -> _Coverage:
    urdf = description.urdf
    body, poses = bodies(urdf), zero_poses(urdf)
    covers: dict[str, list[trimesh.Trimesh]] = {}
    for name, link in urdf.links.items():
        for shape in link.collisions:
            mesh = surface(description, shape).apply_transform(poses[name])
            covers.setdefault(body[name], []).append(mesh)
    shaped = (n for n, link in urdf.links.items() if link.visuals or link.collisions)
    moving = tuple(name for name in shaped if body[name] != urdf.root)
    placeholders, missing = [], []
    for name, link in urdf.links.items():
        if not link.visuals:
            continue
        meshes = [surface(description, s).apply_transform(poses[name]) for s in link.visuals]
        bare = _stand_off(meshes, covers.get(body[name], [])) > PLACEHOLDER_M
        if bare and link.collisions and body[name] != urdf.root:
            placeholders.append(name)
        if bare and not link.collisions:
            missing.append(name)
    return _Coverage(moving, tuple(placeholders), tuple(missing))


def _stand_off(seen: Sequence[trimesh.Trimesh], covers: Sequence[trimesh.Trimesh]) -> float:
    """Mean distance of a visual surface from the shapes below it, 0 inside them, metres."""
    if not covers:
        return np.inf
    merged = trimesh.util.concatenate(list(seen))
    assert isinstance(merged, trimesh.Trimesh)
    points, _ = sample_surface(merged, SAMPLES, seed=0)
    nearest = np.full(len(points), np.inf)
    for cover in covers:
        vertices, faces = np.asarray(cover.vertices, np.float64), np.asarray(cover.faces, np.int64)
        squared = np.asarray(igl.point_mesh_squared_distance(points, vertices, faces)[0])
        inside = inside_convex(_hull(cover), points, margin=0.0)
        nearest = np.minimum(nearest, np.where(inside, 0.0, np.sqrt(np.maximum(squared, 0.0))))
    return float(nearest.mean())


def _hull(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return solid(mesh).convex_hull
