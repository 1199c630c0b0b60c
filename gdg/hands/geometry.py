"""The one geometry of a hand: convex parts per link, from which all else is taken.

The contact surface, penetration, self-collision and the simulators all use these parts.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from gdg.cache import cached_arrays, content_hash
from gdg.errors import GdgError, raise_if_any
from gdg.geometry.convex import Decomposition, convex_parts
from gdg.geometry.half_spaces import half_spaces
from gdg.geometry.mesh import farthest_points, inside_convex, load_mesh, sample_surface
from gdg.hands.urdf import Shape, Urdf

#: Links are cut while their hull stands off by more than this on average.
DECOMPOSITION = Decomposition(gap_m=0.0008, max_parts=8)
#: No shape of a hand is larger than this; a larger one means millimetres read as metres.
MAX_LINK_EXTENT_M = 2.0
#: Samples taken per surface point kept, so that farthest-point sampling has a choice.
OVERSAMPLING = 8
#: A surface point is hidden when, this far out along its normal, there is another part, metres.
HIDDEN_STEP_M = 2e-4
#: Sphere covers: at most this many per link, none thinner than this share of the thickest.
MAX_SPHERES_PER_LINK = 8
MIN_SPHERE_SHARE = 0.4


@dataclass(frozen=True)
class ConvexPart:
    """One convex piece of a link.

    Attributes:
        link: the link that carries it.
        kind: ``box``, ``cylinder``, ``sphere`` or ``hull``.
        size: full side lengths; radius and length; radius; or empty for a hull. Metres.
        T_link_part: pose in the link's frame (identity for a hull).
        mesh: its surface in the link's frame, metres.
        cut_from: the mesh that a hull is a piece of, in the link's frame, metres; None for others.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    T_link_part: np.ndarray
    mesh: trimesh.Trimesh
    cut_from: trimesh.Trimesh | None = None


@dataclass(frozen=True)
class Surface:
    """Points on the outer surface of a hand, evenly spread.

    Attributes:
        points: (hand_point, 3) in the frames of their links, metres.
        normals: (hand_point, 3) outward unit normals, link frames.
        link_index: (hand_point,) index into ``Urdf.links``.
    """

    points: np.ndarray
    normals: np.ndarray
    link_index: np.ndarray


@dataclass(frozen=True)
class Spheres:
    """Inscribed spheres that stand for the hand in self-collision.

    Attributes:
        centers: (sphere, 3) in link frames, metres.
        radii: (sphere,) metres.
        link_index: (sphere,) index into ``Urdf.links``.
    """

    centers: np.ndarray
    radii: np.ndarray
    link_index: np.ndarray


def link_parts(urdf: Urdf, folder: Path, role: str) -> tuple[ConvexPart, ...]:
    """Convex parts of every link, from its ``collision`` or ``visual`` shapes.

    Raises:
        GdgError: meshes that are missing, unreadable, implausibly large or outside the folder, all
            at once; or no shape of that role in the whole URDF.
    """
    parts: list[ConvexPart] = []
    mistakes: list[str] = []
    for link in urdf.links.values():
        for shape in link.collisions if role == "collision" else link.visuals:
            try:
                parts += _parts_of(urdf, folder, link.name, shape)
            except GdgError as error:
                mistakes.append(str(error))
    raise_if_any(list(dict.fromkeys(mistakes)))
    if not parts:
        raise GdgError(f"{urdf.path}: no link has {role} shapes (see 'geometry' in hand.yaml).")
    return tuple(parts)


def _parts_of(urdf: Urdf, folder: Path, link: str, shape: Shape) -> list[ConvexPart]:
    what = f"mesh '{shape.mesh}'" if shape.kind == "mesh" else shape.kind
    where = f"{urdf.path}: link '{link}': {what}"
    mesh = shape_mesh(shape, lambda: load_mesh(resolve_mesh(urdf.path, folder, link, shape.mesh)))
    extent = float(mesh.extents.max())
    if extent > MAX_LINK_EXTENT_M:
        hint = '; write scale="0.001 0.001 0.001"' if shape.kind == "mesh" else ""
        raise GdgError(f"{where} is {extent:.3g} m long: it seems to be in millimetres{hint}.")
    if shape.kind != "mesh":
        return [ConvexPart(link, shape.kind, shape.size, shape.T_link_shape, mesh)]
    try:
        hulls = convex_parts(mesh, DECOMPOSITION)
    except GdgError as error:
        raise GdgError(f"{where}: {error}") from error
    return [ConvexPart(link, "hull", (), np.eye(4), hull, mesh) for hull in hulls]


def resolve_mesh(urdf_path: Path, folder: Path, link: str, name: str) -> Path:
    """The file of a mesh that a URDF names, which must lie inside the hand's folder.

    Paths start at the URDF; ``package://name/path`` is looked up as ``path``, then as
    ``name/path``, at the URDF and at the folder.

    Raises:
        GdgError: the path leaves the folder (links are followed), or there is no such file.
    """
    candidates = [urdf_path.parent / name]
    if name.startswith("package://"):
        whole = name.removeprefix("package://")
        paths = whole.partition("/")[2], whole
        candidates = [base / path for base in (urdf_path.parent, folder) for path in paths]
    elif "://" in name:
        raise GdgError(f"{urdf_path}: link '{link}': mesh '{name}' is no path inside the folder.")
    inside = folder.resolve()
    for candidate in candidates:
        path = Path(os.path.realpath(candidate))
        if not path.is_relative_to(inside):
            raise GdgError(
                f"{urdf_path}: link '{link}': mesh '{name}' lies outside the hand's folder; copy "
                f"it into {folder}."
            )
        if os.path.isfile(path):  # unlike Path.is_file, False for a name that is too long
            return path
    raise GdgError(f"{urdf_path}: link '{link}': there is no mesh file '{name[:200]}' in {folder}.")


def shape_mesh(
    shape: Shape, load: Callable[[], trimesh.Trimesh], sphere_level: int = 3
) -> trimesh.Trimesh:
    """A shape's surface in its link's frame, metres.

    Args:
        shape: a primitive or a mesh.
        load: gives the mesh, before scaling; the caller's own, since it is changed. Not called for
            a primitive.
        sphere_level: how often the icosahedron of a sphere is subdivided.
    """
    if shape.kind == "mesh":
        mesh = load().apply_transform(np.diag([*shape.size, 1.0]))
    elif shape.kind == "box":
        mesh = trimesh.creation.box(shape.size)
    elif shape.kind == "cylinder":
        mesh = trimesh.creation.cylinder(shape.size[0], shape.size[1], sections=32)
    else:
        mesh = trimesh.creation.icosphere(sphere_level, radius=shape.size[0])
    return mesh.apply_transform(shape.T_link_shape)


def hand_surface(urdf: Urdf, parts: tuple[ConvexPart, ...], count: int, seed: int) -> Surface:
    """``count`` points on the outside of the union of each link's parts; cached on disk."""
    key = content_hash("hand-surface-3", *_signature(urdf, parts), count, seed)
    arrays = cached_arrays("surface", key, lambda: _sample(urdf, parts, count, seed))
    return Surface(arrays["points"], arrays["normals"], arrays["link_index"])


def _sample(
    urdf: Urdf, parts: tuple[ConvexPart, ...], count: int, seed: int
) -> dict[str, np.ndarray]:
    links = list(urdf.links)
    areas = np.array([part.mesh.area for part in parts])
    points, normals, index = [], [], []
    for i, part in enumerate(parts):
        wanted = max(16, int(np.ceil(OVERSAMPLING * count * areas[i] / areas.sum())))
        p, n = sample_surface(part.mesh, wanted, seed=seed + i)
        siblings = [o.mesh for o in parts if o is not part and o.link == part.link]
        hidden = np.zeros(len(p), bool)
        for sibling in siblings:
            # a step outward, so that of the faces that two parts share those in front of the
            # other part go (a cut through a mesh) and those beside it stay (a flush cap)
            hidden |= inside_convex(sibling, p + HIDDEN_STEP_M * n, margin=0.0)
        points.append(p[~hidden])
        normals.append(n[~hidden])
        index.append(np.full(int((~hidden).sum()), links.index(part.link)))
    all_points, all_index = np.concatenate(points), np.concatenate(index)
    # links side by side would share points if they were sampled in one frame
    spread = all_points + 10.0 * np.stack([all_index, 0 * all_index, 0 * all_index], -1)
    chosen = _in_neighbourhoods(spread, farthest_points(spread, count))
    return {
        "points": all_points[chosen].astype(np.float32),
        "normals": np.concatenate(normals)[chosen].astype(np.float32),
        "link_index": all_index[chosen].astype(np.int64),
    }


def _in_neighbourhoods(points: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Reorders indices so that near points follow each other (halving the widest axis)."""
    if len(chosen) <= 2:
        return chosen
    axis = int(np.ptp(points[chosen], axis=0).argmax())
    ordered = chosen[np.argsort(points[chosen, axis], kind="stable")]
    half = len(chosen) // 2
    return np.concatenate(
        (_in_neighbourhoods(points, ordered[:half]), _in_neighbourhoods(points, ordered[half:]))
    )


def hand_spheres(urdf: Urdf, parts: tuple[ConvexPart, ...], seed: int = 0) -> Spheres:
    """Inscribed spheres of all parts; cached on disk."""
    key = content_hash("hand-spheres-4", *_signature(urdf, parts), seed)
    arrays = cached_arrays("spheres", key, lambda: _inscribe(urdf, parts, seed))
    return Spheres(arrays["centers"], arrays["radii"], arrays["link_index"])


def _inscribe(urdf: Urdf, parts: tuple[ConvexPart, ...], seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    centers, radii, index = [], [], []
    for number, link in enumerate(urdf.links):
        meshes = [part.mesh for part in parts if part.link == link]
        if not meshes:
            continue
        candidates, depth = _depths(meshes, rng)
        thickest = depth.max()
        for _ in range(MAX_SPHERES_PER_LINK):
            deepest = int(depth.argmax())
            radius = float(depth[deepest])
            if radius <= 0 or radius < MIN_SPHERE_SHARE * thickest:
                break
            centers.append(candidates[deepest])
            radii.append(radius)
            index.append(number)
            # a candidate in the chosen sphere's core would add next to nothing
            distance = np.linalg.norm(candidates - candidates[deepest], axis=-1)
            depth = np.where(distance < radius, -1.0, depth)
    return {
        "centers": np.array(centers, np.float32).reshape(-1, 3),
        "radii": np.array(radii, np.float32),
        "link_index": np.array(index, np.int64),
    }


def _depths(
    meshes: list[trimesh.Trimesh], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Random points in the parts of one link, and how deep each lies in its part, metres."""
    candidates, depths = [], []
    for mesh in meshes:
        points = rng.uniform(*mesh.bounds, size=(2000, 3))
        candidates.append(points)
        depths.append(-half_spaces(mesh).heights(points).max(-1))
    return np.concatenate(candidates), np.concatenate(depths)


def _signature(urdf: Urdf, parts: tuple[ConvexPart, ...]) -> list[bytes | str]:
    signature: list[bytes | str] = [repr(list(urdf.links))]
    for part in parts:
        vertices = np.ascontiguousarray(part.mesh.vertices, dtype=np.float64)
        signature += [part.link, vertices.tobytes()]
    return signature
