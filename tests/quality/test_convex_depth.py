"""Depths against cases worked out by hand, against hulls of differences and against fcl's EPA."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gdg.geometry.overlap import body_of, penetration_depth
from gdg.quality.convex_depth import (
    FLAT_M,
    Polyhedron,
    nearest_on_hull,
    overlap_depth,
    polyhedron,
    sphere,
)

EYE, ZERO = np.eye(3), np.zeros(3)


def box(*sides: float) -> Polyhedron:
    return polyhedron(trimesh.creation.box(sides).vertices)


def cylinder(radius: float, length: float) -> Polyhedron:
    return polyhedron(trimesh.creation.cylinder(radius, length, sections=32).vertices)


def blob(rng: np.random.Generator, count: int) -> np.ndarray:
    return 0.02 * rng.normal(size=(count, 3)) * rng.uniform(0.1, 1.0, 3)


def test_a_box_has_six_faces_and_twelve_edges():
    cube = box(0.02, 0.04, 0.06)
    assert (len(cube.normals), len(cube.edges), len(cube.vertices)) == (6, 12, 8)
    assert (len(cube.faces), cube.is_sphere) == (12, False)
    corners = cube.vertices[cube.faces]
    turns = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", turns, cube.triangle_normals) > 0).all()


@pytest.mark.parametrize(
    "shift", [[0.029, 0, 0], [0.025, 0.003, 0], [0, 0, -0.0201], [0, 0.028, 0]]
)
def test_aligned_boxes_leave_by_the_nearest_side(shift: list[float]):
    # EPA ends the process on some of these
    depth = overlap_depth(box(0.02, 0.02, 0.02), box(0.04, 0.04, 0.04), EYE, np.array(shift))
    assert depth == pytest.approx(0.03 - max(abs(s) for s in shift), abs=1e-12)


@pytest.mark.parametrize("shift", [[0.03, 0, 0], [0.031, 0, 0], [0.02, 0.05, 0]])
def test_boxes_that_touch_or_are_apart_have_no_depth(shift: list[float]):
    depth = overlap_depth(box(0.02, 0.02, 0.02), box(0.04, 0.04, 0.04), EYE, np.array(shift))
    assert depth == pytest.approx(0.0, abs=1e-12)


def test_a_box_one_inside_the_other_leaves_by_its_own_length_too():
    depth = overlap_depth(box(0.02, 0.02, 0.02), box(0.04, 0.05, 0.06), EYE, ZERO)
    assert depth == pytest.approx(0.03, abs=1e-12)


def test_crossed_edges_are_found():
    # two cubes, each on an edge, the edges crossing at a right angle, 1 mm deep
    half = 0.01 * np.sqrt(2)
    one = Rotation.from_euler("x", 45, degrees=True).as_matrix()
    other = Rotation.from_euler("y", 45, degrees=True).as_matrix()
    turn, shift = other.T @ one, other.T @ np.array([0, 0, 2 * half - 0.001])
    depth = overlap_depth(box(0.02, 0.02, 0.02), box(0.02, 0.02, 0.02), turn, shift)
    assert depth == pytest.approx(0.001, abs=1e-12)


def test_a_sphere_leaves_a_box_by_its_face_edge_or_corner():
    cube, radius = box(0.04, 0.04, 0.04), 0.01
    for center, depth in (
        ([0.025, 0, 0], 0.005),
        ([0.015, 0, 0], 0.015),
        ([0.025, 0.025, 0], 0.01 - 0.005 * np.sqrt(2)),
        ([0.025, 0.025, 0.025], 0.01 - 0.005 * np.sqrt(3)),
        ([0.028, 0.028, 0], 0.0),
    ):
        ball = sphere(np.array(center), radius)
        assert overlap_depth(ball, cube, EYE, ZERO) == pytest.approx(depth, abs=1e-12)
        assert overlap_depth(cube, ball, EYE, ZERO) == pytest.approx(depth, abs=1e-12)


def test_two_spheres_overlap_by_their_radii_less_the_gap():
    one, other = sphere(ZERO, 0.01), sphere(np.array([0.0, 0.0, 0.02]), 0.015)
    assert overlap_depth(one, other, EYE, ZERO) == pytest.approx(0.005)
    assert overlap_depth(one, other, EYE, np.array([0.0, 0.0, -0.02])) == 0.0


def test_a_cylinder_leaves_a_box_by_its_end_or_its_side():
    rod, cube = cylinder(0.01, 0.06), box(0.04, 0.04, 0.04)
    at_end = overlap_depth(rod, cube, EYE, np.array([0.0, 0.0, 0.048]))
    assert at_end == pytest.approx(0.002, abs=1e-12)
    # the mesh has a corner of its 32 sides at +x and at -x
    beside = overlap_depth(rod, cube, EYE, np.array([0.028, 0.0, 0.0]))
    assert beside == pytest.approx(0.002, abs=1e-12)


@given(st.integers(0, 10_000))
def test_depths_are_those_of_the_hull_of_differences(seed: int):
    rng = np.random.default_rng(seed)
    a, b = (trimesh.convex.convex_hull(blob(rng, n)) for n in (12, 20))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = (
        Rotation.random(None, np.random.default_rng(seed)).as_matrix(),
        0.01 * rng.normal(size=3),
    )
    expected = penetration_depth(body_of(a).placed(T), body_of(b))
    one, other = polyhedron(a.vertices), polyhedron(b.vertices)
    depth = overlap_depth(one, other, T[:3, :3], T[:3, 3])
    assert depth == pytest.approx(expected, abs=1e-8)
    back = overlap_depth(other, one, T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])
    assert back == pytest.approx(depth, abs=1e-10)
    assert overlap_depth(one, other, T[:3, :3], T[:3, 3], floor=depth + 1e-9) == 0.0
    if depth > 0:
        below = overlap_depth(one, other, T[:3, :3], T[:3, 3], floor=0.9 * depth)
        assert below == pytest.approx(depth)


def epa_depth(a: Polyhedron, b: Polyhedron, R: np.ndarray, t: np.ndarray) -> float:
    def convex(shape: Polyhedron) -> fcl.Convex:
        faces = np.c_[np.full(len(shape.faces), 3), shape.faces].astype(np.int32)
        return fcl.Convex(shape.vertices, len(shape.faces), faces.ravel())

    request = fcl.DistanceRequest(enable_signed_distance=True)
    one, other = fcl.CollisionObject(convex(a), fcl.Transform(R, t)), fcl.CollisionObject(convex(b))
    return max(0.0, -fcl.distance(one, other, request, fcl.DistanceResult()))


def test_depths_are_those_of_epa_in_general_poses():
    rng, depths = np.random.default_rng(0), []
    for seed in range(100):
        a, b = polyhedron(blob(rng, 15)), polyhedron(blob(rng, 30))
        R, t = (
            Rotation.random(None, np.random.default_rng(seed)).as_matrix(),
            0.008 * rng.normal(size=3),
        )
        depths.append((overlap_depth(a, b, R, t), epa_depth(a, b, R, t)))
    ours, theirs = np.array(depths).T
    assert (ours > 0).sum() > 30
    np.testing.assert_allclose(ours, theirs, atol=2e-6)


@pytest.mark.parametrize("thickness", [0.0, 1e-8, 1e-5])
def test_a_sheet_in_a_box_is_as_deep_as_it_reaches(thickness: float):
    corners = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (0, 1)])
    sheet = polyhedron(corners * [1, 1, thickness])
    on_edge = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    depth = overlap_depth(sheet, box(0.04, 0.04, 0.04), on_edge, np.array([0.0, 0.0, 0.037]))
    assert depth == pytest.approx(0.003, abs=2 * FLAT_M)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_points_and_needles_are_bodies(count: int):
    needle = polyhedron(np.arange(3.0 * count).reshape(count, 3) * 1e-3)
    assert overlap_depth(needle, box(0.04, 0.04, 0.04), EYE, ZERO) > 0.005
    assert overlap_depth(needle, box(0.04, 0.04, 0.04), EYE, np.array([0.1, 0, 0])) == 0.0


@given(st.integers(0, 10_000))
def test_the_nearest_point_of_a_hull_is_that_of_its_mesh(seed: int):
    rng = np.random.default_rng(seed)
    hull = polyhedron(blob(rng, 20))
    point = 0.04 * rng.normal(size=3)
    inside = ((point - hull.triangles[:, 0]) * hull.triangle_normals).sum(-1).max() <= 0
    candidates = trimesh.triangles.closest_point(
        hull.triangles, np.broadcast_to(point, (len(hull.faces), 3))
    )
    nearest = np.array(nearest_on_hull(point, hull.triangles, hull.triangle_normals))
    expected = 0.0 if inside else np.linalg.norm(candidates - point, axis=-1).min()
    assert np.linalg.norm(nearest - point) == pytest.approx(expected, abs=1e-10)
