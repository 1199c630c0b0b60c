"""Convex parts are convex, few, and together the mesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gdg.errors import GdgError
from gdg.geometry.convex import Decomposition, convex_parts
from gdg.geometry.mesh import inside_convex

FINE = Decomposition(gap_m=0.0001, max_parts=64)


def cup() -> trimesh.Trimesh:
    outer = trimesh.creation.cylinder(0.035, 0.08, sections=48)
    inner = trimesh.creation.cylinder(0.032, 0.08, sections=48)
    inner.apply_translation((0, 0, 0.003))
    return trimesh.boolean.difference([outer, inner], engine="manifold")


def covered(parts: list[trimesh.Trimesh], points: np.ndarray) -> np.ndarray:
    return np.any([inside_convex(part, points, margin=0.0) for part in parts], axis=0)


def test_a_convex_mesh_is_its_own_part():
    box = trimesh.creation.box((0.03, 0.04, 0.05))
    (part,) = convex_parts(box, FINE)
    assert part.volume == pytest.approx(box.volume, rel=1e-5)


def test_an_ell_becomes_two_boxes():
    arms = [trimesh.creation.box((0.1, 0.02, 0.02)), trimesh.creation.box((0.02, 0.02, 0.1))]
    arms[1].apply_translation((-0.04, 0, 0.04))
    ell = trimesh.boolean.union(arms, engine="manifold")
    parts = convex_parts(ell, FINE)
    assert 2 <= len(parts) <= 4
    assert sum(part.volume for part in parts) == pytest.approx(ell.volume, rel=0.02)


def test_a_thin_cup_keeps_its_cavity_and_its_wall():
    mesh = cup()
    parts = convex_parts(mesh, FINE)
    assert len(parts) <= FINE.max_parts
    assert all(part.is_convex and part.is_watertight for part in parts)
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(-0.03, 0.038, 2000)

    def ring(radius: float) -> np.ndarray:
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)

    assert covered(parts, ring(0.0)).mean() == 0
    assert covered(parts, ring(0.028)).mean() < 0.01
    assert covered(parts, ring(0.0335)).mean() > 0.9
    assert covered(parts, ring(0.037)).mean() < 0.01
    union = trimesh.boolean.union(parts, engine="manifold")
    assert union.volume == pytest.approx(mesh.volume, rel=0.2)


@pytest.mark.parametrize("limit", [1, 2, 5])
def test_there_are_never_more_parts_than_allowed(limit: int):
    parts = convex_parts(cup(), Decomposition(gap_m=0.0, max_parts=limit))
    assert len(parts) <= limit


def test_hulls_are_thinned():
    sphere = trimesh.creation.icosphere(4, 0.03)
    (part,) = convex_parts(sphere, Decomposition(gap_m=0.01, max_parts=1, max_vertices=60))
    assert len(part.vertices) <= 60
    assert part.volume == pytest.approx(sphere.volume, rel=0.15)


def test_an_open_mesh_is_closed_first():
    box = trimesh.creation.box((0.04,) * 3)
    box.update_faces(box.face_normals[:, 2] < 0.5)
    (part,) = convex_parts(box, Decomposition(gap_m=0.001, max_parts=8))
    assert part.volume == pytest.approx(0.04**3, rel=0.06)


def test_an_inside_out_mesh_is_turned_around():
    box = trimesh.creation.box((0.04,) * 3)
    box.invert()
    (part,) = convex_parts(box, FINE)
    assert part.volume == pytest.approx(0.04**3, rel=1e-5)


def test_a_sheet_is_refused():
    sheet = trimesh.Trimesh(
        [[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0]], [[0, 1, 2], [2, 1, 0]], process=False
    )
    with pytest.raises(GdgError, match="encloses no volume"):
        convex_parts(sheet, FINE)


def test_parts_are_the_same_from_the_cache():
    first, second = convex_parts(cup(), FINE), convex_parts(cup(), FINE)
    assert len(first) == len(second)
    for a, b in zip(first, second):
        np.testing.assert_array_equal(a.vertices, b.vertices)
