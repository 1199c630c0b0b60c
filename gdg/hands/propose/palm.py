"""Where the palm faces and where its centre is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from gdg.geometry.half_spaces import half_spaces
from gdg.hands.geometry import ConvexPart
from gdg.hands.propose.closing import Closing
from gdg.hands.propose.probe import Grips, Prober

#: Within this angle a normal is taken to be an axis of the palm's or the root's frame, degrees.
SNAP_DEG = 10.0
#: The same for hands with a fixed jaw, whose opening is known less well.
JAW_SNAP_DEG = 25.0
#: The thinnest direction of a flat palm counts within this angle of where balls rest, degrees.
FLAT_DEG = 45.0
#: Fingers are in a row if they are this many and their summed axes this long, as a share of their
#: number (a thumb may oppose four fingers: 3 of 5).
ROW_FINGERS, ROW_SHARE = 3, 0.55
#: Grips are as good as the best up to this energy above it; fewer of them say nothing.
AS_GOOD, FEW = 0.7, 3
#: A palm link with fewer surface points says nothing about its thickness.
LEAST_POINTS = 30
#: Surface points face the balls if their normal and the palm's have at least this cosine (60°).
FRONT = 0.5
#: The certainty falls linearly to 0 where the normal differs by this from what the balls say,
#: degrees, but stays within the second figures.
UNCERTAIN_DEG, CERTAINTIES = 60.0, (0.2, 0.99)
#: Certainty where nothing can be compared: a jaw's palm, and one without shapes.
UNCOMPARED = 0.5


@dataclass(frozen=True)
class PalmFace:
    """The palm in its link's frame.

    Attributes:
        normal: outward unit vector.
        center: a point on the surface, metres.
        certainty: from 0 to 1.
        reason: one sentence for people.
        pad: the link that the fingers press against: the palm's, or that of a fixed jaw.
        pad_outward: unit vector out of the pad's inner side.
    """

    normal: np.ndarray
    center: np.ndarray
    certainty: float
    reason: str
    pad: str
    pad_outward: np.ndarray


def find_palm(prober: Prober, grips: Grips, closings: Sequence[Closing]) -> PalmFace:
    """The side of the palm that balls rest on while all fingers hold them.

    The normal is halfway between the palm's own where the balls touch it and the direction to the
    balls' centres; where no ball reaches the palm, the way from its middle to the balls. Hands with
    fingers in a row have a flat palm, but hold balls at its upper edge or beside the thumb: there
    the direction in which the palm is thinnest counts, if it is near. An axis of a frame that is
    next to the result replaces it.
    """
    weights = grips.weights().numpy().astype(np.float64)
    centers = grips.centers.numpy().astype(np.float64)
    points, normals = _palm_surface(prober)
    if len(points) == 0:
        return _without_shapes(prober, centers, weights)
    resting = _resting(grips)
    reached = resting.any()
    resting = resting | ~reached
    weights, centers = weights[resting], centers[resting]
    nearest = _nearest(centers, points)
    felt = _unit((weights[:, None] * normals[nearest]).sum(0))
    seen = _unit((weights[:, None] * _units(centers - points[nearest])).sum(0))
    if len(prober.structure.fingers) == 1:
        return _of_jaw(prober, grips, felt, int(prober.palm[nearest[0]]))
    if not reached:
        felt = seen = _unit(np.average(centers - points.mean(0), axis=0, weights=weights))
    rough = _unit(felt + seen)
    thin = _thin_axis(prober, rough) if in_a_row(prober, closings) else rough
    normal = thin if _angle(thin, rough) < FLAT_DEG else rough
    normal = _snapped(normal, _frame_axes(prober))
    spread = max(_angle(normal, felt), _angle(normal, seen))
    center = _surface_under(prober, np.average(centers, axis=0, weights=weights), normal)
    certainty = float(np.clip(1.0 - spread / UNCERTAIN_DEG, *CERTAINTIES))
    reason = (
        f"balls that all fingers hold rest on this side of '{prober.structure.palm}'; its surface "
        f"there and the directions to {resting.sum()} balls agree within {spread:.0f} degrees"
    )
    return PalmFace(normal, center, certainty, reason, prober.structure.palm, normal)


def _resting(grips: Grips) -> np.ndarray:
    """Which grips have the ball on the palm.

    None if hardly any is about as good as the best one off the palm, as with grippers whose jaws
    don't reach back to it.
    """
    good = grips.on_palm & (grips.energy < grips.energy.min() + AS_GOOD)
    return (good if int(good.sum()) >= FEW else torch.zeros_like(good)).numpy()


def _of_jaw(prober: Prober, grips: Grips, felt: np.ndarray, touched: int) -> PalmFace:
    """A single finger closes against a jaw that is part of the palm: the palm faces the opening.

    Args:
        prober: the hand.
        grips: all on the palm.
        felt: normal of the fixed jaw where balls touch it.
        touched: a surface point there.
    """
    finger = prober.structure.fingers[0]
    joint = prober.hand.hand.urdf.joints[finger.joints[0]]
    placed = prober.place(grips.joints)
    weights = grips.weights().numpy().astype(np.float64)
    middle = np.average(grips.centers.numpy().astype(np.float64), axis=0, weights=weights)
    base = placed.points[0, prober.palm].mean(0).numpy().astype(np.float64)
    if joint.type != "prismatic":
        base = placed.Ts_palm_link[0, prober.first_links[0], :3, 3].numpy().astype(np.float64)
    outward = middle - base
    normal = _snapped(_unit(outward - (outward @ felt) * felt), _frame_axes(prober), JAW_SNAP_DEG)
    pad = prober.hand.link_names[int(prober.hand.surface.link_index[touched])]
    reason = "a single finger closes against a fixed jaw; the palm faces the opening between them"
    center = _surface_under(prober, middle, normal)
    return PalmFace(normal, center, UNCOMPARED, reason, pad, felt)


def _without_shapes(prober: Prober, centers: np.ndarray, weights: np.ndarray) -> PalmFace:
    """A palm that is only a frame: it faces the balls, seen from where the fingers start."""
    bases = prober.resting.Ts_palm_link[0, prober.first_links, :3, 3].numpy().astype(np.float64)
    middle = bases.mean(0)
    normal = _unit((weights[:, None] * _units(centers - middle)).sum(0))
    reason = f"'{prober.structure.palm}' has no shapes; the balls lie on this side of the fingers"
    normal = _snapped(normal, _frame_axes(prober))
    return PalmFace(normal, middle, UNCOMPARED, reason, prober.structure.palm, normal)


def _palm_surface(prober: Prober) -> tuple[np.ndarray, np.ndarray]:
    rest = prober.resting
    points, normals = rest.points[0, prober.palm], rest.normals[0, prober.palm]
    return points.numpy().astype(np.float64), normals.numpy().astype(np.float64)


def _nearest(centers: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(centers[:, None] - points, axis=-1).argmin(1)


def in_a_row(prober: Prober, closings: Sequence[Closing]) -> bool:
    """Whether most fingers close about the same axis the same way, as those of a human hand do."""
    hand = prober.hand.hand
    signs = np.array([closing.sign for closing in closings])
    Ts, axes = prober.resting.Ts_palm_link[0].numpy(), []
    for finger in prober.structure.fingers:
        for name in reversed(finger.joints):
            joint, follows = hand.urdf.joints[name], hand.coupling[0][hand.moving_rows[name]]
            sign = np.sign(follows @ signs)
            if sign and joint.type != "prismatic":
                rotation = Ts[prober.hand.link_names.index(joint.child), :3, :3]
                axes.append(sign * rotation.astype(np.float64) @ joint.axis)
                break
    aligned = float(np.linalg.norm(np.sum(axes, axis=0))) if axes else 0.0
    return len(axes) >= ROW_FINGERS and aligned > ROW_SHARE * len(axes)


def _thin_axis(prober: Prober, toward: np.ndarray) -> np.ndarray:
    """The direction in which the palm is thinnest, on the side of ``toward``."""
    own = prober.points_of((prober.structure.palm,))
    chosen = own if len(own) >= LEAST_POINTS else prober.palm
    points = prober.resting.points[0, chosen].numpy().astype(np.float64)
    axis = np.linalg.eigh(np.cov(points.T))[1][:, 0]
    return axis if axis @ toward > 0 else -axis


def _frame_axes(prober: Prober) -> np.ndarray:
    """Axes of the palm link's and of the root's frame, both ways, in the palm link's frame."""
    root = prober.hand.link_names.index(prober.hand.hand.urdf.root)
    rotation = prober.resting.Ts_palm_link[0, root, :3, :3].numpy()
    axes = np.concatenate([np.eye(3), rotation.T.astype(np.float64)])
    return np.concatenate([axes, -axes])


def _snapped(normal: np.ndarray, axes: np.ndarray, within: float = SNAP_DEG) -> np.ndarray:
    best = axes[(axes @ normal).argmax()]
    return best if _angle(best, normal) < within else normal


def _surface_under(prober: Prober, above: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The outermost point of the palm's surface on the line through a point along the normal.

    Where the line misses the palm, the surface point nearest to the line, put onto it.
    """
    heights = []
    for part, T_palm_link in _palm_parts(prober):
        rotation, shift = T_palm_link[:3, :3], T_palm_link[:3, 3]
        start, direction = (above - shift) @ rotation, normal @ rotation
        heights += half_spaces(part.mesh).crossings(start[None], direction).exit.tolist()
    if np.isfinite(heights).any():
        return above + np.nanmax(heights) * normal
    points, normals = _palm_surface(prober)
    faces = normals @ normal > FRONT
    front = points[faces] if faces.any() else points
    offset = front - above
    aside = np.linalg.norm(offset - np.outer(offset @ normal, normal), axis=-1)
    return front[aside.argmin()]


def _palm_parts(prober: Prober) -> list[tuple[ConvexPart, np.ndarray]]:
    Ts = prober.resting.Ts_palm_link[0].numpy().astype(np.float64)
    hand = prober.hand
    return [
        (part, Ts[hand.link_names.index(part.link)])
        for part in hand.hand.parts
        if part.link in prober.structure.palm_body
    ]


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True).clip(1e-12)


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    """Degrees."""
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))
