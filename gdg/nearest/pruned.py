"""Exact branch-and-bound search on the CPU, compiled by numba and run on all cores."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

#: Hand points per block; a block is skipped when its bounding sphere can't hold the winner.
BLOCK = 32
ONE, ZERO = np.float32(1.0), np.float32(0.0)


@njit(inline="always")
def _exp(x: float) -> float:
    """exp(x) as exp(x/64)^64: branch-free, so that loops vectorise; 5e-6 relative for |x| ≤ 8."""
    y = x * np.float32(1 / 64)
    e = ONE + y * (ONE + y * (np.float32(1 / 2) + y * (np.float32(1 / 6) + y * np.float32(1 / 24))))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@njit(cache=True, fastmath=True, error_model="numpy")
def _bounding_spheres(hand: np.ndarray, centers: np.ndarray, radii: np.ndarray) -> None:
    """Centres (3, block) and radii (block,) of the blocks of ``hand`` (3, hand_point)."""
    hands = hand.shape[1]
    for k in range(len(radii)):
        low, high = k * BLOCK, min(hands, (k + 1) * BLOCK)
        for axis in range(3):
            centers[axis, k] = hand[axis, low:high].sum() / np.float32(high - low)
        largest = ZERO
        for h in range(low, high):
            dx, dy = hand[0, h] - centers[0, k], hand[1, h] - centers[1, k]
            dz = hand[2, h] - centers[2, k]
            largest = max(largest, dx * dx + dy * dy + dz * dz)
        # a little more than the radius, against rounding
        radii[k] = math.sqrt(largest) * np.float32(1.0001) + np.float32(1e-7)


@njit(cache=True, fastmath=True, error_model="numpy")
def _bound_blocks(
    point: np.ndarray,
    normal: np.ndarray,
    centers: np.ndarray,
    radii: np.ndarray,
    twice: np.float32,
    epsilon: np.float32,
    bounds: np.ndarray,
) -> None:
    """Lower bounds of every block's scores.

    A block with centre at distance D, direction c and radius r holds only points with d ≥ D − r
    and, since directions deviate from c by at most δ = asin(r/D), with ⟨u, n⟩ ≤ cos(θ − δ),
    cos θ = ⟨c, n⟩. So (D − r) · exp(−2 γ cos(θ − δ)) bounds its score from below. Behind the
    surface ⟨u, n⟩ is negative, and d/(d + ε), smallest at D − r, brings it nearer to zero.
    """
    for k in range(len(radii)):
        dx, dy = centers[0, k] - point[0], centers[1, k] - point[1]
        dz = centers[2, k] - point[2]
        far = math.sqrt(dx * dx + dy * dy + dz * dz) + np.float32(1e-9)
        cosine = (dx * normal[0] + dy * normal[1] + dz * normal[2]) / far
        sine_d = min(ONE, radii[k] / far)
        cosine_d = math.sqrt(ONE - sine_d * sine_d)
        sine = math.sqrt(max(ZERO, ONE - cosine * cosine))
        turned = cosine * cosine_d + sine * sine_d
        nearest = ONE if cosine >= cosine_d else turned
        low = max(ZERO, far - radii[k])
        nearest = max(nearest, nearest * low / (low + epsilon))
        # 2e-5: the rounding of _exp and of the angles must never hide the winner
        bounds[k] = low * _exp(-twice * nearest) * np.float32(0.99998)


@njit(cache=True, fastmath=True, error_model="numpy")
def _score_block(
    point: np.ndarray,
    normal: np.ndarray,
    hand: np.ndarray,
    low: int,
    high: int,
    twice: np.float32,
    epsilon: np.float32,
    scores: np.ndarray,
) -> None:
    for h in range(low, high):
        dx, dy, dz = hand[0, h] - point[0], hand[1, h] - point[1], hand[2, h] - point[2]
        d = math.sqrt(dx * dx + dy * dy + dz * dz)
        along = (dx * normal[0] + dy * normal[1] + dz * normal[2]) / (d + epsilon)
        scores[h - low] = d * _exp(-twice * along)


@njit(cache=True, fastmath=True, parallel=True, error_model="numpy")
def nearest_pruned(
    object_points: np.ndarray,
    object_normals: np.ndarray,
    hand_points: np.ndarray,
    gamma: float,
    epsilon: float,
) -> np.ndarray:
    """See ``gdg.nearest.nearest_hand_points``; float32 arrays; exact to 1e-5 of the score."""
    batch, hands = hand_points.shape[0], hand_points.shape[1]
    count, blocks = object_points.shape[0], (hands + BLOCK - 1) // BLOCK
    index = np.zeros((batch, count), np.int64)
    twice, eps = np.float32(2.0 * gamma), np.float32(epsilon)
    for b in prange(batch):
        hand = np.ascontiguousarray(hand_points[b].T)
        centers, radii = np.empty((3, blocks), np.float32), np.empty(blocks, np.float32)
        _bounding_spheres(hand, centers, radii)
        bounds, scores = np.empty(blocks, np.float32), np.empty(BLOCK, np.float32)
        for o in range(count):
            point, normal = object_points[o], object_normals[o]
            _bound_blocks(point, normal, centers, radii, twice, eps, bounds)
            first = np.argmin(bounds)
            best, winner = np.float32(np.inf), 0
            for step in range(-1, blocks):
                k = first if step < 0 else step
                if step >= 0 and (k == first or bounds[k] > best):
                    continue
                low, high = k * BLOCK, min(hands, (k + 1) * BLOCK)
                _score_block(point, normal, hand, low, high, twice, eps, scores)
                for h in range(low, high):
                    score = scores[h - low]
                    if score < best or (score == best and h < winner):
                        best, winner = score, h
            index[b, o] = winner
    return index
