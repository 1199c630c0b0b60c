"""Where a hand touches an object."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import igl
import numpy as np
import torch
from numba import njit

from gdg.data.contacts import ContactSet
from gdg.data.grasps import GraspSet
from gdg.geometry.sdf import winding_numbers
from gdg.hands.geometry import hand_surface
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.quality.convex_depth import nearest_on_hull, polyhedron

#: Contacts of one link, at most: a flat pad on a flat face is held by its corners.
MAX_PER_LINK = 4
#: Contacts of one link lie at least this far apart, metres.
LEAST_SPACING_M = 0.004
#: A link's further contacts are at most this much further off than its nearest, metres: it would
#: touch there first.
EXTRA_GAP_M = 0.0005
#: Points on the hand at which the search begins; 5 to 7 mm apart on hands of human size.
START_POINTS = 3000
#: Starts may be this much further off than contacts, metres: between them the hand comes nearer.
START_SLACK_M = 0.005
#: Steps downhill, and how far each tries to go into the object, metres; less where that fails.
STEPS, STRIDE_M = 6, 0.01
#: Closer than this to the surface the direction to it says nothing of its normal, metres.
ON_SURFACE_M = 1e-5


def find_contacts(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, reach_m: float = 0.002
) -> ContactSet:
    """Contacts of every grasp: places where a link is within ``reach_m`` of the object.

    From points all over the hand, projected gradient steps lead to where the convex part that each
    lies on is locally nearest to the object: to the one point of a curved fingertip, to the edge
    that presses into a pad; points of a flat pad on a flat face stay where they are. Of what is
    within reach each link keeps the nearest, and then up to three more, each the farthest from
    those kept. So a fingertip has one contact, and a pad enough of them to resist tilting.

    Normals are those of the gap, which on an edge or corner of the object lean to the hand's side;
    on a face they are the face's. A grasp that is not finite has no contacts.

    Args:
        hand: the hand.
        obj: the object.
        grasps: of that hand on that object.
        reach_m: largest gap of a contact, metres. 2 mm is what a closing motor bridges.
    """
    Ts = hand.link_poses(hand.q_of(grasps)).detach().cpu().double().numpy()
    pads = _pads(hand)
    near = [_starts(pads, obj, T, reach_m + START_SLACK_M) for T in Ts]
    grasp = np.repeat(np.arange(len(Ts)), [len(start) for start in near])
    start = np.concatenate([*near, np.zeros(0, np.int64)])
    link = pads.link[start]
    settled = _settle(pads, obj, start, Ts[grasp, link])
    points, normals, gaps = _on_surface(obj, settled)
    kept = np.flatnonzero(gaps <= reach_m)
    kept = kept[np.lexsort((gaps[kept], link[kept], grasp[kept]))]
    group = grasp[kept] * len(hand.link_names) + link[kept]
    kept = kept[_spread(points[kept], gaps[kept], group)]
    return ContactSet(
        torch.as_tensor(np.bincount(grasp[kept], minlength=len(Ts)), dtype=torch.long),
        tuple(hand.link_names[index] for index in link[kept].tolist()),
        *(torch.as_tensor(v[kept], dtype=torch.float32) for v in (points, normals, gaps)),
    )


class _Pads:
    """Points all over a hand, and the convex part that each lies on.

    Args:
        hand: the hand.

    Attributes:
        points: (point, 3) in link frames, metres.
        link: (point,) index of the link.
        part: (point,) index of the part.
        triangles: of all parts, link frames, metres.
        normals: their outward unit normals.
        first: where each part's triangles begin, and the end.
    """

    def __init__(self, hand: HandModel):
        parts = hand.hand.parts
        surface = hand_surface(hand.hand.urdf, parts, START_POINTS, seed=0)
        self.points, self.link = surface.points.astype(np.float64), surface.link_index
        hulls = [polyhedron(part.mesh.vertices) for part in parts]
        self.first = np.cumsum([0, *(len(hull.faces) for hull in hulls)])
        self.triangles = np.concatenate([hull.triangles for hull in hulls])
        self.normals = np.concatenate([hull.triangle_normals for hull in hulls])
        nearest = np.full(len(self.points), np.inf)
        self.part = np.zeros(len(self.points), np.int64)
        for number, (part, hull) in enumerate(zip(parts, hulls, strict=True)):
            offsets = np.einsum("ij,ij->i", hull.triangle_normals, hull.triangles[:, 0])
            rows = np.flatnonzero(self.link == hand.link_names.index(part.link))
            off = np.abs((self.points[rows] @ hull.triangle_normals.T - offsets).max(1))
            better = rows[off < nearest[rows]]
            nearest[better] = off[off < nearest[rows]]
            self.part[better] = number


_CACHE: WeakKeyDictionary[HandModel, _Pads] = WeakKeyDictionary()


def _pads(hand: HandModel) -> _Pads:
    if hand not in _CACHE:
        _CACHE[hand] = _Pads(hand)
    return _CACHE[hand]


def _starts(pads: _Pads, obj: ObjectModel, Ts: np.ndarray, reach_m: float) -> np.ndarray:
    """Points of a hand with the given link poses (link, 4, 4) that are within reach."""
    if not np.isfinite(Ts).all():
        return np.zeros(0, np.int64)
    T = Ts[pads.link]
    placed = np.einsum("nij,nj->ni", T[:, :3, :3], pads.points) + T[:, :3, 3]
    return np.flatnonzero(_distances(obj, placed) <= reach_m)


def _settle(pads: _Pads, obj: ObjectModel, start: np.ndarray, Ts: np.ndarray) -> np.ndarray:
    """Points of the hand, (start, 3), moved downhill on their parts; object frame, metres.

    The object's distance is minimised over each part from each start by projected gradient steps;
    a step that would lead up is not taken, and the next one is shorter.
    """
    R, t = Ts[:, :3, :3], Ts[:, :3, 3]
    points = np.einsum("nij,nj->ni", R, pads.points[start]) + t
    distances, strides = _distances(obj, points), np.full(len(start), STRIDE_M)
    for _ in range(STEPS):
        ahead = np.maximum(distances, 0.0) + strides
        inward = points - ahead[:, None] * _normals(obj, points)
        local = np.einsum("nji,nj->ni", R, inward - t)
        local = _into_parts(local, pads.part[start], pads.triangles, pads.normals, pads.first)
        trial = np.einsum("nij,nj->ni", R, local) + t
        reached = _distances(obj, trial)
        down = reached < distances
        points[down], distances[down] = trial[down], reached[down]
        strides[~down] /= 4
    return points


def _on_surface(obj: ObjectModel, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest points on the object's mesh, outward normals there, signed distances to them."""
    if len(points) == 0:
        return points, points, points[:, 0]
    vertices = np.ascontiguousarray(obj.mesh.vertices, np.float64)
    faces = np.ascontiguousarray(obj.mesh.faces, np.int64)
    squared, face, nearest = igl.point_mesh_squared_distance(points, vertices, faces)
    distance, away = np.sqrt(squared), points - nearest
    normals = np.array(obj.mesh.face_normals[np.asarray(face, np.int64)])
    # one face's normal can't tell the side of a sharp edge, where it is another that matters
    sign = np.where(winding_numbers(obj.mesh, points) > 0.5, -1.0, 1.0)
    clear = distance > ON_SURFACE_M
    normals[clear] = (sign[:, None] * away)[clear] / distance[clear, None]
    return np.asarray(nearest), normals, sign * distance


def _distances(obj: ObjectModel, points: np.ndarray) -> np.ndarray:
    return obj.sdf.distance(_on_device(obj, points)).cpu().numpy().astype(np.float64)


def _normals(obj: ObjectModel, points: np.ndarray) -> np.ndarray:
    return obj.sdf.normals(_on_device(obj, points)).cpu().numpy().astype(np.float64)


def _on_device(obj: ObjectModel, points: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(points, dtype=torch.float32, device=obj.sdf.values.device)


@njit(cache=True, error_model="numpy")
def _into_parts(
    points: np.ndarray,
    part: np.ndarray,
    triangles: np.ndarray,
    normals: np.ndarray,
    first: np.ndarray,
) -> np.ndarray:
    """The point of its part that is nearest to each point; link frames."""
    nearest = np.empty_like(points)
    for k in range(len(points)):
        low, high = first[part[k]], first[part[k] + 1]
        x, y, z = nearest_on_hull(points[k], triangles[low:high], normals[low:high])
        nearest[k, 0], nearest[k, 1], nearest[k, 2] = x, y, z
    return nearest


@njit(cache=True, error_model="numpy")
def _spread(points: np.ndarray, gaps: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Indices of the points that are kept; groups lie together, nearest point first."""
    kept = np.zeros(len(points), np.bool_)
    low = 0
    while low < len(points):
        high = low
        while high < len(points) and group[high] == group[low]:
            high += 1
        nearest = np.full(high - low, np.inf)
        latest = low
        for _ in range(MAX_PER_LINK):
            kept[latest] = True
            best = LEAST_SPACING_M * LEAST_SPACING_M
            chosen = -1
            for k in range(low, high):
                if gaps[k] > max(gaps[low], 0.0) + EXTRA_GAP_M:
                    continue
                squared = ((points[k] - points[latest]) ** 2).sum()
                nearest[k - low] = min(nearest[k - low], squared)
                if nearest[k - low] > best:
                    best, chosen = nearest[k - low], k
            if chosen < 0:
                break
            latest = chosen
        low = high
    return np.flatnonzero(kept)
