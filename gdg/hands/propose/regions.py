"""Contact regions: rectangles on the inner surfaces of fingers and palm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gdg.geometry.half_spaces import Crossings, half_spaces
from gdg.hands.geometry import ConvexPart

#: Lines of the height map along the longer side, and the least distance between two, metres.
LINES, MIN_STEP_M = 24, 0.001
#: Faces that look away from the inner side by more than this are no pad, degrees.
MAX_TILT_DEG = 55.0
#: At the nodes of the height map a rectangle may stand off the surface by this at most, metres.
MAX_GAP_M = 0.001
#: A rectangle is grown from the middle of the usable nodes and from at least this many others (all,
#: if there are fewer): enough to begin on each face of a link.
SEEDS = 12
#: Rectangles are kept from these sides on, metres.
MIN_SIDES_M = (0.003, 0.004)
#: At most this many per link; a later one must have this share of the first one's area.
MAX_REGIONS, MIN_SHARE = 4, 0.15
#: A neighbour covers the surface if it stands higher than this above it, metres; convex parts of
#: meshes bulge by about a millimetre.
COVERED_M = 1.5e-3
#: What floats higher than this above the surface leaves room for an object, metres.
FREE_M = 0.01

Corners = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class _Relief:
    """Heights of a link's surface over a plane, looked at from the inner side.

    Attributes:
        heights: (row, column) metres along the outward direction, NaN where nothing is.
        usable: (row, column) whether a contact may lie there.
        rows: positions of the rows along ``axes[0]``.
        columns: positions of the columns along ``axes[1]``.
        axes: (3, 3) rows: along, across, outward; link frame.
    """

    heights: np.ndarray
    usable: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    axes: np.ndarray


def inner_regions(
    parts: Sequence[ConvexPart],
    outward: np.ndarray,
    along: np.ndarray,
    obstacles: Sequence[ConvexPart] = (),
) -> list[Corners]:
    """Rectangles on the side of a link that looks in a direction, the largest first.

    Each is aligned with ``along``, and its corners lie on the surface. Where the lines of the
    height map cross, it stands off the surface by a millimetre at most; between them that is not
    looked at, and up to 1.14 mm have been seen. Links without a flat enough face get none.

    Args:
        parts: shapes of the link.
        outward: unit vector out of the inner side, link frame.
        along: direction of the rectangles' sides, e.g. that of the phalanx; not along ``outward``.
        obstacles: shapes of neighbours, moved into the link's frame, that may cover the surface.

    Returns:
        Four corners each, link frame, metres, counter-clockwise seen from outside.
    """
    relief = _relief(parts, _axes(outward, along), obstacles)
    free, regions, first = relief.usable.copy(), [], 0.0
    for _ in range(MAX_REGIONS):
        found = _largest(relief, free)
        if found is None:
            break
        top, bottom, left, right = found
        sides = relief.rows[bottom] - relief.rows[top], relief.columns[right] - relief.columns[left]
        area = sides[0] * sides[1]
        if min(sides) < MIN_SIDES_M[0] or max(sides) < MIN_SIDES_M[1] or area < MIN_SHARE * first:
            break
        first = max(first, area)
        free[top : bottom + 1, left : right + 1] = False
        regions.append(_corners(relief, found))
    return regions


def _axes(outward: np.ndarray, along: np.ndarray) -> np.ndarray:
    along = along - (along @ outward) * outward
    if np.linalg.norm(along) < 1e-6:
        along = np.cross(outward, np.eye(3)[np.abs(outward).argmin()])
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(outward, along), outward])


def _relief(
    parts: Sequence[ConvexPart],
    axes: np.ndarray,
    obstacles: Sequence[ConvexPart],
) -> _Relief:
    corners = np.concatenate([part.mesh.vertices for part in parts]) @ axes.T
    low, high = corners.min(0), corners.max(0)
    step = max(MIN_STEP_M, float((high - low)[:2].max()) / LINES)
    rows, columns = (np.arange(low[i] + step / 4, high[i], step) for i in (0, 1))
    grid = np.stack(np.meshgrid(rows, columns, indexing="ij"), -1).reshape(-1, 2)
    heights, tilt = _first_hits(parts, axes, grid)
    usable = np.isfinite(heights) & (tilt > np.cos(np.radians(MAX_TILT_DEG)))
    for obstacle in obstacles:
        spans = _spans(obstacle, axes, grid)
        usable &= ~((spans.exit > heights + COVERED_M) & (spans.entry < heights + FREE_M))
    shape = len(rows), len(columns)
    return _Relief(heights.reshape(shape), usable.reshape(shape), rows, columns, axes)


def _first_hits(
    parts: Sequence[ConvexPart], axes: np.ndarray, grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Heights at which rays from outside meet the parts, and cosines of the faces met."""
    best, tilt = np.full(len(grid), np.nan), np.zeros(len(grid))
    for part in parts:
        spans = _spans(part, axes, grid)
        better = np.isfinite(spans.exit) & ~(best >= spans.exit)
        best[better], tilt[better] = spans.exit[better], spans.facing[better]
    return best, tilt


def _spans(part: ConvexPart, axes: np.ndarray, grid: np.ndarray) -> Crossings:
    """The heights between which each ray runs in a part."""
    return half_spaces(part.mesh).crossings(grid @ axes[:2], axes[2])


def _largest(relief: _Relief, free: np.ndarray) -> tuple[int, int, int, int] | None:
    """The largest rectangle of free nodes that is straight enough: top, bottom, left, right."""
    best, found = 0.0, None
    for top, left in _seeds(free):
        grown = _grown(relief, free, top, left)
        area = (relief.rows[grown[1]] - relief.rows[grown[0]]) * (
            relief.columns[grown[3]] - relief.columns[grown[2]]
        )
        if area > best:
            best, found = area, grown
    return found


def _seeds(free: np.ndarray) -> list[tuple[int, int]]:
    """Free nodes spread evenly, the innermost of them too."""
    nodes = np.argwhere(free)
    if len(nodes) == 0:
        return []
    middle = nodes[np.abs(nodes - nodes.mean(0)).sum(1).argmin()]
    chosen = nodes[:: max(1, len(nodes) // SEEDS)]
    return [(int(row), int(column)) for row, column in (middle, *chosen)]


def _grown(relief: _Relief, free: np.ndarray, row: int, column: int) -> tuple[int, int, int, int]:
    """Grows a rectangle from one node, side by side, as long as it stays on the surface."""
    box = [row, row, column, column]
    limits = (0, free.shape[0] - 1, 0, free.shape[1] - 1)
    open_sides = [0, 1, 2, 3]
    while open_sides:
        for side in tuple(open_sides):
            trial = box.copy()
            trial[side] += 1 if side % 2 else -1
            outside = trial[side] > limits[side] if side % 2 else trial[side] < limits[side]
            if outside or not _lies_on(relief, free, trial):
                open_sides.remove(side)
            else:
                box = trial
    return box[0], box[1], box[2], box[3]


def _lies_on(relief: _Relief, free: np.ndarray, box: list[int]) -> bool:
    top, bottom, left, right = box
    window = slice(top, bottom + 1), slice(left, right + 1)
    if not free[window].all():
        return False
    heights = relief.heights[window]
    rows, columns = (np.linspace(0.0, 1.0, n) for n in heights.shape)
    upper = np.outer(1 - rows, heights[0, 0] * (1 - columns) + heights[0, -1] * columns)
    lower = np.outer(rows, heights[-1, 0] * (1 - columns) + heights[-1, -1] * columns)
    return bool(np.abs(upper + lower - heights).max() <= MAX_GAP_M)


def _corners(relief: _Relief, box: tuple[int, int, int, int]) -> Corners:
    top, bottom, left, right = box
    nodes = ((top, left), (bottom, left), (bottom, right), (top, right))
    corners = []
    for row, column in nodes:
        flat = np.array([relief.rows[row], relief.columns[column], relief.heights[row, column]])
        corners.append(tuple(float(x) for x in np.round(flat @ relief.axes, 5)))
    return tuple(corners)
