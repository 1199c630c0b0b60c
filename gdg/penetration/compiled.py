"""Penetration on the CPU: values and gradients in one pass, compiled by numba, on all cores.

Links that are certainly outside, and pairs of links that are certainly apart, are skipped by
bounding balls, so the cost follows the number of links near a surface.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from gdg.multicore import over_batch
from gdg.placement.compiled import Real, place_point, pull_point

ZERO, ONE, NAN = np.float32(0.0), np.float32(1.0), np.float32(np.nan)
#: Spheres with one centre push each other nowhere; this keeps the division defined, metres.
NEARLY_ZERO_M = np.float32(1e-6)
#: Twice the diagonal of a cell of unit size.
TWO_DIAGONALS = np.float32(2 * math.sqrt(3.0))
#: Rounding must never skip a link that touches, metres.
SLACK_M = np.float32(1e-5)


@njit(inline="always")
def _cell(x: Real, low: Real, spacing: Real, count: int) -> tuple[int, float, Real]:
    """Node below the grid's point nearest to x, share of the way to the next, and x − point."""
    y = (x - low) / spacing
    inside = min(y, np.float32(count - 1)) if y > ZERO else ZERO
    node = min(int(inside), count - 2)
    return node, inside - np.float32(node), (y - inside) * spacing


@njit(inline="always")
def _slope(own: Real, excess: Real, beyond: Real, spacing: Real) -> Real:
    """Derivative along one axis: of the way to the grid beyond it, of the values inside."""
    return excess / beyond if excess != ZERO else own / spacing


@njit(inline="always")
def _field(
    values: np.ndarray, low: np.ndarray, spacing: Real, x: Real, y: Real, z: Real
) -> tuple[Real, Real, Real, Real, Real]:
    """Trilinear distance at the grid's point nearest to (x, y, z), and how far that is, metres.

    Then the gradient of their sum, which is ``SignedDistanceGrid.distance``.
    """
    i, u, excess_x = _cell(x, low[0], spacing, values.shape[0])
    j, v, excess_y = _cell(y, low[1], spacing, values.shape[1])
    k, w, excess_z = _cell(z, low[2], spacing, values.shape[2])
    beyond = math.sqrt(excess_x * excess_x + excess_y * excess_y + excess_z * excess_z)
    a000, a001 = values[i, j, k], values[i, j, k + 1]
    a010, a011 = values[i, j + 1, k], values[i, j + 1, k + 1]
    a100, a101 = values[i + 1, j, k], values[i + 1, j, k + 1]
    a110, a111 = values[i + 1, j + 1, k], values[i + 1, j + 1, k + 1]
    b00, b01 = a000 + w * (a001 - a000), a010 + w * (a011 - a010)
    b10, b11 = a100 + w * (a101 - a100), a110 + w * (a111 - a110)
    c0, c1 = b00 + v * (b01 - b00), b10 + v * (b11 - b10)
    along_y = (ONE - u) * (b01 - b00) + u * (b11 - b10)
    along_z = (ONE - u) * ((ONE - v) * (a001 - a000) + v * (a011 - a010)) + u * (
        (ONE - v) * (a101 - a100) + v * (a111 - a110)
    )
    return (
        c0 + u * (c1 - c0),
        beyond,
        _slope(c1 - c0, excess_x, beyond, spacing),
        _slope(along_y, excess_y, beyond, spacing),
        _slope(along_z, excess_z, beyond, spacing),
    )


@njit(inline="always")
def _gap(values: np.ndarray, low: np.ndarray, cell: Real, x: Real, y: Real, z: Real) -> Real:
    """``SignedDistanceGrid.distance``."""
    value, beyond, _x, _y, _z = _field(values, low, cell, x, y, z)
    return value + beyond


@njit(inline="always")
def _far(
    T: np.ndarray, values: np.ndarray, low: np.ndarray, cell: Real, ball: np.ndarray, reach: Real
) -> bool:
    """Whether a link, within its ball, is certainly farther than ``reach`` from the object."""
    x, y, z = place_point(T, ball)
    value, beyond, _x, _y, _z = _field(values, low, cell, x, y, z)
    # the grid is convex: a point beyond it is at least this far from all inside
    if beyond > ZERO:
        value = math.sqrt(value * value + beyond * beyond)
    return value > ball[3] + reach


@njit(error_model="numpy")
def _finite(Ts: np.ndarray) -> bool:
    good = True
    for value in Ts.flat:
        good &= math.isfinite(value)
    return good


@over_batch(0)
@njit(cache=True, nogil=True, error_model="numpy")
def object_penetration(
    Ts: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    spacing: Real,
    balls: np.ndarray,
    points: np.ndarray,
    point_starts: np.ndarray,
    spheres: np.ndarray,
    sphere_starts: np.ndarray,
    stride: Real,
    margin: Real,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Σ relu(m − δ) of points (× ``stride``) plus Σ relu(m + r − δ) of spheres, and the largest.

    Args:
        Ts: link poses, (batch, link, 4, 4), float32 like all that follow; metres.
        values: signed distances at the grid's nodes, (nx, ny, nz).
        low: position of the first node, (3,).
        spacing: of the nodes.
        balls: centre and radius of a ball around each link, (link, 4), link frame.
        points: surface points, (point, 3), grouped by link.
        point_starts: first point of each link, and the number of points, (link + 1,).
        spheres: centre and radius, (sphere, 4), grouped by link.
        sphere_starts: as ``point_starts``.
        stride: factor of the points' terms.
        margin: m, metres.

    Returns:
        Sum (batch,), largest term (batch,), and the sum's gradient (batch, link, 4, 4).
    """
    batch, links = Ts.shape[0], Ts.shape[1]
    cell, factor, thicker = np.float32(spacing), np.float32(stride), np.float32(margin)
    summed, deepest = np.zeros(batch, np.float32), np.zeros(batch, np.float32)
    gradients = np.zeros((batch, links, 4, 4), np.float32)
    # interpolated values differ from distances by less than a cell's diagonal, at both ends
    reach = TWO_DIAGONALS * cell + SLACK_M + thicker
    for b in range(batch):
        total, depth = ZERO, ZERO
        if not _finite(Ts[b]):  # the compiled code must never make a node's index of it
            summed[b], deepest[b] = NAN, NAN
            continue
        for link in range(links):
            T, G = Ts[b, link], gradients[b, link]
            if _far(T, values, low, cell, balls[link], reach):
                continue
            for p in range(point_starts[link], point_starts[link + 1]):
                x, y, z = place_point(T, points[p])
                value, beyond, gx, gy, gz = _field(values, low, cell, x, y, z)
                inside = thicker - (value + beyond)
                if inside > ZERO:
                    total += factor * inside
                    depth = max(depth, inside)
                    pull_point(G, points[p], -factor * gx, -factor * gy, -factor * gz)
            for s in range(sphere_starts[link], sphere_starts[link + 1]):
                x, y, z = place_point(T, spheres[s])
                value, beyond, gx, gy, gz = _field(values, low, cell, x, y, z)
                inside = thicker + spheres[s, 3] - (value + beyond)
                if inside > ZERO:
                    total += inside
                    depth = max(depth, inside)
                    pull_point(G, spheres[s], -gx, -gy, -gz)
        summed[b], deepest[b] = total, depth
    return summed, deepest, gradients


@over_batch(0)
@njit(cache=True, nogil=True, error_model="numpy")
def self_penetration(
    Ts: np.ndarray,
    balls: np.ndarray,
    link_pairs: np.ndarray,
    pair_starts: np.ndarray,
    pairs: np.ndarray,
    reach: np.ndarray,
    spheres: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Σ relu(reach − distance) over pairs of spheres.

    Args:
        Ts: link poses, (batch, link, 4, 4).
        balls: centre and radius of a ball around the spheres of each link, (link, 4).
        link_pairs: pairs of links with spheres that must stay apart, (link_pair, 2).
        pair_starts: first sphere pair of each, and their number, (link_pair + 1,).
        pairs: spheres of each pair, (pair, 2), the first on the first link.
        reach: distance that each pair must keep, (pair,).
        spheres: centre and radius, (sphere, 4), link frames.

    Returns:
        Sum (batch,) in metres and its gradient (batch, link, 4, 4).
    """
    batch = Ts.shape[0]
    summed = np.zeros(batch, np.float32)
    gradients = np.zeros(Ts.shape, np.float32)
    for b in range(batch):
        total = ZERO
        if not _finite(Ts[b]):
            summed[b] = NAN
            continue
        for n in range(len(link_pairs)):
            i, j = link_pairs[n, 0], link_pairs[n, 1]
            x, y, z, apart = _apart(Ts[b, i], balls[i], Ts[b, j], balls[j])
            if apart > balls[i, 3] + balls[j, 3] + SLACK_M:
                continue
            for p in range(pair_starts[n], pair_starts[n + 1]):
                s, t = pairs[p, 0], pairs[p, 1]
                x, y, z, apart = _apart(Ts[b, i], spheres[s], Ts[b, j], spheres[t])
                if apart < reach[p]:
                    total += reach[p] - apart
                    x, y, z = x / apart, y / apart, z / apart
                    pull_point(gradients[b, i], spheres[s], -x, -y, -z)
                    pull_point(gradients[b, j], spheres[t], x, y, z)
        summed[b] = total
    return summed, gradients


@njit(error_model="numpy")
def _apart(
    T_i: np.ndarray, a: np.ndarray, T_j: np.ndarray, b: np.ndarray
) -> tuple[Real, Real, Real, Real]:
    """From point b on link j to point a on link i, and the length of that."""
    ax, ay, az = place_point(T_i, a)
    bx, by, bz = place_point(T_j, b)
    x, y, z = ax - bx, ay - by, az - bz
    return x, y, z, max(math.sqrt(x * x + y * y + z * z), NEARLY_ZERO_M)


@over_batch(0)
@njit(cache=True, nogil=True, error_model="numpy")
def touching_links(
    Ts: np.ndarray,
    values: np.ndarray,
    low: np.ndarray,
    spacing: Real,
    balls: np.ndarray,
    points: np.ndarray,
    point_starts: np.ndarray,
    spheres: np.ndarray,
    sphere_starts: np.ndarray,
    margin: Real,
) -> np.ndarray:
    """Whether a point or sphere of each link is within ``margin`` of the object, (batch, link).

    Arguments as those of ``object_penetration``; poses that are not finite touch nothing.
    """
    batch, links = Ts.shape[0], Ts.shape[1]
    touching = np.zeros((batch, links), np.bool_)
    cell, thicker = np.float32(spacing), np.float32(margin)
    reach = TWO_DIAGONALS * cell + SLACK_M + thicker
    for b in range(batch):
        if not _finite(Ts[b]):
            continue
        for link in range(links):
            T = Ts[b, link]
            if _far(T, values, low, cell, balls[link], reach):
                continue
            for p in range(point_starts[link], point_starts[link + 1]):
                x, y, z = place_point(T, points[p])
                if _gap(values, low, cell, x, y, z) <= thicker:
                    touching[b, link] = True
                    break
            if touching[b, link]:
                continue
            for s in range(sphere_starts[link], sphere_starts[link + 1]):
                x, y, z = place_point(T, spheres[s])
                if _gap(values, low, cell, x, y, z) <= thicker + spheres[s, 3]:
                    touching[b, link] = True
                    break
    return touching


@over_batch(0)
@njit(cache=True, nogil=True, error_model="numpy")
def crossing_pairs(
    Ts: np.ndarray,
    balls: np.ndarray,
    link_pairs: np.ndarray,
    pair_starts: np.ndarray,
    pairs: np.ndarray,
    reach: np.ndarray,
    spheres: np.ndarray,
) -> np.ndarray:
    """Whether the links of each pair overlap, (batch, link_pair); see ``self_penetration``."""
    batch = Ts.shape[0]
    crossing = np.zeros((batch, len(link_pairs)), np.bool_)
    for b in range(batch):
        if not _finite(Ts[b]):
            continue
        for n in range(len(link_pairs)):
            i, j = link_pairs[n, 0], link_pairs[n, 1]
            if _apart(Ts[b, i], balls[i], Ts[b, j], balls[j])[3] > (
                balls[i, 3] + balls[j, 3] + SLACK_M
            ):
                continue
            for p in range(pair_starts[n], pair_starts[n + 1]):
                s, t = pairs[p, 0], pairs[p, 1]
                if _apart(Ts[b, i], spheres[s], Ts[b, j], spheres[t])[3] < reach[p]:
                    crossing[b, n] = True
                    break
    return crossing
