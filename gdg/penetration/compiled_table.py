"""Penetration of a table on the CPU: values and gradients in one pass, compiled by numba."""

from __future__ import annotations

import numpy as np
from numba import njit

from gdg.multicore import over_batch
from gdg.penetration.compiled import NAN, SLACK_M, ZERO, Real, _finite


@over_batch(0)
@njit(cache=True, nogil=True, error_model="numpy")
def table_penetration(
    Ts: np.ndarray,
    up: np.ndarray,
    offset: Real,
    balls: np.ndarray,
    points: np.ndarray,
    point_starts: np.ndarray,
    spheres: np.ndarray,
    sphere_starts: np.ndarray,
    stride: Real,
    margin: Real,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As ``compiled.object_penetration``, with δ the height above a table.

    Args:
        up: the table's unit normal, (3,), float32.
        offset: of its surface along ``up``, metres.

    The other arguments and the results are those of ``object_penetration``.
    """
    batch, links = Ts.shape[0], Ts.shape[1]
    factor, thicker, level = np.float32(stride), np.float32(margin), np.float32(offset)
    summed, deepest = np.zeros(batch, np.float32), np.zeros(batch, np.float32)
    gradients = np.zeros((batch, links, 4, 4), np.float32)
    for n in range(batch):
        total, depth = ZERO, ZERO
        if not _finite(Ts[n]):
            summed[n], deepest[n] = NAN, NAN
            continue
        for link in range(links):
            T, ball = Ts[n, link], balls[link]
            # height of a point (x, y, z) of the link: a x + b y + c z + d
            a = up[0] * T[0, 0] + up[1] * T[1, 0] + up[2] * T[2, 0]
            b = up[0] * T[0, 1] + up[1] * T[1, 1] + up[2] * T[2, 1]
            c = up[0] * T[0, 2] + up[1] * T[1, 2] + up[2] * T[2, 2]
            d = up[0] * T[0, 3] + up[1] * T[1, 3] + up[2] * T[2, 3] - level
            if a * ball[0] + b * ball[1] + c * ball[2] + d > ball[3] + thicker + SLACK_M:
                continue
            x, y, z, weight = ZERO, ZERO, ZERO, ZERO
            for p in range(point_starts[link], point_starts[link + 1]):
                point = points[p]
                inside = thicker - (a * point[0] + b * point[1] + c * point[2] + d)
                if inside > ZERO:
                    total += factor * inside
                    depth = max(depth, inside)
                    x += factor * point[0]
                    y += factor * point[1]
                    z += factor * point[2]
                    weight += factor
            for s in range(sphere_starts[link], sphere_starts[link + 1]):
                point = spheres[s]
                inside = thicker + point[3] - (a * point[0] + b * point[1] + c * point[2] + d)
                if inside > ZERO:
                    total += inside
                    depth = max(depth, inside)
                    x += point[0]
                    y += point[1]
                    z += point[2]
                    weight += np.float32(1.0)
            for k in range(3):
                gradients[n, link, k, 0] = -up[k] * x
                gradients[n, link, k, 1] = -up[k] * y
                gradients[n, link, k, 2] = -up[k] * z
                gradients[n, link, k, 3] = -up[k] * weight
        summed[n], deepest[n] = total, depth
    return summed, deepest, gradients
