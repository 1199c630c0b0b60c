"""Cuts a mesh into convex parts, for physics engines and for the one geometry of a hand."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
import trimesh

from gdg.cache import cached_arrays, content_hash
from gdg.errors import GdgError
from gdg.geometry.mesh import farthest_points, signed_volume
from gdg.geometry.sdf import closed_surface
from gdg.multicore import in_threads


@dataclass(frozen=True)
class Decomposition:
    """How finely a mesh is cut into convex parts.

    Attributes:
        gap_m: a part is cut while its hull stands off its surface by more than this on average
            (excess volume over hull area), metres.
        max_parts: no more parts than this.
        max_vertices: hulls are thinned to this many vertices (PhysX takes at most 255).
    """

    gap_m: float
    max_parts: int
    max_vertices: int = 200


#: Along which axis, and at which share of the part's extent.
Cut = tuple[int, float]
#: Cuts that are tried, and those of them through the middle.
CUTS: tuple[Cut, ...] = tuple(itertools.product(range(3), (0.25, 0.5, 0.75)))
HALVINGS: tuple[Cut, ...] = tuple(cut for cut in CUTS if cut[1] == 0.5)
#: A cut that leaves more than this share of the excess is chosen by looking one cut ahead.
HELPFUL_SHARE = 0.8
#: Meshes are thinned to this many faces before they are cut; on a 10 cm object that moves the
#: surface by about 0.1 mm on average.
CUT_FACES = 2000
#: How hastily: at 3 of 10 the surface moves half as far as at fast-simplification's own 7, in the
#: same time; at 1 many meshes keep too many faces.
AGGRESSION = 3


def convex_parts(mesh: trimesh.Trimesh, how: Decomposition) -> list[trimesh.Trimesh]:
    """Convex meshes whose union approximates a mesh; cached on disk by content.

    A mesh that is no closed manifold is replaced by the zero surface of its signed distance.

    Greedy bisection: the part whose hull has most excess volume is cut by the axis-aligned plane
    that leaves its two halves the least, until all parts are near enough to their hulls.

    Raises:
        GdgError: the mesh encloses nothing.
    """
    key = content_hash(
        "convex-parts-6", np.asarray(mesh.vertices, np.float64).tobytes(),
        np.asarray(mesh.faces, np.int64).tobytes(), repr(how),
    )  # fmt: skip
    arrays = cached_arrays("convex", key, lambda: _pack(_decompose(mesh, how)))
    return [
        trimesh.Trimesh(arrays[f"vertices_{i}"], arrays[f"faces_{i}"], process=False)
        for i in range(len(arrays) // 2)
    ]


def _pack(parts: Sequence[trimesh.Trimesh]) -> dict[str, np.ndarray]:
    packed: dict[str, np.ndarray] = {}
    for i, part in enumerate(parts):
        packed[f"vertices_{i}"] = np.asarray(part.vertices)
        packed[f"faces_{i}"] = np.asarray(part.faces)
    return packed


def _decompose(mesh: trimesh.Trimesh, how: Decomposition) -> list[trimesh.Trimesh]:
    parts = [_Part(_solid(mesh))]
    while len(parts) < how.max_parts:
        candidates = [part for part in parts if part.gap > how.gap_m]
        if not candidates:
            break
        worst = max(candidates, key=lambda part: part.excess)
        halves = _best_cut(worst)
        if not halves or len(parts) - 1 + len(halves) > how.max_parts:
            break
        parts.remove(worst)
        parts += halves
    return [_thin_hull(part.hull, how.max_vertices) for part in parts]


def _solid(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    if signed_volume(mesh) < 0:  # inside out, as mirrored exports are
        mesh = mesh.copy()
        mesh.invert()
    solid = _manifold(mesh)
    if solid.is_empty():
        mesh = closed_surface(mesh)
        solid = _manifold(mesh)
    if len(mesh.faces) > CUT_FACES:
        thinned = _manifold(
            mesh.simplify_quadric_decimation(face_count=CUT_FACES, aggression=AGGRESSION)
        )
        solid = thinned if not thinned.is_empty() else solid
    if solid.is_empty():
        raise GdgError("the mesh encloses no volume, so it can't be cut into convex parts.")
    return solid


def _manifold(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    vertices, faces = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32)
    raw = manifold3d.Mesh(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
    raw.merge()
    solid = manifold3d.Manifold(raw)
    return solid if solid.volume() > 0 else manifold3d.Manifold()


class _Part:
    """A piece of the solid with its hull, and how far the two differ."""

    def __init__(self, solid: manifold3d.Manifold):
        self.solid = solid
        self.hull = solid.hull()
        #: Volume between hull and solid, m³.
        self.excess = float(self.hull.volume() - solid.volume())
        #: Mean stand-off of the hull, metres.
        self.gap = self.excess / max(float(self.hull.surface_area()), 1e-12)
        self._pieces: dict[Cut, list[_Part]] = {}

    def pieces(self, cut: Cut) -> list[_Part]:
        """What a cut leaves; made once."""
        if cut not in self._pieces:
            axis, share = cut
            bounds = self.solid.bounding_box()
            offset = bounds[axis] + share * (bounds[axis + 3] - bounds[axis])
            halves = self.solid.split_by_plane(np.eye(3)[axis].tolist(), offset)
            self._pieces[cut] = [
                _Part(p) for half in halves for p in half.decompose() if p.volume() > 1e-12
            ]
        return self._pieces[cut]


def _best_cut(part: _Part) -> list[_Part]:
    """The pieces of the cut that leaves least excess; looks one cut ahead where none helps.

    A tube's first cut never helps: half a tube has the hull of half a rod. Then the cuts through
    the middle are compared by what a second one leaves.
    """
    (cuts,) = _all_cut([part], CUTS)
    if not cuts:
        return []
    best = min(cuts, key=_total_excess)
    if _total_excess(best) < HELPFUL_SHARE * part.excess:
        return best
    (halves,) = _all_cut([part], HALVINGS)
    halves = halves or cuts
    pieces = list(itertools.chain.from_iterable(halves))
    left = {
        piece: min([piece.excess, *map(_total_excess, quarters)])
        for piece, quarters in zip(pieces, _all_cut(pieces, HALVINGS), strict=True)
    }
    return min(halves, key=lambda pieces: sum(left[piece] for piece in pieces))


def _all_cut(parts: Sequence[_Part], cuts: Sequence[Cut]) -> list[list[list[_Part]]]:
    """The pieces of each cut of each part that leaves more than one; on several cores."""
    made = iter(in_threads(lambda one: one[0].pieces(one[1]), itertools.product(parts, cuts)))
    return [
        [pieces for pieces in itertools.islice(made, len(cuts)) if len(pieces) > 1] for _ in parts
    ]


def _total_excess(pieces: Sequence[_Part]) -> float:
    return sum(piece.excess for piece in pieces)


def _thin_hull(hull: manifold3d.Manifold, max_vertices: int) -> trimesh.Trimesh:
    raw = hull.to_mesh()
    vertices = np.asarray(raw.vert_properties, np.float64)[:, :3]
    if len(vertices) > max_vertices:
        vertices = vertices[farthest_points(vertices, max_vertices)]
    return trimesh.convex.convex_hull(vertices)
