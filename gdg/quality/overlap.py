"""How deep a hand lies in an object and in itself, on the exact collision geometry.

python-fcl says which convex parts overlap, and ``convex_depth`` how deep. Candidates come from
bounding boxes here: fcl's own managers report through callbacks, whose exceptions they drop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import fcl
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gdg.data.grasps import GraspSet
from gdg.data.table import Table
from gdg.hands.geometry import ConvexPart
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.quality.convex_depth import Polyhedron, overlap_depth, polyhedron, sphere

#: Parts that lie deeper than this in each other in the open posture do so by construction, metres.
TOUCH_M = 1e-6


@dataclass(frozen=True)
class Overlap:
    """The deepest overlap of each grasp, millimetres; NaN for a grasp that is not finite.

    The depth of two convex parts is the shortest way by which one must move to leave the other,
    and the deepest pair counts. It is a lower bound of the way by which the hand must move to
    leave the object where the object is made of several parts.

    Attributes:
        object_mm: of the hand in the object.
        self_mm: of links of the hand that must not touch.
        table_mm: of the hand in the table that the object rests on; 0 where there is none.
    """

    object_mm: Float[Tensor, "grasp"]
    self_mm: Float[Tensor, "grasp"]
    table_mm: Float[Tensor, "grasp"]


def exact_overlap(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> Overlap:
    """The overlap of every grasp, of the convex parts that the simulator uses, too.

    Which links must not touch is decided by the tree and the manifest (``Hand.may_collide``). Of
    these, parts that overlap in the open posture are left out, as they touch by construction. The
    spheres of ``HandModel`` also leave out what overlaps in the middle posture, where crossing
    fingers may; here they count.
    """
    Ts = hand.link_poses(hand.q_of(grasps)).detach().cpu().double().numpy()
    moving, still = HandBodies(hand), Bodies(object_bodies(obj))
    depths = np.full((len(grasps), 3), np.nan)
    for index in np.flatnonzero(np.isfinite(Ts).all((1, 2, 3))):
        moving.place(Ts[index])
        below = 0.0 if obj.table is None else -moving.bodies.height_above(obj.table)
        depths[index] = moving.bodies.depth_in(still), moving.depth_in_itself(), max(0.0, below)
    object_mm, self_mm, table_mm = torch.as_tensor(1000 * depths, dtype=torch.float32).T
    return Overlap(object_mm, self_mm, table_mm)


def object_bodies(obj: ObjectModel) -> list[Polyhedron]:
    """The object's convex parts, object frame."""
    return [polyhedron(part.vertices) for part in obj.convex_parts]


def part_body(part: ConvexPart) -> Polyhedron:
    """A hand's part in its link's frame; spheres are exact, cylinders are their 32-sided mesh."""
    if part.kind == "sphere":
        return sphere(part.T_link_part[:3, 3], part.size[0])
    return polyhedron(part.mesh.vertices)


class Bodies:
    """Convex bodies that can be moved and tested against others.

    Args:
        shapes: each in its own frame.
    """

    def __init__(self, shapes: Sequence[Polyhedron]):
        self.shapes = shapes
        self._objects = [_placeable(shape) for shape in shapes]
        self._vertices = np.concatenate([shape.vertices for shape in shapes])
        sizes = [len(shape.vertices) for shape in shapes]
        self._owner = np.repeat(np.arange(len(shapes)), sizes)
        self._first = np.cumsum([0, *sizes[:-1]])
        self._radii = np.array([[shape.radius] for shape in shapes])
        self.place(np.eye(4)[None].repeat(len(shapes), 0))

    def place(self, Ts_world_body: Float[np.ndarray, "body 4 4"]) -> None:
        """Moves every body to its pose."""
        self.Ts = Ts_world_body
        T = Ts_world_body[self._owner]
        points = np.einsum("nij,nj->ni", T[:, :3, :3], self._vertices) + T[:, :3, 3]
        self._points = points
        self._low = np.minimum.reduceat(points, self._first) - self._radii
        self._high = np.maximum.reduceat(points, self._first) + self._radii
        for shape, placed, T in zip(self.shapes, self._objects, Ts_world_body, strict=True):
            center = T[:3, :3] @ shape.vertices[0] + T[:3, 3] if shape.is_sphere else T[:3, 3]
            placed.setTransform(fcl.Transform(T[:3, :3], center))

    def height_above(self, table: Table) -> float:
        """Height of the lowest point of all bodies above a table, metres."""
        heights = self._points @ table.up - self._radii[self._owner, 0]
        return float(heights.min()) - table.offset

    def touching(
        self, others: Bodies, asked: Bool[np.ndarray, "body other"] | None = None
    ) -> list[tuple[int, int]]:
        """Pairs of a body of these and one of the others that overlap, of those asked for."""
        near = (self._low[:, None] <= others._high).all(-1)
        near &= (others._low <= self._high[:, None]).all(-1)
        if asked is not None:
            near &= asked
        return [
            (one, other)
            for one, other in np.argwhere(near).tolist()
            if fcl.collide(
                self._objects[one], others._objects[other], _YES_OR_NO, fcl.CollisionResult()
            )
        ]

    def depth(self, one: int, others: Bodies, other: int, floor: float = 0.0) -> float:
        """How deep two bodies lie in each other, metres; see ``overlap_depth``."""
        R, t = others.Ts[other, :3, :3].T, others.Ts[other, :3, 3]
        turn, shift = R @ self.Ts[one, :3, :3], R @ (self.Ts[one, :3, 3] - t)
        return overlap_depth(self.shapes[one], others.shapes[other], turn, shift, floor)

    def depth_in(
        self, others: Bodies, asked: Bool[np.ndarray, "body other"] | None = None
    ) -> float:
        """The deepest overlap of a pair, of those asked for, metres."""
        deepest = 0.0
        for one, other in self.touching(others, asked):
            deepest = max(deepest, self.depth(one, others, other, floor=deepest))
        return deepest


_CACHE: WeakKeyDictionary[HandModel, list[Polyhedron]] = WeakKeyDictionary()


class HandBodies:
    """The convex parts of a hand in a posture.

    Args:
        hand: the hand.

    Attributes:
        bodies: one per part, in the order of ``Hand.parts``.
        link: index of each part's link.
    """

    def __init__(self, hand: HandModel):
        parts = hand.hand.parts
        self.link = np.array([hand.link_names.index(part.link) for part in parts])
        if hand not in _CACHE:
            _CACHE[hand] = [part_body(part) for part in parts]
        self.bodies = Bodies(_CACHE[hand])
        self._apart = np.triu(hand.hand.may_collide()[self.link][:, self.link])
        at_rest = hand.link_poses_in_root(hand.open_posture[None])[0]
        self.place(at_rest.detach().cpu().double().numpy())
        for one, other in self.bodies.touching(self.bodies, self._apart):
            if self.bodies.depth(one, self.bodies, other) > TOUCH_M:
                self._apart[one, other] = False

    def place(self, Ts_world_link: Float[np.ndarray, "link 4 4"]) -> None:
        """Moves all parts to where their links are."""
        self.bodies.place(Ts_world_link[self.link])

    def depth_in_itself(self) -> float:
        """The deepest overlap of parts that must not touch, metres."""
        return self.bodies.depth_in(self.bodies, self._apart)


#: Yes or no alone: fcl's depths are not those wanted here, and working them out is unsafe.
_YES_OR_NO = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)


def _placeable(shape: Polyhedron) -> fcl.CollisionObject:
    if shape.is_sphere:
        return fcl.CollisionObject(fcl.Sphere(shape.radius))
    count = np.full((len(shape.faces), 1), 3)
    faces = np.concatenate((count, shape.faces), axis=1).astype(np.int32)
    return fcl.CollisionObject(fcl.Convex(shape.vertices, len(shape.faces), faces.ravel()))
