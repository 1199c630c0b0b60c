"""What contacts with friction can resist: the classical measures of a grasp.

All are of the grasp wrench space of Ferrari & Canny (1992): the wrenches that the contacts apply to
the object when their normal forces add up to 1 (their L1 form). Torques are about the centre of
mass and divided by a length, so that the space has no unit and measures don't depend on scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

#: Coulomb friction: a cautious value for fingers covered with rubber on dry household objects.
FRICTION = 0.5
#: Edges of the pyramid that stands for a friction cone. It lies inside the cone, whose circle it
#: cuts by up to 8 %, so that what it resists the contacts resist.
CONE_EDGES = 8
#: A space whose extent in some direction is less than this share of its largest is flat.
FLAT_SHARE = 1e-6
#: A point whose part along a surface is shorter than this share of its length gives no direction.
STEEP_SHARE = 0.1
#: A space is taken to hold the origin if it is no further off.
ON_ORIGIN = 1e-6
#: Directions in which a space's least extent is sought, those that are followed downhill, and the
#: first and last step and number of steps.
DIRECTIONS, FOLLOWED, STEPS = 1024, 32, (0.2, 0.003, 60)


@dataclass(frozen=True)
class WrenchSpace:
    """Measures of one grasp; no unit.

    Attributes:
        epsilon: Q1, the radius of the largest ball around the origin in the wrench space: the
            largest wrench that is resisted in every direction by normal forces that add up to 1;
            0 without force closure.
        volume: of the wrench space, six-dimensional; 0 where it is flat.
        residual: the least norm of the net wrench of friction-cone forces whose normal parts add
            up to 1, as in the wrench QP of BODex and GraspQP: 0 when the contacts can squeeze the
            object without moving it; NaN without contacts.
    """

    epsilon: float
    volume: float
    residual: float


def wrench_space(
    points: Float[np.ndarray, "contact 3"],
    normals: Float[np.ndarray, "contact 3"],
    length: float,
    friction: float = FRICTION,
    edges: int = CONE_EDGES,
) -> WrenchSpace:
    """The measures of one grasp; too few contacts, or none, have epsilon and volume 0.

    Args:
        points: contact points relative to the object's centre of mass, metres.
        normals: outward unit normals of the object there.
        length: torques are divided by this, metres: the object's largest distance from its centre
            of mass, so that no contact's lever is longer than 1.
        friction: Coulomb's coefficient.
        edges: of the pyramid that stands for the friction cone.
    """
    wrenches = contact_wrenches(points, normals, length, friction, edges)
    if len(wrenches) == 0:
        return WrenchSpace(0.0, 0.0, math.nan)
    residual = _distance_to_origin(wrenches)
    if _is_flat(wrenches):
        return WrenchSpace(0.0, 0.0, residual)
    # joggled by some 1e-11, twice as fast as merging the flat pyramids' facets; same to 9 digits
    hull = ConvexHull(wrenches, qhull_options="QJ")
    epsilon = max(0.0, -float(hull.equations[:, 6].max()))
    return WrenchSpace(epsilon, float(hull.volume), residual)


def force_closure_margin(
    points: Float[np.ndarray, "contact 3"],
    normals: Float[np.ndarray, "contact 3"],
    length: float,
    friction: float = FRICTION,
    edges: int = CONE_EDGES,
) -> float:
    """How far zero is inside the wrench space, or, negative, outside of it; NaN without contacts.

    Outside exact (−``WrenchSpace.residual``); inside an upper bound of ``WrenchSpace.epsilon``,
    mostly a few per cent above it (tiny ones up to three times), which takes a twentieth of the
    time and ranks grasps alike: ε is the least extent of the space over all directions, and this
    the least that is found going downhill from the best of many directions.

    Args:
        points: as of ``wrench_space``, like all others.
        normals: likewise.
        length: likewise.
        friction: likewise.
        edges: likewise.
    """
    wrenches = contact_wrenches(points, normals, length, friction, edges)
    if len(wrenches) == 0:
        return math.nan
    residual = _distance_to_origin(wrenches)
    if residual > ON_ORIGIN:
        return -residual
    if _is_flat(wrenches):
        return 0.0
    directions = _directions()
    extents = (directions @ wrenches.T).max(1)
    directions = directions[extents.argsort()[:FOLLOWED]]
    least = math.inf
    for step in np.geomspace(*STEPS):
        along = directions @ wrenches.T
        farthest = along.argmax(1)
        least = min(least, float(along[np.arange(len(along)), farthest].min()))
        directions = directions - step * wrenches[farthest]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return max(0.0, least)


def _is_flat(wrenches: Float[np.ndarray, "wrench 6"]) -> bool:
    """Whether there are wrenches against which the space has no extent."""
    spread = np.linalg.svd(wrenches - wrenches.mean(0), compute_uv=False)
    return bool(len(wrenches) < 7 or spread[5] < FLAT_SHARE * spread[0])


@lru_cache(maxsize=1)
def _directions() -> Float[np.ndarray, "direction 6"]:
    drawn = np.random.default_rng(0).normal(size=(DIRECTIONS, 6))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def contact_wrenches(
    points: Float[np.ndarray, "contact 3"],
    normals: Float[np.ndarray, "contact 3"],
    length: float,
    friction: float = FRICTION,
    edges: int = CONE_EDGES,
) -> Float[np.ndarray, "wrench 6"]:
    """Wrenches (force, torque / length) of unit normal forces with friction along every edge.

    Without friction there is one per contact. The pyramids turn with the grasp: their first edge
    leans to the contact's own position or, where that is along the normal, to another contact's.
    """
    points, normals = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    forces = -normals[:, None]
    if friction > 0 and len(points):
        first = _tangents(points, normals)
        second = np.cross(normals, first)
        angles = 2 * np.pi * np.arange(edges) / edges
        around = (
            np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
        )
        forces = forces + friction * around
    torques = np.cross(points[:, None], forces) / length
    return np.concatenate((forces, torques), axis=-1).reshape(-1, 6)


def _tangents(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """A unit vector along the surface per contact: where the first suitable point lies."""
    tangents = np.empty_like(points)
    for k, (point, normal) in enumerate(zip(points, normals, strict=True)):
        for towards in (point, *points, *normals, *np.eye(3)):
            flat = towards - (towards @ normal) * normal
            size = np.linalg.norm(flat)
            if size > STEEP_SHARE * np.linalg.norm(towards) and size > 0:
                tangents[k] = flat / size
                break
    return tangents


def _distance_to_origin(points: np.ndarray) -> float:
    """Distance from the origin to the convex hull of points.

    With weights s·μ, Σ μ = 1, ‖Wᵀ s μ‖² + (1 − s)² is least over s at r² / (1 + r²), r = ‖Wᵀ μ‖,
    which grows with r: the least squares below find the nearest point without a constraint.
    """
    system = np.concatenate((points.T, np.ones((1, len(points)))))
    weights, _ = nnls(system, np.append(np.zeros(points.shape[1]), 1.0))
    return float(np.linalg.norm(points.T @ weights) / weights.sum())
