"""Meshes for pictures: an object fine enough to carry a contact map, a hand's visual shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyvista
import trimesh
from scipy.spatial import KDTree

from gdg.cache import cached_arrays, content_hash
from gdg.errors import GdgError
from gdg.geometry.mesh import load_mesh
from gdg.hands.geometry import resolve_mesh, shape_mesh
from gdg.hands.hand import Hand
from gdg.hands.urdf import Link, Shape

#: Edges sharper than this are drawn sharp.
CREASE_DEG = 40.0
#: Opposite normals count as this far apart when values are looked up, metres, so that nothing
#: leaks through a thin wall or around an edge.
NORMAL_WEIGHT_M = 0.02


@dataclass(frozen=True)
class PictureMesh:
    """Triangles with one normal per vertex; vertices are doubled along sharp edges.

    Attributes:
        vertices: (vertex, 3) float32, metres.
        normals: (vertex, 3) float32, unit, outward.
        faces: (face, 3) int32.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray


def object_mesh(mesh: trimesh.Trimesh, max_faces: int) -> PictureMesh:
    """An object's surface with nearly ``max_faces`` triangles of similar size.

    Too fine meshes are decimated, coarse ones subdivided (a box of 12 triangles could show no
    contact map); the shape stays.
    """
    if len(mesh.faces) > max_faces:
        mesh = mesh.simplify_quadric_decimation(face_count=max_faces // 2)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    surface = pyvista.PolyData.from_regular_faces(vertices, faces)
    surface.cell_data["parent"] = np.arange(len(faces))
    # equilateral triangles would have this edge; real ones come out with longer ones
    edge = 1.4 * float(np.sqrt(4.0 * mesh.area / (np.sqrt(3.0) * max_faces)))
    for _ in range(30):
        finer = surface.subdivide_adaptive(max_edge_len=edge, max_n_passes=12)
        if finer.n_cells <= max_faces:
            surface = finer
            break
        edge *= 1.1
    corners = np.asarray(surface.points)[surface.faces.reshape(-1, 4)[:, 1:]]
    return _weld(corners, _smooth_normals(mesh, corners, surface.cell_data["parent"]))


def _smooth_normals(mesh: trimesh.Trimesh, corners: np.ndarray, parent: np.ndarray) -> np.ndarray:
    """Normals at the corners of parts of a mesh's triangles, (face, 3, 3).

    Interpolated within the triangle that each face is a part of: normals of the finer mesh itself
    would show the coarse one's facets.
    """
    coarse = _with_normals(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    triangles = np.repeat(mesh.triangles[parent], 3, axis=0)
    weights = trimesh.triangles.points_to_barycentric(triangles, corners.reshape(-1, 3))
    normals = np.repeat(coarse.normals[coarse.faces[parent]], 3, axis=0)
    return _unit((weights[:, :, None] * normals).sum(1)).reshape(-1, 3, 3)


def _weld(corners: np.ndarray, normals: np.ndarray) -> PictureMesh:
    """One vertex for all corners that agree in position (to 1 µm) and normal (to about 1°)."""
    points, directions = corners.reshape(-1, 3), normals.reshape(-1, 3)
    keys = np.rint(np.concatenate((points * 1e6, directions * 50), axis=1)).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return PictureMesh(
        points[first].astype(np.float32),
        directions[first].astype(np.float32),
        inverse.reshape(-1, 3).astype(np.int32),
    )


def vertex_values(
    mesh: PictureMesh, points: np.ndarray, normals: np.ndarray, values: np.ndarray
) -> np.ndarray:
    """Values at surface points carried over to a mesh's vertices, (…, point) -> (…, vertex).

    Mean of the four nearest points, weighted by inverse distance; points whose normal differs
    count as far away.
    """
    tree = KDTree(np.concatenate((points, NORMAL_WEIGHT_M / 2 * normals), axis=1))
    sought = np.concatenate((mesh.vertices, NORMAL_WEIGHT_M / 2 * mesh.normals), axis=1)
    distance, nearest = tree.query(sought, k=min(4, len(points)))
    distance, nearest = distance.reshape(len(sought), -1), nearest.reshape(len(sought), -1)
    weight = 1.0 / (distance + 1e-4)
    weight /= weight.sum(-1, keepdims=True)
    return (values[..., nearest] * weight).sum(-1)


def hand_meshes(hand: Hand, max_faces: int) -> dict[int, PictureMesh]:
    """Link index -> mesh in the link's frame; links without shapes are left out.

    The URDF's visual shapes where a link has some and their files can be read (they are for
    pictures only), else the collision shapes that everything else uses. Cached on disk.

    Args:
        hand: the hand.
        max_faces: of the whole hand, about; finer meshes are decimated alike.
    """
    sources = {index: _link_mesh(hand, link) for index, link in enumerate(hand.urdf.links.values())}
    meshes = {index: mesh for index, mesh in sources.items() if mesh is not None}
    share = min(1.0, max_faces / max(1, sum(len(mesh.faces) for mesh in meshes.values())))
    return {index: _picture_mesh(mesh, share) for index, mesh in meshes.items()}


def part_meshes(hand: Hand) -> dict[int, PictureMesh]:
    """Link index -> its convex parts in the link's frame: the shapes that gdg computes with."""
    meshes = {}
    for index, link in enumerate(hand.link_names):
        parts = [part.mesh for part in hand.parts_of(link)]
        if parts:
            meshes[index] = picture_mesh(parts)
    return meshes


def picture_mesh(meshes: list[trimesh.Trimesh]) -> PictureMesh:
    """All triangles of some meshes, with normals for drawing."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return _with_normals(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts)]),
    )


def _link_mesh(hand: Hand, link: Link) -> trimesh.Trimesh | None:
    try:
        meshes = [_shape_mesh(hand, link.name, shape) for shape in link.visuals]
    except GdgError:
        # a lost or foreign visual file must not keep anyone from grasping
        meshes = []
    meshes = meshes or [part.mesh for part in hand.parts_of(link.name)]
    merged = trimesh.util.concatenate(meshes) if meshes else None
    return merged if isinstance(merged, trimesh.Trimesh) else None


def _shape_mesh(hand: Hand, link: str, shape: Shape) -> trimesh.Trimesh:
    def load() -> trimesh.Trimesh:
        return load_mesh(resolve_mesh(hand.urdf.path, hand.folder, link, shape.mesh))

    return shape_mesh(shape, load)


def _picture_mesh(mesh: trimesh.Trimesh, share: float) -> PictureMesh:
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int64)
    wanted = max(64, int(share * len(faces)))
    key = content_hash("picture-mesh-1", vertices.tobytes(), faces.tobytes(), wanted, CREASE_DEG)

    def compute() -> dict[str, np.ndarray]:
        small = mesh
        if len(faces) > wanted:
            small = mesh.simplify_quadric_decimation(face_count=wanted)
        made = _with_normals(np.asarray(small.vertices), np.asarray(small.faces))
        return {"vertices": made.vertices, "normals": made.normals, "faces": made.faces}

    arrays = cached_arrays("picture", key, compute)
    return PictureMesh(arrays["vertices"], arrays["normals"], arrays["faces"])


def _with_normals(vertices: np.ndarray, faces: np.ndarray) -> PictureMesh:
    """The same triangles in the same order, vertices doubled along sharp edges."""
    surface = pyvista.PolyData.from_regular_faces(vertices.astype(np.float32), faces)
    surface = surface.compute_normals(
        cell_normals=False,
        split_vertices=True,
        feature_angle=CREASE_DEG,
        consistent_normals=False,
        non_manifold_traversal=False,
    )
    return PictureMesh(
        np.asarray(surface.points, np.float32),
        _unit(np.asarray(surface.point_data["Normals"], np.float32)),
        surface.faces.reshape(-1, 4)[:, 1:].astype(np.int32),
    )


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
