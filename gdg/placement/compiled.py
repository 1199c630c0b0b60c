"""Placing points on the CPU: compiled by numba, on all cores.

Link poses are (batch, link, 4, 4); points (batch, point, 3) in the frame of their link, or
(1, point, 3) for all; float32, metres. Links are (batch, point) or (1, point), int64.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit

from gdg.multicore import over_batch

Real: TypeAlias = "float | np.float32"


@njit(inline="always")
def place_point(T: np.ndarray, local: np.ndarray) -> tuple[Real, Real, Real]:
    """T · local."""
    a, b, c = local[0], local[1], local[2]
    return (
        T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3],
        T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3],
        T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3],
    )


@njit(inline="always")
def pull_point(G: np.ndarray, local: np.ndarray, fx: Real, fy: Real, fz: Real) -> None:
    """Adds ∂(f · T local)/∂T to G."""
    a, b, c = local[0], local[1], local[2]
    G[0, 0] += fx * a
    G[0, 1] += fx * b
    G[0, 2] += fx * c
    G[0, 3] += fx
    G[1, 0] += fy * a
    G[1, 1] += fy * b
    G[1, 2] += fy * c
    G[1, 3] += fy
    G[2, 0] += fz * a
    G[2, 1] += fz * b
    G[2, 2] += fz * c
    G[2, 3] += fz


@over_batch(0, 1, 2)
@njit(cache=True, nogil=True, error_model="numpy")
def place(Ts: np.ndarray, points: np.ndarray, links: np.ndarray) -> np.ndarray:
    """The points in the world, (batch, point, 3)."""
    batch, count = len(Ts), points.shape[1]
    placed = np.empty((batch, count, 3), np.float32)
    for b in range(batch):
        own = b if len(points) > 1 else 0
        for p in range(count):
            x, y, z = place_point(Ts[b, links[own, p]], points[own, p])
            placed[b, p, 0], placed[b, p, 1], placed[b, p, 2] = x, y, z
    return placed


@over_batch(0, 1, 2, 3)
@njit(cache=True, nogil=True, error_model="numpy")
def pull_to_poses(
    grad: np.ndarray, Ts: np.ndarray, points: np.ndarray, links: np.ndarray
) -> np.ndarray:
    """The gradient in the link poses, from that in the placed points, (batch, point, 3)."""
    pulled = np.zeros(Ts.shape, np.float32)
    for b in range(len(Ts)):
        own = b if len(points) > 1 else 0
        for p in range(points.shape[1]):
            G = pulled[b, links[own, p]]
            pull_point(G, points[own, p], grad[b, p, 0], grad[b, p, 1], grad[b, p, 2])
    return pulled


@over_batch(0, 1, 2, 3)
@njit(cache=True, nogil=True, error_model="numpy")
def pull_to_points(
    grad: np.ndarray, Ts: np.ndarray, points: np.ndarray, links: np.ndarray
) -> np.ndarray:
    """The gradient in each pose's points, (batch, point, 3), from that in the placed ones."""
    pulled = np.empty(grad.shape, np.float32)
    for b in range(len(Ts)):
        own = b if len(points) > 1 else 0
        for p in range(points.shape[1]):
            T, f = Ts[b, links[own, p]], grad[b, p]
            for axis in range(3):
                pulled[b, p, axis] = T[0, axis] * f[0] + T[1, axis] * f[1] + T[2, axis] * f[2]
    return pulled
