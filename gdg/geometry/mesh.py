"""Triangle meshes: safe loading, sampling, tests of points."""

from __future__ import annotations

import logging
import struct
from pathlib import Path
from typing import Any

import defusedxml
import defusedxml.ElementTree
import numpy as np
import trimesh
from collada.common import DaeError
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from trimesh.exchange.stl import HeaderError
from trimesh.resolvers import Resolver

from gdg.errors import GdgError
from gdg.geometry.half_spaces import half_spaces

#: Meshes beyond these are refused unread or undigested: a hand or object needs far less.
MAX_MESH_BYTES = 200_000_000
MAX_FACES = 1_000_000
MAX_COORDINATE = 1e6
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".dae")
#: What the parsers of the mesh formats raise on hostile bytes: anything that isn't a signal.
PARSER_ERRORS = (
    ArithmeticError, AssertionError, AttributeError, BufferError, EOFError, ImportError,
    LookupError, MemoryError, NameError, OSError, RuntimeError, SyntaxError, TypeError, ValueError,
    DaeError, HeaderError, struct.error,
)  # fmt: skip


def load_mesh(path: Path) -> trimesh.Trimesh:
    """One triangle mesh from a file, vertices merged, in the file's own numbers.

    Only COLLADA states its unit; it is converted to metres.

    Raises:
        GdgError: missing, too large, no mesh format, empty, flat to a line, or not finite.
    """
    if not path.is_file():
        raise GdgError(f"{path}: there is no such mesh file.")
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise GdgError(f"{path}: not a mesh format that gdg reads ({', '.join(MESH_SUFFIXES)}).")
    if path.stat().st_size > MAX_MESH_BYTES:
        raise GdgError(f"{path}: larger than {MAX_MESH_BYTES // 10**6} MB; decimate it first.")
    mesh = _parse(path)
    if len(mesh.faces) == 0:
        raise GdgError(f"{path}: the mesh has no faces.")
    if len(mesh.faces) > MAX_FACES:
        raise GdgError(
            f"{path}: {len(mesh.faces):,} faces, more than {MAX_FACES:,}; decimate it first "
            f"(20,000 are plenty for grasping)."
        )
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise GdgError(f"{path}: the mesh is not made of triangles in space.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise GdgError(f"{path}: a face names a vertex that does not exist.")
    used, index = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], index.reshape(faces.shape)
    if not (np.abs(vertices) < MAX_COORDINATE).all():  # false for NaN, too
        raise GdgError(f"{path}: the mesh has vertices that are not finite, or absurdly far away.")
    # a new mesh, so that vertices are merged by position alone, across texture seams
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    if not mesh.area > 0.0:
        raise GdgError(f"{path}: the mesh has no area: its vertices coincide or lie on a line.")
    return mesh


def _parse(path: Path) -> trimesh.Trimesh:
    logger = logging.getLogger("trimesh")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # what it would log is in the error below
    try:
        scale = _collada_unit(path) if path.suffix.lower() == ".dae" else 1.0
        loaded = trimesh.load(
            path, force="mesh", skip_materials=True, resolver=_NoResolver(), process=False
        )
        if scale != 1.0:
            loaded.apply_scale(scale)
    except defusedxml.DefusedXmlException as error:
        raise GdgError(f"{path}: the XML declares entities, which gdg refuses.") from error
    except PARSER_ERRORS as error:
        raise GdgError(f"{path}: cannot be read as a mesh: {_one_line(error)}") from error
    finally:
        logger.setLevel(level)
    if not isinstance(loaded, trimesh.Trimesh):
        raise GdgError(f"{path}: holds no triangle mesh.")
    return loaded


def _collada_unit(path: Path) -> float:
    """Metres per unit of a COLLADA file, which is also checked for entities."""
    tree = defusedxml.ElementTree.parse(path, forbid_dtd=True)
    unit = tree.find("{*}asset/{*}unit")
    return 1.0 if unit is None else float(unit.get("meter", "1"))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


class _NoResolver(Resolver):
    """Refuses every further file (materials, textures) that a mesh file names."""

    def __init__(self) -> None:
        """Nothing to resolve against."""

    def get(self, key: str) -> bytes:
        raise FileNotFoundError(key)

    def keys(self) -> list[str]:
        return []

    def namespaced(self, namespace: str) -> _NoResolver:
        return self

    def write(self, name: str, data: bytes) -> None:
        raise PermissionError(name)


def close_gaps(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, float]:
    """The mesh with every gap closed by a fan around the gap's centre, and the fans' area.

    Gaps are found by signed edges, so edges that join four faces are none. A mesh without gaps is
    returned as it is, with area 0.
    """
    edges = mesh.edges[mesh.edges[:, 0] != mesh.edges[:, 1]]
    pairs, index = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    excess = np.zeros(len(pairs), np.int64)
    np.add.at(excess, index.ravel(), np.where(edges[:, 0] < edges[:, 1], 1, -1))
    rim = np.repeat(np.where(excess[:, None] > 0, pairs, pairs[:, ::-1]), np.abs(excess), axis=0)
    if len(rim) == 0:
        return mesh, 0.0
    count = len(mesh.vertices)
    graph = coo_matrix((np.ones(len(rim)), rim.T), (count, count))
    gaps, gap = np.unique(connected_components(graph)[1][rim[:, 0]], return_inverse=True)
    centers = np.zeros((len(gaps), 3))
    np.add.at(centers, gap, mesh.vertices[rim[:, 0]])
    centers /= np.bincount(gap)[:, None]
    fans = np.column_stack((rim[:, ::-1], count + gap))
    vertices = np.concatenate((mesh.vertices, centers))
    closed = trimesh.Trimesh(vertices, np.concatenate((mesh.faces, fans)), process=False)
    return closed, float(closed.area_faces[len(mesh.faces) :].sum())


def sample_surface(mesh: trimesh.Trimesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points uniform over a mesh's surface, with the outward normals of their faces.

    Returns:
        points (count, 3) and normals (count, 3), in the mesh's frame and units.
    """
    sampled: Any = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(sampled[0]), np.asarray(mesh.face_normals[sampled[1]])


def signed_volume(mesh: trimesh.Trimesh) -> float:
    """Volume that a mesh encloses, negative for one that is inside out; 0 for a sheet."""
    first, second, third = mesh.triangles.transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", first, np.cross(second, third)) / 6)


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of ``count`` points that cover a cloud evenly (farthest-point sampling).

    Deterministic: starts at index 0, the lowest index wins ties.
    """
    chosen = np.zeros(min(count, len(points)), dtype=np.int64)
    nearest = np.full(len(points), np.inf)
    for i in range(1, len(chosen)):
        nearest = np.minimum(nearest, ((points - points[chosen[i - 1]]) ** 2).sum(-1))
        chosen[i] = int(nearest.argmax())
    return chosen


def inside_convex(mesh: trimesh.Trimesh, points: np.ndarray, margin: float) -> np.ndarray:
    """Which points lie deeper than ``margin`` metres inside a convex mesh; (n,) bool."""
    return half_spaces(mesh).heights(points).max(-1) < -margin
