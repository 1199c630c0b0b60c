"""Where to look from: the sides on which hand, object and contact are best seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Candidate eyes: every 15° around the object's z axis at these elevations.
AZIMUTHS_DEG = np.arange(0.0, 360.0, 15.0)
ELEVATIONS_DEG = (-15.0, 20.0, 50.0)
#: Elevations from which a table does not hide what stands on it.
ABOVE_TABLE_DEG = (8.0, 20.0, 50.0)
#: Points hide others in the same cell of the image that lie deeper by the given depth, metres.
CELL_M, HIDING_DEPTH_M = 0.011, 0.012
#: Cells are numbered up to this one.
FARTHEST_CELL = 10**8
#: The second view differs from the first by at least this angle.
MIN_ANGLE_DEG = 65.0
#: Hand points farther from the object's sphere than this (a forearm) may be cut off, metres.
FRAME_MARGIN_M = 0.09


@dataclass(frozen=True)
class Points:
    """Surface points of one thing in the object's frame: positions (n, 3), unit normals (n, 3)."""

    positions: np.ndarray
    normals: np.ndarray


def best_views(
    thing: Points,
    hand: Points,
    weights: np.ndarray,
    palm_normal: np.ndarray,
    elevations_deg: Sequence[float] = ELEVATIONS_DEG,
) -> np.ndarray:
    """Two unit vectors towards the eye, (2, 3), the better one first.

    Args:
        thing: the object's surface.
        hand: the hand's surface.
        weights: (n,) how much each object point is worth seeing, such as its contact value.
        palm_normal: unit vector; looking along it, the hand hides the object or the reverse.
        elevations_deg: of the eyes that come into question.
    """
    eyes = _candidates(elevations_deg)
    scores = np.array([_score(eye, thing, hand, weights, palm_normal) for eye in eyes])
    first = int(scores.argmax())
    far = eyes @ eyes[first] <= np.cos(np.radians(MIN_ANGLE_DEG))
    # straight from behind shows little new either
    far &= eyes @ eyes[first] >= -0.9
    second = int(np.where(far, scores, -np.inf).argmax())
    return eyes[[first, second]]


def camera_axes(eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors to the right and up in the image of an eye direction; z is up."""
    upward = np.array([0.0, 0.0, 1.0]) if abs(eye[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(upward, eye)
    right /= np.linalg.norm(right)
    return right, np.cross(eye, right)


def frame_points(thing: Points, hand: Points) -> np.ndarray:
    """The points that a picture has to show, (n, 3): the object and the hand near it."""
    low, high = thing.positions.min(0), thing.positions.max(0)
    reach = np.linalg.norm(high - low) / 2 + FRAME_MARGIN_M
    near = np.linalg.norm(hand.positions - (low + high) / 2, axis=-1) < reach
    return np.concatenate((thing.positions, hand.positions[near]))


def _candidates(elevations_deg: Sequence[float]) -> np.ndarray:
    azimuth, elevation = np.meshgrid(np.radians(AZIMUTHS_DEG), np.radians(elevations_deg))
    flat = np.cos(elevation)
    eyes = np.stack((flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)), axis=-1)
    return eyes.reshape(-1, 3)


def _score(
    eye: np.ndarray, thing: Points, hand: Points, weights: np.ndarray, palm_normal: np.ndarray
) -> float:
    both = np.concatenate((thing.positions, hand.positions))
    facing = np.concatenate((thing.normals, hand.normals)) @ eye > 0.1
    seen = facing & _unhidden(eye, both)
    count = len(thing.positions)
    contact = weights[seen[:count]].sum() / max(weights.sum(), 1e-9)
    object_share = seen[:count].sum() / max(facing[:count].sum(), 1)
    hand_share = seen[count:].sum() / max(facing[count:].sum(), 1)
    along_palm = abs(float(eye @ palm_normal))
    # from below is unusual, but better than seeing nothing
    below = max(0.0, -float(eye[2]))
    return contact + 0.6 * object_share + 0.4 * hand_share - 0.3 * along_palm - 0.5 * below


def _unhidden(eye: np.ndarray, points: np.ndarray) -> np.ndarray:
    right, up = camera_axes(eye)
    # what is absurdly far away shares a cell
    cells = np.floor(np.stack((points @ right, points @ up), -1) / CELL_M)
    cells = np.clip(cells, -FARTHEST_CELL, FARTHEST_CELL).astype(np.int64)
    used, index = np.unique(cells @ (1, 4 * FARTHEST_CELL), return_inverse=True)
    depth = points @ eye
    nearest = np.full(len(used), -np.inf)
    np.maximum.at(nearest, index, depth)
    return depth >= nearest[index] - HIDING_DEPTH_M
