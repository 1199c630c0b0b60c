"""Contact regions are rectangles on the side that they are asked for, close to the surface."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from proposals import box_part, degrees_between, grid_on, hull_part, normal_of

from gdg.hands.geometry import ConvexPart
from gdg.hands.propose.regions import MAX_GAP_M, MAX_REGIONS, MAX_TILT_DEG, inner_regions
from gdg.testing.surface import nearest_surface

X, Y, Z = np.eye(3)
#: Corners are rounded to this, metres.
ROUNDED_M = 1e-5
#: An edge between two lines of the height map may rise this much more, metres.
BETWEEN_LINES_M = 2e-4
SIZE = (0.017, 0.02, 0.04)


def sides_of(corners: object) -> np.ndarray:
    """Lengths of the first two sides, metres."""
    a, b, c, _ = np.array(corners)
    return np.array([np.linalg.norm(b - a), np.linalg.norm(c - b)])


def assert_lie_on(parts: Sequence[ConvexPart], regions: Sequence[object], outward: np.ndarray):
    """Corners lie on the surface, no point is farther off than allowed; all look outward."""
    for corners in regions:
        nearest = nearest_surface(parts, grid_on(corners))
        assert np.abs(nearest.distance).max() <= MAX_GAP_M + BETWEEN_LINES_M
        assert np.abs(nearest_surface(parts, np.array(corners)).distance).max() < 2 * ROUNDED_M
        assert degrees_between(normal_of(corners), outward) < MAX_TILT_DEG


def pebble(seed: int, radius: float = 0.02) -> ConvexPart:
    """A hull without any symmetry."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3))
    points *= radius * rng.uniform(0.3, 1.0, 3) / np.linalg.norm(points, axis=1, keepdims=True)
    return hull_part(trimesh.convex.convex_hull(points))


def stairs() -> list[ConvexPart]:
    """Three boxes one after the other, each longer and standing out 3 mm more."""
    ends = (0.0, 0.012, 0.028, 0.048)
    return [
        box_part((0.01 + 0.006 * i, 0.02, end - start), (0, 0, (start + end) / 2))
        for i, (start, end) in enumerate(pairwise(ends))
    ]


def ball(radius: float) -> ConvexPart:
    """A sphere about the origin."""
    mesh = trimesh.creation.icosphere(3, radius=radius)
    return ConvexPart("link", "sphere", (radius,), np.eye(4), mesh)


def turned(part: ConvexPart, T: np.ndarray) -> ConvexPart:
    """A part moved within its link."""
    return ConvexPart(
        part.link, part.kind, part.size, T @ part.T_link_part, part.mesh.copy().apply_transform(T)
    )


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    T = trimesh.transformations.random_rotation_matrix(rng.random(3))
    T[:3, 3] = rng.uniform(-0.1, 0.1, 3)
    return T


@pytest.mark.parametrize("outward", [X, -X, Y, -Y], ids=str)
def test_the_face_of_a_box_is_one_rectangle(outward: np.ndarray):
    part = box_part(SIZE, center=(0.003, -0.002, 0.02))
    (corners,) = inner_regions([part], outward, Z)
    assert degrees_between(normal_of(corners), outward) < 0.1
    assert_lie_on([part], [corners], outward)
    across = SIZE[1] if abs(outward @ X) else SIZE[0]
    assert sides_of(corners) == pytest.approx([SIZE[2], across], abs=0.004)
    assert (sides_of(corners) <= np.array([SIZE[2], across])).all()


def test_sides_are_aligned_with_the_phalanx():
    (corners,) = inner_regions([box_part(SIZE)], X, np.array([5.0, 0.0, 1.0]))
    a, b, _, _ = np.array(corners)
    assert abs((b - a) @ Z) == pytest.approx(np.linalg.norm(b - a))


def test_any_direction_will_do_for_a_link_without_length():
    (corners,) = inner_regions([box_part(SIZE)], X, X)
    assert degrees_between(normal_of(corners), X) < 0.1


@pytest.mark.parametrize("radius", [0.006, 0.008, 0.015])
def test_a_ball_gets_regions_on_the_side_asked_for(radius: float):
    outward = np.array([0.6, -0.48, 0.64])
    regions = inner_regions([ball(radius)], outward, Z)
    assert 1 <= len(regions) <= MAX_REGIONS
    assert_lie_on([ball(radius)], regions, outward)
    assert min(degrees_between(normal_of(corners), outward) for corners in regions) < 25


def test_a_phalanx_with_a_round_tip_gets_its_flat_side_first():
    parts = [box_part(SIZE), ball(0.0085)]
    parts[1] = turned(parts[1], trimesh.transformations.translation_matrix((0, 0, 0.02)))
    regions = inner_regions(parts, X, Z)
    assert_lie_on(parts, regions, X)
    assert degrees_between(normal_of(regions[0]), X) < 1
    areas = [np.prod(sides_of(corners)) for corners in regions]
    assert areas == sorted(areas, reverse=True)


def test_regions_of_one_link_do_not_overlap():
    regions = inner_regions(stairs(), X, Z)
    assert len(regions) == 3
    assert_lie_on(stairs(), regions, X)
    spans = sorted((np.array(c)[:, 2].min(), np.array(c)[:, 2].max()) for c in regions)
    assert all(low[1] <= high[0] for low, high in pairwise(spans))


def test_what_a_neighbour_covers_is_left_out():
    part, cover = box_part(SIZE), box_part((0.03, 0.03, 0.02), (0, 0, 0.01), "neighbour")
    (corners,) = inner_regions([part], X, Z, [cover])
    assert np.array(corners)[:, 2].max() <= 0.0
    assert sides_of(corners)[0] > 0.5 * SIZE[2] - 0.005
    behind = box_part((0.005, 0.03, 0.04), (-0.01, 0, 0), "neighbour")
    assert inner_regions([part], X, Z, [behind]) == inner_regions([part], X, Z)
    whole = box_part((0.03, 0.03, 0.05), link="neighbour")
    assert inner_regions([part], X, Z, [whole]) == []


def test_a_neighbour_in_front_covers_unless_there_is_room_for_an_object():
    part, front = box_part(SIZE), SIZE[0] / 2
    near = box_part((0.01, 0.03, 0.05), (front + 0.009, 0, 0), "neighbour")
    assert inner_regions([part], X, Z, [near]) == []
    far = box_part((0.01, 0.03, 0.05), (front + 0.02, 0, 0), "neighbour")
    assert inner_regions([part], X, Z, [far]) == inner_regions([part], X, Z)


@pytest.mark.parametrize("size", [(0.01, 0.002, 0.04), (0.01, 0.0025, 0.0025)])
def test_what_is_too_thin_to_touch_with_gets_none(size: tuple[float, float, float]):
    assert inner_regions([box_part(size)], X, Z) == []


def test_steep_faces_are_no_pads():
    corners = [(0, y, z) for y in (-0.01, 0.01) for z in (0, 0.04)] + [
        (0.03, 0, 0),
        (0.03, 0, 0.04),
    ]
    roof = trimesh.convex.convex_hull(np.array(corners))
    # its two sides look away from x by 72 degrees
    assert inner_regions([hull_part(roof)], X, Z) == []


@given(seed=st.integers(0, 2**32 - 1), shape=st.sampled_from(["box", "pebble", "stairs"]))
def test_regions_turn_with_the_part(seed: int, shape: str):
    parts = {"box": [box_part(SIZE)], "pebble": [pebble(0)], "stairs": stairs()}[shape]
    T = pose(seed)
    there = inner_regions([turned(part, T) for part in parts], T[:3, :3] @ X, T[:3, :3] @ Z)
    expected = [trimesh.transform_points(corners, T) for corners in inner_regions(parts, X, Z)]
    assert len(there) == len(expected)
    for found, wanted in zip(there, expected):
        np.testing.assert_allclose(found, wanted, atol=4 * ROUNDED_M)


@given(seed=st.integers(0, 2**32 - 1))
def test_regions_of_any_hull_lie_on_it(seed: int):
    rng = np.random.default_rng(seed)
    part, outward = pebble(seed, rng.uniform(0.008, 0.025)), rng.normal(size=3)
    outward /= np.linalg.norm(outward)
    regions = inner_regions([part], outward, rng.normal(size=3))
    assert len(regions) <= MAX_REGIONS
    assert_lie_on([part], regions, outward)
