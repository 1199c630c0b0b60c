"""How an object comes to rest on a table: its stable poses, and how likely each is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int

from gdg.cache import cached_arrays, content_hash
from gdg.objects.model import ObjectModel

#: Poses whose ups differ by less than this are one pose: facets of a side that is nearly flat.
SAME_POSE_RAD = np.radians(5.0)
#: Poses less likely than this are left out, but for the likeliest.
MIN_PROBABILITY = 0.01
#: The centre of mass may lie this far beside a facet's edge and still be above it, metres.
EDGE_M = 1e-6


@dataclass(frozen=True)
class RestingPose:
    """A way in which an object lies still on a table, in the object's frame.

    Attributes:
        up: unit normal of the table.
        offset: of the table's surface from the object's origin along ``up``, metres.
        probability: that the object comes to rest so, dropped in a random orientation.
    """

    up: np.ndarray
    offset: float
    probability: float


def resting_poses(obj: ObjectModel) -> list[RestingPose]:
    """Poses in which an object lies still, the most probable first; at least one.

    Quasi-static, as in Goldberg et al. 1999 (*Part pose statistics*): an object dropped in a
    random orientation lands on the facet of its convex hull that lies below its centre of mass,
    and rolls over edges until the centre of mass is above the facet it lies on. Of poses that are
    equally likely (to 1 %), that with its up nearest to the frame's z, then y, then x comes
    first. Cached by the object's content.
    """
    key = content_hash("resting-2", obj.content_hash)
    arrays = cached_arrays("resting", key, lambda: _arrays(obj))
    return [
        RestingPose(up, float(offset), float(probability))
        for up, offset, probability in zip(
            arrays["ups"], arrays["offsets"], arrays["probabilities"], strict=True
        )
    ]


def _arrays(obj: ObjectModel) -> dict[str, np.ndarray]:
    hull = obj.mesh.convex_hull
    center = obj.center_of_mass.cpu().double().numpy()
    landing = _solid_angles(hull, center) / (4 * np.pi)
    below = np.bincount(_facet_at_rest(hull, center), landing, minlength=len(hull.faces))
    facets = np.flatnonzero(below)
    ups, shares = _merged(-hull.face_normals[facets], below[facets])
    kept = shares >= min(MIN_PROBABILITY, shares.max())
    ups, shares = ups[kept], shares[kept]
    rank = np.concatenate((ups.round(3), shares[:, None].round(2)), axis=1)
    order = np.lexsort(-rank.T)
    ups, shares = ups[order], shares[order]
    return {
        "ups": ups,
        "offsets": (hull.vertices @ ups.T).min(0),
        "probabilities": shares,
    }


def _solid_angles(hull: trimesh.Trimesh, center: np.ndarray) -> Float[np.ndarray, "face"]:
    """Solid angle of each triangle as seen from inside (Van Oosterom and Strackee 1983)."""
    a, b, c = np.moveaxis(hull.triangles - center, 1, 0)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
    return np.abs(2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb))


def _facet_at_rest(hull: trimesh.Trimesh, center: np.ndarray) -> Int[np.ndarray, "face"]:
    """The triangle that an object which lands on each triangle rolls to."""
    corners, normals = hull.triangles, hull.face_normals
    edges = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(normals[:, None], edges)
    inward /= np.maximum(np.linalg.norm(inward, axis=-1, keepdims=True), 1e-12)
    inside = np.einsum("fek,fek->fe", inward, center - corners)
    rolls = inside.min(1) < -EDGE_M
    across = _neighbours(hull)[np.arange(len(normals)), inside.argmin(1)]
    heights = np.einsum("fk,fk->f", normals, corners[:, 0] - center)
    # the centre of mass sinks where it rolls, but for triangles of one flat facet
    rolls &= (across >= 0) & (heights[across] <= heights + EDGE_M)
    at = np.where(rolls, across, np.arange(len(normals)))
    for _ in range(len(at).bit_length()):  # each time twice as far
        at = at[at]
    return at


def _neighbours(hull: trimesh.Trimesh) -> Int[np.ndarray, "face 3"]:
    """The triangle beyond each edge (corner i to i + 1) of each triangle; -1 for none."""
    beyond = np.full((len(hull.faces), 3), -1)
    of_edge: dict[tuple[int, int], tuple[int, int]] = {}
    for face, corners in enumerate(hull.faces.tolist()):
        for edge, (start, end) in enumerate(zip(corners, corners[1:] + corners[:1])):
            of_edge[start, end] = face, edge
            other = of_edge.get((end, start))
            if other is not None:
                beyond[face, edge], beyond[other] = other[0], face
    return beyond


def _merged(ups: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses that are nearly the same as one: the likeliest of them, with the sum of the shares."""
    order = np.lexsort((*ups.round(6).T, -shares.round(9)))
    kept: list[int] = []
    summed: list[float] = []
    for index in order.tolist():
        near = [n for n, k in enumerate(kept) if ups[k] @ ups[index] > np.cos(SAME_POSE_RAD)]
        if near:
            summed[near[0]] += float(shares[index])
        else:
            kept.append(index)
            summed.append(float(shares[index]))
    return ups[kept], np.array(summed)
