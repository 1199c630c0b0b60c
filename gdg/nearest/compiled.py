"""Exhaustive search on the CPU, compiled by numba into vector instructions and run on all cores.

Every pair is scored. Skipping blocks of hand points by bounding spheres was measured, too: it
scores a third of the pairs, and takes as long, since short blocks leave the vectors idle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from gdg.multicore import over_batch

ONE = np.float32(1.0)
LARGEST = np.int32(np.iinfo(np.int32).max)


@njit(inline="always")
def _exp(x: float) -> float:
    """exp(x) as exp(x/64)^64: branch-free, so that loops vectorise; 3e-5 relative for |x| ≤ 8."""
    y = x * np.float32(1 / 64)
    e = ONE + y * (ONE + y * (np.float32(1 / 2) + y * (np.float32(1 / 6) + y * np.float32(1 / 24))))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@njit(cache=True, fastmath=True, error_model="numpy")
def _score(
    point: np.ndarray,
    normal: np.ndarray,
    hand: np.ndarray,
    twice: np.float32,
    epsilon: np.float32,
    scores: np.ndarray,
) -> None:
    """Writes the score of every hand point, (3, hand_point), against one object point."""
    x, y, z = point[0], point[1], point[2]
    nx, ny, nz = normal[0], normal[1], normal[2]
    xs, ys, zs = hand[0], hand[1], hand[2]
    for h in range(len(scores)):
        dx, dy, dz = xs[h] - x, ys[h] - y, zs[h] - z
        d = math.sqrt(dx * dx + dy * dy + dz * dz)
        along = (dx * nx + dy * ny + dz * nz) / (d + epsilon)
        scores[h] = d * _exp(-twice * along)


@njit(cache=True, error_model="numpy")
def _first_least(bits: np.ndarray) -> int:
    """Index of the least score, the first on ties.

    Args:
        bits: of scores, as integers: of floats that are not negative they have the same order,
            and unlike theirs their minimum is compiled into vector instructions.
    """
    least = first = LARGEST
    for h in range(len(bits)):
        least = min(least, bits[h])
    for h in range(len(bits)):
        first = min(first, np.int32(h) if bits[h] == least else LARGEST)
    return int(first)


@over_batch(2)
@njit(cache=True, nogil=True, error_model="numpy")
def nearest_compiled(
    object_points: np.ndarray,
    object_normals: np.ndarray,
    hand_points: np.ndarray,
    gamma: float,
    epsilon: float,
) -> np.ndarray:
    """See ``gdg.nearest.nearest_hand_points``; float32; scores are exact to 3e-5 (γ = 1: 1e-5)."""
    batch, hands, count = len(hand_points), hand_points.shape[1], len(object_points)
    index = np.zeros((batch, count), np.int64)
    twice, eps = np.float32(2.0 * gamma), np.float32(epsilon)
    for b in range(batch):
        hand = np.ascontiguousarray(hand_points[b].T)
        scores = np.empty(hands, np.float32)
        bits = scores.view(np.int32)
        for o in range(count):
            _score(object_points[o], object_normals[o], hand, twice, eps, scores)
            index[b, o] = _first_least(bits)
    return index
