"""The signed-distance grid is as exact as its cells, on all sides and with faulty meshes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from gdg.geometry.sdf import (
    MARGIN_M,
    SignedDistanceGrid,
    closed_surface,
    signed_distance_arrays,
    winding_numbers,
)

RADIUS = 0.04
HALF = torch.tensor([0.03, 0.02, 0.01])


def grid_of(mesh: trimesh.Trimesh) -> SignedDistanceGrid:
    arrays = signed_distance_arrays(mesh)
    return SignedDistanceGrid(
        torch.from_numpy(arrays["values"]),
        torch.from_numpy(arrays["origin"]),
        float(arrays["spacing"]),
    )


@pytest.fixture(scope="module")
def sphere() -> SignedDistanceGrid:
    return grid_of(trimesh.creation.icosphere(5, RADIUS))


@pytest.fixture(scope="module")
def box() -> SignedDistanceGrid:
    return grid_of(trimesh.creation.box(2 * HALF.numpy()))


def box_distance(points: torch.Tensor) -> torch.Tensor:
    beyond = points.abs() - HALF
    return beyond.clamp(min=0).norm(dim=-1) + beyond.amax(-1).clamp(max=0)


def directions(count: int, seed: int = 0) -> torch.Tensor:
    normal = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed))
    return torch.nn.functional.normalize(normal, dim=-1)


def test_a_face_without_area_is_no_surface():
    box = trimesh.creation.box(2 * HALF.numpy())
    line = len(box.vertices) + np.arange(3)[None]
    vertices = np.concatenate((box.vertices, [[-0.02, 0, 0], [0, 0, 0], [0.02, 0, 0]]))
    mesh = trimesh.Trimesh(vertices, np.concatenate((box.faces, line)), process=False)
    points = directions(500) * 0.02
    torch.testing.assert_close(grid_of(mesh).distance(points), grid_of(box).distance(points))


def test_distance_to_a_sphere_is_exact_near_its_surface_and_close_elsewhere(
    sphere: SignedDistanceGrid,
):
    for offset, cells in ((-0.03, 0.6), (-0.002, 0.3), (0, 0.15), (0.002, 0.3), (0.01, 0.4)):
        found = sphere.distance((RADIUS + offset) * directions(2000))
        assert (found - offset).abs().max() < cells * sphere.spacing, offset


def test_distance_to_a_box_is_exact_to_half_a_cell(box: SignedDistanceGrid):
    share = torch.rand(5000, 3, generator=torch.Generator().manual_seed(0))
    points = (2 * share - 1) * (HALF + 0.9 * MARGIN_M)
    assert (box.distance(points) - box_distance(points)).abs().max() < box.spacing / 2


def test_distance_outside_the_grid_is_an_upper_bound_that_grows_outward(box: SignedDistanceGrid):
    for reach in (0.1, 0.5, 3.0):
        points = reach * directions(500)
        found, true = box.distance(points), box_distance(points)
        assert (found >= true - box.spacing).all()
        assert (found <= true + 2 * MARGIN_M + 0.05).all()
        further = box.distance(1.1 * points)
        assert (further > found).all()


def test_distance_is_continuous_across_the_border_of_the_grid(box: SignedDistanceGrid):
    border = float(box.origin[0])
    points = torch.tensor([[border + step, 0.001, 0.002] for step in (-1e-5, 1e-5)])
    inside, outside = box.distance(points)
    assert abs(inside - outside) < 3e-5


def test_the_gradient_is_the_outward_direction(sphere: SignedDistanceGrid):
    outward = directions(500)
    for radius in (0.03, RADIUS, 0.045, 0.2):
        points = (radius * outward).requires_grad_(True)
        (gradient,) = torch.autograd.grad(sphere.distance(points).sum(), points)
        cosine = torch.nn.functional.cosine_similarity(gradient, outward)
        assert cosine.min() > (0.95 if radius < 0.1 else 0.8)
    normals = sphere.normals(RADIUS * outward)
    torch.testing.assert_close(normals.norm(dim=-1), torch.ones(500))
    assert (normals * outward).sum(-1).min() > 0.99


def test_the_gradient_equals_finite_differences(sphere: SignedDistanceGrid):
    # points in the middle of cells, where the interpolation is smooth
    cells = torch.randint(2, 120, (50, 3), generator=torch.Generator().manual_seed(1))
    points = (sphere.origin + (cells + 0.5) * sphere.spacing).requires_grad_(True)
    (gradient,) = torch.autograd.grad(sphere.distance(points).sum(), points)
    for axis in range(3):
        step = torch.zeros(3)
        step[axis] = 0.2 * sphere.spacing
        difference = sphere.distance(points + step) - sphere.distance(points - step)
        expected = difference / (0.4 * sphere.spacing)
        torch.testing.assert_close(gradient[:, axis], expected, atol=5e-3, rtol=0)


@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (3,), (2, 5, 3), (2, 0, 3), (1, 1, 1, 3)])
def test_any_batch_shape_gives_the_same_numbers(box: SignedDistanceGrid, shape: tuple[int, ...]):
    points = 0.03 * torch.randn(shape, generator=torch.Generator().manual_seed(0))
    found = box.distance(points)
    assert found.shape == shape[:-1]
    assert box.normals(points).shape == shape
    for one, value in zip(points.reshape(-1, 3), found.reshape(-1)):
        torch.testing.assert_close(box.distance(one[None])[0], value, atol=1e-7, rtol=0)


def test_the_zero_surface_is_the_surface(box: SignedDistanceGrid):
    surface = box.zero_surface()
    assert surface.is_watertight
    assert surface.volume == pytest.approx(float((2 * HALF).prod()), rel=0.02)
    assert box_distance(torch.from_numpy(surface.vertices).float()).abs().max() < box.spacing


def test_overlapping_bodies_are_their_union():
    first, second = trimesh.creation.box((0.04,) * 3), trimesh.creation.box((0.04,) * 3)
    second.apply_translation((0.02, 0.01, 0))
    grid = grid_of(trimesh.util.concatenate([first, second]))
    inside = torch.tensor([[-0.015, 0, 0], [0.01, 0.005, 0.0], [0.035, 0.01, 0], [0.0, 0.0, 0.0]])
    outside = torch.tensor([[-0.015, 0.028, 0], [0.035, -0.018, 0], [0.06, 0, 0]])
    assert (grid.distance(inside) < 0).all()
    assert (grid.distance(outside) > 0).all()


def test_a_small_hole_does_not_let_the_outside_in():
    mesh = trimesh.creation.icosphere(5, RADIUS)
    keep = np.ones(len(mesh.faces), bool)
    keep[7] = False
    mesh.update_faces(keep)
    assert not mesh.is_watertight
    grid = grid_of(mesh)
    points = torch.stack([share * RADIUS * directions(300) for share in (0.1, 0.5, 0.9)])
    assert (grid.distance(points) < 0).all()


def test_a_mesh_with_edges_of_four_faces_has_the_right_signs():
    first, second = trimesh.creation.box((0.04,) * 3), trimesh.creation.box((0.04,) * 3)
    second.apply_translation((0.04, 0.04, 0))
    both = trimesh.util.concatenate([first, second])
    both.merge_vertices()
    grid = grid_of(both)
    assert (grid.distance(torch.tensor([[0.0, 0, 0], [0.04, 0.04, 0]])) < 0).all()
    assert (grid.distance(torch.tensor([[0.04, 0.0, 0], [0.0, 0.04, 0]])) > 0).all()


def test_a_cavity_is_outside():
    shell, hollow = trimesh.creation.box((0.06,) * 3), trimesh.creation.box((0.03,) * 3)
    hollow.invert()
    grid = grid_of(trimesh.util.concatenate([shell, hollow]))
    assert grid.distance(torch.zeros(1, 3))[0] == pytest.approx(0.015, abs=1e-3)
    assert grid.distance(torch.tensor([[0.022, 0.0, 0.0]]))[0] < 0


def test_winding_numbers_count_the_bodies_around_a_point():
    mesh = trimesh.creation.box((0.04,) * 3)
    twice = trimesh.util.concatenate([mesh, mesh.copy()])
    points = np.array([[0.0, 0, 0], [0.1, 0, 0]])
    np.testing.assert_allclose(winding_numbers(mesh, points), [1, 0], atol=1e-3)
    np.testing.assert_allclose(winding_numbers(twice, points), [2, 0], atol=1e-3)


def test_a_mesh_with_gaps_gets_a_closed_surface():
    mesh = trimesh.creation.box((0.04,) * 3)
    mesh.update_faces(mesh.face_normals[:, 2] < 0.5)
    closed = closed_surface(mesh)
    assert closed.is_watertight
    assert closed.volume == pytest.approx(0.04**3, rel=0.05)


def test_a_sheet_has_no_closed_surface():
    sheet = trimesh.Trimesh(
        [[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0]], [[0, 1, 2], [2, 1, 0]], process=False
    )
    assert len(closed_surface(sheet).faces) == 0
